"""Colours by what they are for, in the theme that is in use; every colour also has a word or a mark on screen."""

from __future__ import annotations

from functools import lru_cache
from typing import Final

from rich.color import Color
from rich.style import Style

from gcs.snapshot import Level, Standing
from gcs.tui.themes import DARK, THEMES, Colour, Rgb, Theme

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
    "Colour",
    "count_colour",
    "ink",
    "level_colour",
    "pack",
    "position_colour",
    "standing_colour",
    "use_theme",
]

PANEL: Final = Colour.PANEL
HEAD: Final = Colour.HEAD
PICKED: Final = Colour.PICKED
LINE: Final = Colour.LINE
FAINT: Final = Colour.FAINT
INK: Final = Colour.INK
BRIGHT: Final = Colour.BRIGHT
ACCENT: Final = Colour.ACCENT
GOOD: Final = Colour.CONFIRMED
WARN: Final = Colour.TENTATIVE
ALARM: Final = Colour.NO_POSITION


class _InUse:
    """The theme of this process's one terminal."""

    theme: Theme = DARK


def use_theme(name: str) -> None:
    """All that is drawn from now on is in this theme; what is on screen must be drawn again.

    Args:
        name: One of ``THEMES``.
    """
    _InUse.theme = THEMES[name]


def ink(colour: Colour = INK, paper: Colour = PANEL, *, bold: bool = False) -> Style:
    """A style of one text colour on one background."""
    colours = _InUse.theme.colours
    return _style(colours[colour], colours[paper], bold)


@lru_cache(maxsize=4096)
def _style(colour: Rgb, paper: Rgb, bold: bool) -> Style:
    return Style(color=Color.from_rgb(*colour), bgcolor=Color.from_rgb(*paper), bold=bold or None)


def pack(colour: Colour, theme: Theme | None = None) -> int:
    """0xRRGGBB of a colour, in the theme in use unless one is given."""
    red, green, blue = (theme or _InUse.theme).colours[colour]
    return red << 16 | green << 8 | blue


def standing_colour(standing: Standing) -> Colour:
    """Colour of how sure an identity is."""
    return Colour(standing)


def count_colour(named: int, total: int) -> Colour:
    """Colour of how many vehicles are confirmed: good when all are, a warning when none is."""
    if not total:
        return INK
    return GOOD if named == total else INK if named else WARN


def position_colour(state: str) -> Colour:
    """Colour of a position's state; an unknown word is shown as a warning."""
    return {"ok": INK, "stale": WARN, "lost": ALARM, "never": FAINT, "refused": ALARM, "contested": ALARM}.get(
        state, WARN
    )


def level_colour(level: Level) -> Colour:
    """Colour of an event's level."""
    return {"info": INK, "warning": WARN, "alarm": ALARM}.get(level, INK)
