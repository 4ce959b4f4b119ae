"""The page that every report is put into: its head, its style, and the one way in which words get into it."""

from __future__ import annotations

import html
import math
import re
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

from gcs.report.page.style import SHARE_STEPS, STYLE
from infra.plain_text import plain

POLICY: Final = "default-src 'none'; style-src 'unsafe-inline'; img-src data:"
"""Policy for browsers: they may show the page, no more."""
CHART_WIDTH: Final = 1000
MAX_LINES: Final = 5
"""Most lines of one kind on a card."""
DASHES: Final = ("", "12 5", "3 4", "12 4 3 4")
"""Dashes that tell lines apart: pages are printed in grey, too."""
Line = tuple[str, str]
"""Plain words on a card, and the class that says what they mean: ``confirmed tentative never warn bad``, or none."""


@dataclass(frozen=True, slots=True)
class Section:
    """One part of a page under its heading."""

    title: str
    """Plain words, ours."""
    parts: str
    """HTML, of words that went through ``words``."""

    @property
    def anchor(self) -> str:
        """Name of the part for links to it."""
        return "-".join(re.findall(r"[a-z]+", self.title.lower()))


def words(text: str) -> str:
    """Words that are not ours, for any place of a page: plain, and never markup."""
    return html.escape(plain(text), quote=True)


_HYPHENATED: Final = re.compile(r"(?<!\S)(?=\S*-)\S{1,32}(?!\S)")


def whole_words(text: str) -> str:
    """Words as ``words`` makes them, those with a hyphen unbroken: half a vehicle's name may be another's."""
    return _HYPHENATED.sub(r'<span class="whole">\g<0></span>', words(text))


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


def table(
    columns: Sequence[str],
    rows: Iterable[Sequence[str]],
    *,
    right: Collection[str] = (),
    kinds: Mapping[str, Callable[[str], str | None]] = MappingProxyType({}),
    caption: str,
) -> str:
    """A table; cells are plain words, the first of a row is its head.

    Args:
        columns: names, all different.
        rows: a cell for each column.
        right: names of the columns that are aligned right: numbers.
        kinds: by name of a column, the class of a cell by its words, none for none.
        caption: what it is, for those who do not see it.
    """
    numbers = ["n" if name in right else "" for name in columns]
    named = list(zip(columns, numbers, strict=True))
    head = "".join(f'<th scope="col"{_kind(kind)}>{words(name)}</th>' for name, kind in named)
    looks = [(number, kinds.get(name, _plain)) for name, number in named]
    lines = []
    for row in rows:
        first, *others = (
            f"{_kind(number, kind_of(cell))}>{words(cell)}" for cell, (number, kind_of) in zip(row, looks, strict=True)
        )
        lines.append(f'<tr><th scope="row"{first}</th>{"".join(f"<td{cell}</td>" for cell in others)}</tr>')
    label = words(caption)
    return (
        f'<div class="wide" role="region" tabindex="0" aria-label="{label}"><table>'
        f"<thead><tr>{head}</tr></thead><tbody>{''.join(lines)}</tbody></table></div>"
    )


def bar(percent: str) -> str:
    """Class of a cell with a share, as ``fixed(share, 1, "%")`` writes it: a bar behind it as long as the share.

    Example:
        >>> bar("48.2%"), bar("–")
        ('share b10', '')
    """
    return f"share b{round(float(percent[:-1]) * SHARE_STEPS / 100)}" if percent.endswith("%") else ""


def _plain(_: str) -> str:
    return ""


def _kind(*kinds: str | None) -> str:
    known = " ".join(filter(None, kinds))
    return f' class="{known}"' if known else ""


def card(title: str, sum_up: tuple[str, str], lines: Iterable[Line], kind: str = "") -> str:
    """Card with what there is to know first of one question.

    Args:
        title: plain words, the question.
        sum_up: plain words: the figure, large, and what it counts.
        lines: more of it.
        kind: ``good warn bad``, how it looks as a whole.
    """
    figure, what = map(words, sum_up)
    listed = "".join(f"<li{_kind(of)}>{whole_words(text)}</li>" for text, of in lines)
    summed = f"<strong>{figure}</strong> {what}" if figure else what
    return (
        f'<div{_kind("card", kind)}><h2>{words(title)}</h2><p class="sum">{summed}</p>'
        f"{f'<ul>{listed}</ul>' if listed else ''}</div>"
    )


def listed(lines: Sequence[Line]) -> list[Line]:
    """The first few, and how many more there are: the lists below have all of them."""
    more = [(f"and {len(lines) - MAX_LINES} more, below", "")] if len(lines) > MAX_LINES else []
    return [*lines[:MAX_LINES], *more]


def section(title: str, *parts: str) -> Section:
    """One part of a page."""
    return Section(title, "".join(parts))


def page(title: str, lead: str, cards: Iterable[str], sections: Sequence[Section]) -> str:
    """The whole document.

    Args:
        title: plain words.
        lead: plain words, of what it is.
        cards: the answers to what is asked first.
        sections: in order; each is linked from the top.
    """
    links = "".join(f'<a href="#{each.anchor}">{words(each.title)}</a>' for each in sections)
    parts = "".join(
        f'<section id="{each.anchor}"><h2>{words(each.title)}</h2>{each.parts}</section>\n' for each in sections
    )
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">'
        '<meta name="viewport" content="width=device-width,initial-scale=1">'
        '<meta name="referrer" content="no-referrer">'
        f"<title>{words(title)}</title><style>{STYLE}</style></head>\n"
        f'<body><main><header><h1>{words(title)}</h1><p class="soft">{words(lead)}</p></header>\n'
        f'<div class="cards">{"".join(cards)}</div><nav aria-label="Parts of this page">{links}</nav>\n'
        f"{parts}</main></body></html>\n"
    )
