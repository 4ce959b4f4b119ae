"""Colours by what they are for, in the theme that is in use; every colour also has a word or a mark on screen."""

from __future__ import annotations

from functools import cache, lru_cache
from typing import Final

from rich.color import Color
from rich.style import Style

from gcs.snapshot import Snapshot, Standing
from gcs.tui.draw.xterm_palette import nearest, nearest_of_sixteen
from gcs.tui.themes import DARK, THEMES, Colour, Depth, Theme
from mavlink.state import Level

PANEL: Final = Colour.PANEL
HEAD: Final = Colour.HEAD
PICKED: Final = Colour.PICKED
ALARM_TINT: Final = Colour.ALARM_TINT
WARN_TINT: Final = Colour.WARN_TINT
LINE: Final = Colour.LINE
FAINT: Final = Colour.FAINT
INK: Final = Colour.INK
BRIGHT: Final = Colour.BRIGHT
ACCENT: Final = Colour.ACCENT
GOOD: Final = Colour.CONFIRMED
WARN: Final = Colour.TENTATIVE
ALARM: Final = Colour.NO_POSITION


class _InUse:
    """The theme of this process's one terminal, and how many colours that has."""

    theme: Theme = DARK
    depth: Depth = "truecolor"


def use_theme(name: str) -> None:
    """Set the theme of all that is drawn from now on; what is on screen must be drawn again."""
    _InUse.theme = THEMES[name]


def use_depth(depth: Depth) -> None:
    """Set the number of colours of all that is drawn from now on."""
    _InUse.depth = depth


def depth_in_use() -> Depth:
    """Number of colours that the terminal has."""
    return _InUse.depth


def ink(colour: Colour = INK, paper: Colour = PANEL, *, bold: bool = False) -> Style:
    """A style of one text colour on one background."""
    return _style(_InUse.theme.name, _InUse.depth, colour, paper, bold)


@lru_cache(maxsize=4096)
def _style(theme: str, depth: Depth, colour: Colour, paper: Colour, bold: bool) -> Style:
    if depth == "standard" and paper is PICKED:  # no colour of the sixteen can be read on any other than black or white
        return Style(color=Color.from_ansi(0), bgcolor=Color.from_ansi(7), bold=bold or None)
    letters, behind = (_colour(THEMES[theme], each, depth) for each in (colour, paper))
    return Style(color=letters, bgcolor=behind, bold=bold or None)


def _colour(theme: Theme, colour: Colour, depth: Depth) -> Color:
    if depth == "truecolor":
        return Color.from_rgb(*theme.colours[colour])
    return Color.from_ansi(theme.number(colour, depth))


@lru_cache(maxsize=4096)
def terminal_colour(packed: int, depth: Depth) -> Color:
    """The terminal's colour for 0xRRGGBB: the theme's own where it is one of a theme, else the nearest."""
    if depth == "truecolor":
        return Color.from_rgb(packed >> 16, packed >> 8 & 255, packed & 255)
    known = _numbers(depth).get(packed)
    if known is None:
        known = nearest(packed) if depth == "256" else nearest_of_sixteen(packed)
    return Color.from_ansi(known)


@cache
def _numbers(depth: Depth) -> dict[int, int]:
    """Numbers of all colours of the themes, of which the dark one's come last: pictures are in it."""
    themes = sorted(THEMES.values(), key=lambda theme: theme is DARK)
    return {pack(colour, theme): theme.number(colour, depth) for theme in themes for colour in Colour}


def pack(colour: Colour, theme: Theme | None = None) -> int:
    """0xRRGGBB of a colour, in the theme in use unless one is given."""
    red, green, blue = (theme or _InUse.theme).colours[colour]
    return red << 16 | green << 8 | blue


def standing_colour(standing: Standing) -> Colour:
    """Colour of how sure an identity is."""
    return Colour(standing)


def vehicle_colours(snapshot: Snapshot) -> dict[int, Colour]:
    """Colour of each vehicle, by system id: the UAV's own, an alarm's where nobody is to act on its name, else its
    standing's."""
    doubted = snapshot.doubted
    return {
        row.system_id: ACCENT
        if row.role == "uav"
        else ALARM
        if row.system_id in doubted
        else standing_colour(row.standing)
        for row in snapshot.vehicles
    }


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


def level_tint(level: Level) -> Colour:
    """Background of a row that has something of this level."""
    return {"warning": WARN_TINT, "alarm": ALARM_TINT}.get(level, PANEL)
