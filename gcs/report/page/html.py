"""The page that every report is put into: its head, its style, and the one way in which words get into it."""

from __future__ import annotations

import html
import math
from collections.abc import Collection, Iterable, Sequence
from typing import Final

from infra.plain_text import plain

__all__ = [
    "CHART_WIDTH",
    "COLOURS",
    "DASHES",
    "Section",
    "chart",
    "empty",
    "fixed",
    "page",
    "section",
    "table",
    "words",
]

POLICY: Final = "default-src 'none'; style-src 'unsafe-inline'; img-src data:"
"""What a browser may do with the page: show it."""
COLOURS: Final = 8
"""Colours of vehicles, ``c0`` to ``c7``; the ninth begins anew, with another dash."""
CHART_WIDTH: Final = 1000
DASHES: Final = ("", "12 5", "3 4", "12 4 3 4")
"""Of lines: pages are printed in grey, too."""
# Told apart without red, green or blue cones, 4.5 : 1 on the page in light and in dark.
_LIGHT = ("#005f99", "#a34400", "#006b50", "#99306f", "#6e5200", "#5244a8", "#3a6200", "#6b4636")
_DARK = ("#5cb8ee", "#f7914a", "#33cba1", "#ea9cc8", "#e8be1f", "#aaa0f7", "#9fd353", "#cfab99")
_STYLE: Final = (
    """
:root{color-scheme:light dark;--page:#fff;--ink:#1a1d23;--soft:#525a66;--line:#c9ced6;--fill:#f2f4f7;--bad:#a3140f;
--warn:#7a5200}"""
    + "".join(f".c{k}{{color:{colour}}}" for k, colour in enumerate(_LIGHT))
    + """
*{box-sizing:border-box}
body{margin:0 auto;max-width:1100px;padding:1.2rem;background:var(--page);color:var(--ink);
font:16px/1.5 system-ui,"Segoe UI",Roboto,"Liberation Sans",sans-serif;overflow-wrap:break-word}
h1{font-size:1.7rem;line-height:1.2;margin:.2rem 0}h2{font-size:1.25rem;margin:2rem 0 .5rem;
border-bottom:1px solid var(--line)}h3{font-size:1.05rem;margin:1.2rem 0 .3rem}
p{margin:.4rem 0;max-width:75ch}.soft{color:var(--soft)}.bad{color:var(--bad)}.warn{color:var(--warn)}
.wide{overflow-x:auto;margin:.5rem 0}
table{border-collapse:collapse;font-size:.9rem}th,td{padding:.2rem .7rem .2rem 0;text-align:left;vertical-align:top;
border-bottom:1px solid var(--line)}th{font-weight:600}thead th{white-space:nowrap}
tbody th{min-width:5.5rem}td:last-child:not(.n){min-width:9rem}
td.n,th.n{text-align:right;font-variant-numeric:tabular-nums;white-space:nowrap}
svg{display:block;width:100%;height:auto;background:var(--fill)}svg text{font-size:16px;fill:currentColor}
svg text.on{fill:var(--page)}svg text.halo{paint-order:stroke;stroke:var(--fill);stroke-width:4px;stroke-linejoin:round}
.chart{min-width:720px}.small{max-width:340px}.ink{color:var(--ink)}.rule{stroke:var(--line)}
.stills,.parts{display:grid;grid-template-columns:repeat(auto-fill,minmax(min(100%,24rem),1fr));gap:1rem;margin:.5rem 0}
figure{margin:0}figure,article{break-inside:avoid}figure img{width:100%;height:auto;display:block}
figcaption{font-size:.9rem;color:var(--soft)}
code{font-size:.85em}
@media (prefers-color-scheme:dark){:root{--page:#14171c;--ink:#e7eaef;--soft:#a9b1bd;--line:#3a414c;--fill:#1c2129;
--bad:#ff8d84;--warn:#f2c14a}"""
    + "".join(f".c{k}{{color:{colour}}}" for k, colour in enumerate(_DARK))
    + """}
@media print{:root{color-scheme:light;--page:#fff;--ink:#000;--soft:#333;--line:#999;--fill:#fff;--bad:#8a0000;
--warn:#5a3c00}"""
    + "".join(f".c{k}{{color:{colour}}}" for k, colour in enumerate(_LIGHT))
    + """body{max-width:none;padding:0;font-size:10pt}h2,h3{break-after:avoid}tr{break-inside:avoid}
.wide{overflow:visible}svg,img{max-height:230mm}.parts{grid-template-columns:1fr 1fr}.parts table{font-size:8pt;
width:100%}.parts th{width:40%}.chart{min-width:0}.small{max-width:80mm}@page{margin:15mm}}
"""
)

