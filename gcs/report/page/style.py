"""The look of every page: the colours of screens and films, in light and in dark, and one style sheet."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from gcs.report.overlay import DARK as PICTURE_PAPER
from gcs.report.overlay import STANDING_RGB

Rgb = tuple[int, int, int]

LIGHT: Final[Mapping[str, Rgb]] = MappingProxyType(
    {
        "panel": (252, 252, 250),
        "head": (234, 237, 242),
        "line": (118, 126, 138),
        "faint": (86, 93, 104),
        "ink": (42, 48, 58),
        "accent": (0, 84, 166),
        "confirmed": (0, 110, 104),
        "tentative": (126, 90, 0),
        "unidentified": (96, 0, 125),
        "no position": (127, 6, 2),
    }
)
"""Colours by what each is for, as on the light screens."""
DARK: Final[Mapping[str, Rgb]] = MappingProxyType(
    {
        "panel": PICTURE_PAPER,
        "head": (28, 34, 46),
        "line": (98, 110, 134),
        "faint": (152, 160, 176),
        "ink": (206, 213, 225),
        "accent": (110, 190, 255),
        **{standing: STANDING_RGB[standing] for standing in ("confirmed", "tentative", "unidentified", "no position")},
    }
)
"""Colours of vehicles on dark pages, as on the dark screens and in films."""
VEHICLES_LIGHT: Final = ("#005f99", "#a34400", "#006b50", "#99306f", "#6e5200", "#5244a8", "#3a6200", "#6b4636")
"""Colours that are told apart without red, green or blue cones, 4.5 : 1 on the page."""
VEHICLES_DARK: Final = ("#5cb8ee", "#f7914a", "#33cba1", "#ea9cc8", "#e8be1f", "#aaa0f7", "#9fd353", "#cfab99")
COLOURS: Final = len(VEHICLES_LIGHT)
"""Colours of vehicles, ``c0`` to ``c7``; the ninth starts again, with another dash."""
SHARE_STEPS: Final = 20
"""A bar behind a share is drawn in this many steps, ``b0`` to ``b20``."""


def _colours(colours: Mapping[str, Rgb], vehicles: tuple[str, ...]) -> str:
    tokens = "".join(f"--{name.replace(' ', '-')}:#{r:02x}{g:02x}{b:02x};" for name, (r, g, b) in colours.items())
    return f":root{{{tokens}}}" + "".join(f".c{k}{{color:{colour}}}" for k, colour in enumerate(vehicles))


STYLE: Final = (
    ":root{color-scheme:light dark}"
    + _colours(LIGHT, VEHICLES_LIGHT)
    + "".join(f".b{k}{{--share:{100 * k // SHARE_STEPS}%}}" for k in range(SHARE_STEPS + 1))
    + """
