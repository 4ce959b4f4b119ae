"""The colours of the screens and the styles made of them; every colour also has a word on screen."""

from __future__ import annotations

from functools import lru_cache
from typing import Final

from rich.color import Color
from rich.style import Style

from gcs.report.overlay import STANDING_RGB
from gcs.snapshot import Level, Standing

__all__ = [
    "ACCENT",
    "ALARM",
    "BRIGHT",
    "FAINT",
    "GOOD",
    "HEAD",
    "INK",
    "LINE",
    "PANEL",
    "PICKED",
    "WARN",
    "Rgb",
    "count_colour",
    "ink",
    "level_colour",
    "position_colour",
    "standing_colour",
]

Rgb = tuple[int, int, int]

PANEL: Final[Rgb] = (14, 18, 26)
HEAD: Final[Rgb] = (28, 34, 46)
PICKED: Final[Rgb] = (38, 52, 76)
LINE: Final[Rgb] = (62, 72, 92)
FAINT: Final[Rgb] = (112, 122, 142)
INK: Final[Rgb] = (198, 206, 220)
BRIGHT: Final[Rgb] = (240, 244, 250)
ACCENT: Final[Rgb] = (110, 190, 255)
GOOD: Final[Rgb] = STANDING_RGB["confirmed"]
WARN: Final[Rgb] = STANDING_RGB["tentative"]
ALARM: Final[Rgb] = STANDING_RGB["no position"]


@lru_cache(maxsize=4096)
def ink(colour: Rgb = INK, paper: Rgb = PANEL, *, bold: bool = False) -> Style:
    """A style of one text colour on one background."""
    return Style(color=Color.from_rgb(*colour), bgcolor=Color.from_rgb(*paper), bold=bold or None)


def standing_colour(standing: Standing) -> Rgb:
    """Colour of how sure an identity is."""
    return STANDING_RGB.get(standing, INK)


def count_colour(named: int, total: int) -> Rgb:
    """Colour of how many vehicles are confirmed: good when all are, a warning when none is."""
    if not total:
        return INK
    return GOOD if named == total else INK if named else WARN


def position_colour(state: str) -> Rgb:
    """Colour of a position's state; an unknown word is shown as a warning."""
    return {"ok": INK, "stale": WARN, "lost": ALARM, "never": FAINT, "refused": ALARM, "contested": ALARM}.get(
        state, WARN
    )


def level_colour(level: Level) -> Rgb:
    """Colour of an event's level."""
    return {"info": INK, "warning": WARN, "alarm": ALARM}.get(level, INK)