Section = str
"""HTML of one part of a page: made by ``section``, of words that went through ``words``."""


def words(text: str) -> str:
    """Words that are not ours, for any place of a page: plain, and never markup."""
    return html.escape(plain(text), quote=True)


def fixed(value: float, digits: int = 1, unit: str = "") -> str:
    """A number with its unit; a dash where it is unknown."""
    if not math.isfinite(value):
        return "–"
    return f"{value:z.{digits}f}{' ' if unit and unit != '%' else ''}{unit}"


def chart(height: float, label: str, parts: str) -> str:
    """A drawing ``CHART_WIDTH`` wide that is as wide as the page, and is moved sideways where that is narrow.

    Args:
        height: of the drawing.
        label: plain words, what it shows.
        parts: SVG.
    """
    label = words(label)
    svg = f'<svg class="chart" viewBox="0 0 {CHART_WIDTH} {height:.0f}" role="img"><title>{label}</title>{parts}</svg>'
    return f'<div class="wide" role="region" tabindex="0" aria-label="{label}">{svg}</div>'


def empty(text: str) -> str:
    """A sentence in place of what is not there."""
    return f'<p class="soft">{words(text)}</p>'


def table(columns: Sequence[str], rows: Iterable[Sequence[str]], *, right: Collection[str] = (), caption: str) -> str:
    """A table; cells are plain words, the first of a row is its head.

    Args:
        columns: names, all different.
        rows: a cell for each column.
        right: names of the columns that are aligned right: numbers.
        caption: what it is, for those who do not see it.
    """
    classes = [' class="n"' if name in right else "" for name in columns]
    head = "".join(f'<th scope="col"{kind}>{words(name)}</th>' for name, kind in zip(columns, classes, strict=True))
    lines = []
    for row in rows:
        first, *others = (words(cell) for cell in row)
        cells = "".join(f"<td{kind}>{cell}</td>" for cell, kind in zip(others, classes[1:], strict=True))
        lines.append(f'<tr><th scope="row"{classes[0]}>{first}</th>{cells}</tr>')
    label = words(caption)
    return (
        f'<div class="wide" role="region" tabindex="0" aria-label="{label}"><table>'
        f"<thead><tr>{head}</tr></thead><tbody>{''.join(lines)}</tbody></table></div>"
    )


def section(title: str, *parts: str) -> Section:
    """One part of a page under its heading.

    Args:
        title: plain words.
        parts: HTML.
    """
    return f"<section><h2>{words(title)}</h2>{''.join(parts)}</section>\n"


def page(title: str, lead: str, sections: Iterable[Section]) -> str:
    """The whole document.

    Args:
        title: plain words.
        lead: plain words, what there is to know first.
        sections: in order.
    """
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">'
        '<meta name="viewport" content="width=device-width,initial-scale=1">'
        '<meta name="referrer" content="no-referrer">'
        f"<title>{words(title)}</title><style>{_STYLE}</style></head>\n"
        f"<body><main><h1>{words(title)}</h1><p>{words(lead)}</p>\n{''.join(sections)}</main></body></html>\n"
    )