*{box-sizing:border-box}
html{scroll-padding-top:1rem}
body{margin:0 auto;max-width:1160px;padding:1.4rem 1.2rem 3rem;background:var(--panel);color:var(--ink);
font:16px/1.5 system-ui,"Segoe UI",Roboto,"Liberation Sans",sans-serif;overflow-wrap:break-word}
h1{font-size:1.6rem;line-height:1.2;margin:0}
h2{font-size:1.2rem;line-height:1.3;margin:2.2rem 0 .6rem}h3{font-size:1rem;margin:0 0 .4rem}
p{margin:.3rem 0;max-width:80ch}ul{margin:.3rem 0;padding:0;list-style:none}
section>ul{padding-left:1.1rem;list-style:disc}
a{color:var(--accent)}a:focus-visible,.wide:focus-visible{outline:2px solid var(--accent);outline-offset:2px}
.soft{color:var(--faint)}.bad{color:var(--no-position)}.warn,.tentative{color:var(--tentative)}
.good,.confirmed{color:var(--confirmed)}.never{color:var(--unidentified)}
nav{display:flex;flex-wrap:wrap;gap:.2rem 1.1rem;margin:1rem 0 0;font-size:.9rem}
.cards{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(100%,19rem),1fr));gap:.9rem;margin:1rem 0}
.card,article{background:var(--head);border-radius:6px;padding:.8rem 1rem}
.card{border-top:4px solid var(--line)}.card.good{border-color:var(--confirmed)}
.card.warn{border-color:var(--tentative)}.card.bad{border-color:var(--no-position)}
.card,.card li{color:var(--ink)}.card h2{margin:0;font-size:.9rem;color:var(--faint);font-weight:600}
.card .sum{font-size:1.15rem;line-height:1.3;font-weight:600;margin:.1rem 0 .5rem}.card .sum strong{font-size:2rem}
.card li{margin:.25rem 0;padding-left:1.1rem;position:relative;font-size:.92rem;line-height:1.4}
.card li::before{content:"";position:absolute;left:0;top:.42em;width:.6rem;height:.6rem;border-radius:50%;
background:var(--faint)}
.card li.confirmed::before{background:var(--confirmed)}.card li.tentative::before{background:var(--tentative)}
.card li.never::before{background:var(--unidentified)}
.card li.bad::before{background:var(--no-position);border-radius:0}
.card li.warn::before{background:var(--tentative);border-radius:0}
/* A shadow on each side on which a table or drawing goes on; words above it where the browser can tell that it does. */
.wide{overflow-x:auto;margin:.5rem 0;--paper:var(--panel);background:
linear-gradient(to right,var(--paper) 30%,transparent) 0/2.5rem 100% no-repeat local,
linear-gradient(to left,var(--paper) 30%,transparent) 100%/2.5rem 100% no-repeat local,
linear-gradient(to right,var(--line),transparent) 0/.7rem 100% no-repeat scroll,
linear-gradient(to left,var(--line),transparent) 100%/.7rem 100% no-repeat scroll}
.wide::before{content:"wider than the screen: scroll sideways →";display:block;position:sticky;left:0;width:max-content;
height:0;overflow:hidden;font-size:.8rem;color:var(--faint)}
@supports (animation-timeline:scroll()){.wide::before{animation:more linear both;animation-timeline:scroll(inline)}}
@keyframes more{from,to{height:1.6em}}
table{border-collapse:collapse;font-size:.9rem;min-width:100%}
th,td{padding:.3rem .9rem .3rem 0;text-align:left;vertical-align:top;border-bottom:1px solid var(--head)}
article th,article td{border-color:var(--panel)}article .wide{--paper:var(--head)}
th{font-weight:600}thead th{white-space:nowrap;color:var(--faint);border-color:var(--line);vertical-align:bottom}
th:first-child{position:sticky;left:0;background:var(--panel);max-width:45vw}
article th:first-child{position:static;background:none}tbody th{min-width:5.5rem}
td:not(.n):is(:last-child,:nth-child(2):not([class])){min-width:13rem}
.confirmed,.tentative,.never{white-space:nowrap}.card li{white-space:normal}
.whole{white-space:nowrap}
td.n,th.n{text-align:right;font-variant-numeric:tabular-nums;white-space:nowrap}
td.share{background:
linear-gradient(to right,var(--confirmed) var(--share),var(--head) 0) 0 100%/calc(100% - .9rem) 3px no-repeat}
td.code{font:.8rem/1.5 ui-monospace,"Liberation Mono",monospace;overflow-wrap:anywhere;min-width:16rem}
svg{display:block;width:100%;height:auto;background:var(--head);border-radius:6px}
svg text{font-size:16px;fill:currentColor}svg text.on{fill:var(--panel)}
svg text.halo{paint-order:stroke;stroke:var(--head);stroke-width:4px;stroke-linejoin:round}
.chart{min-width:720px}.small{max-width:340px}.ink{color:var(--ink)}.rule{stroke:var(--line);stroke-width:.6}
.stills,.parts{display:grid;grid-template-columns:repeat(auto-fill,minmax(min(100%,24rem),1fr));gap:1rem;margin:.5rem 0}
figure{margin:0}figure,article,.card{break-inside:avoid}
figure img{width:100%;height:auto;display:block;border-radius:6px}
figcaption{font-size:.9rem;color:var(--faint)}
@media (prefers-color-scheme:dark){"""
    + _colours(DARK, VEHICLES_DARK)
    + "}@media print{"
    + _colours(LIGHT, VEHICLES_LIGHT)
    + """:root{color-scheme:light;--panel:#fff;--ink:#000}
body{max-width:none;padding:0;font-size:10pt}nav,.wide::before{display:none}h2,h3{break-after:avoid}
tr{break-inside:avoid}.wide{overflow:visible;background:none}svg,img{max-height:230mm}
.cards,.parts{grid-template-columns:1fr 1fr}.card,article{border:1px solid var(--line)}
.parts table{font-size:8pt}.parts th{width:40%}.chart{min-width:0}.small{max-width:80mm}@page{margin:15mm}}
"""
)
