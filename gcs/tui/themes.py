"""The themes of the screens: one table of colours each, distinct to colour-blind eyes too. Pure.

Every text colour has a contrast of at least 4.5 (WCAG 2.2, level AA) on every background, 7 (AAA) with high contrast.
So it has on terminals of 256 and 16 colours, whose numbers a theme has where the nearest would be worse.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from types import MappingProxyType
from typing import Final, Literal

from textual.theme import Theme as TextualTheme

from gcs.report.overlay import STANDING_RGB
from gcs.report.page.style import DARK as PAGES_DARK
from gcs.report.page.style import LIGHT as PAGES_LIGHT
from gcs.tui.draw.xterm_palette import nearest

Depth = Literal["truecolor", "256", "standard"]
"""Number of colours that the terminal has, in Rich's words: all, 256, or the sixteen that its user has chosen."""

Rgb = tuple[int, int, int]
ThemeName = Literal["dark", "light", "high-contrast"]


class Colour(StrEnum):
    """Use of a colour; a theme has what it looks like."""

    GAP = "gap"
    """Gap between panes."""
    PANEL = "panel"
    HEAD = "head"
    """Behind headings, status and time line."""
    PICKED = "picked"
    """Behind what is selected."""
    ALARM_TINT = "alarm tint"
    """Behind the row of what has an alarm."""
    WARN_TINT = "warning tint"
    LINE = "line"
    """Thin lines that are no text."""
    FAINT = "faint"
    INK = "ink"
    BRIGHT = "bright"
    ACCENT = "accent"
    """Keys, focus, the UAV."""
    CONFIRMED = "confirmed"
    TENTATIVE = "tentative"
    COASTING = "coasting"
    UNIDENTIFIED = "unidentified"
    OUT_OF_VIEW = "out of view"
    NO_POSITION = "no position"
    MISPLACED = "misplaced"
    NO_NEW_FRAME = "no new frame"


@dataclass(frozen=True, slots=True, kw_only=True)
class Theme:
    """A look of all screens."""

    name: ThemeName
    dark: bool
    colours: Mapping[Colour, Rgb]
    """Every colour's red, green and blue, 0..255."""
    palette: Mapping[Colour, int] = field(default_factory=dict)
    """Numbers, 16 to 255, of those of the 256 colours that the nearest one does not stand for."""

    def number(self, colour: Colour, depth: Depth) -> int:
        """The colour of the terminal's 256 or 16 that stands for a colour."""
        if depth == "standard":
            return (_DARK_SIXTEEN if self.dark else _LIGHT_SIXTEEN).get(colour, 0 if self.dark else 15)
        red, green, blue = self.colours[colour]
        return self.palette.get(colour) or nearest(red << 16 | green << 8 | blue)


_DARK_SIXTEEN: Final[Mapping[Colour, int]] = MappingProxyType(
    {
        Colour.PICKED: 7,
        Colour.LINE: 8,
        Colour.FAINT: 7,
        Colour.INK: 15,
        Colour.BRIGHT: 15,
        Colour.ACCENT: 14,
        Colour.CONFIRMED: 10,
        Colour.TENTATIVE: 11,
        Colour.COASTING: 6,
        Colour.UNIDENTIFIED: 13,
        Colour.OUT_OF_VIEW: 7,
        Colour.NO_POSITION: 9,
        Colour.MISPLACED: 9,
        Colour.NO_NEW_FRAME: 15,
    }
)
"""Sixteen colours on black, which all other backgrounds are too."""
_LIGHT_SIXTEEN: Final[Mapping[Colour, int]] = MappingProxyType(
    {
        **dict.fromkeys((Colour.FAINT, Colour.INK, Colour.BRIGHT, Colour.OUT_OF_VIEW, Colour.NO_NEW_FRAME), 0),
        Colour.PICKED: 7,
        Colour.GAP: 7,
        Colour.LINE: 8,
        Colour.ACCENT: 4,
        Colour.CONFIRMED: 4,
        Colour.TENTATIVE: 5,
        Colour.COASTING: 4,
        Colour.UNIDENTIFIED: 5,
        Colour.NO_POSITION: 1,
        Colour.MISPLACED: 1,
    }
)
"""Sixteen colours on white, on which no other of the sixteen can be read: marks and words tell what colours cannot."""


def _theme(
    name: ThemeName, colours: Mapping[Colour, Rgb], *, dark: bool = True, palette: Mapping[Colour, int] | None = None
) -> Theme:
    return Theme(
        name=name, dark=dark, colours=MappingProxyType(dict(colours)), palette=MappingProxyType(dict(palette or {}))
    )


DARK: Final = _theme(
    "dark",
    {
        Colour.GAP: (6, 8, 12),
        Colour.PICKED: (34, 46, 70),
        Colour.ALARM_TINT: (62, 22, 26),
        Colour.WARN_TINT: (48, 38, 12),
        Colour.BRIGHT: (244, 247, 252),
        **{Colour(name): rgb for name, rgb in PAGES_DARK.items()},
        **{Colour(standing): rgb for standing, rgb in STANDING_RGB.items()},
    },
    palette={Colour.LINE: 244, Colour.PICKED: 17, Colour.ALARM_TINT: 52},
)
"""Theme in the colours of pages and of the exported video."""

LIGHT: Final = _theme(
    "light",
    {
        **{Colour(name): rgb for name, rgb in PAGES_LIGHT.items()},
        Colour.GAP: (198, 204, 214),
        Colour.PICKED: (214, 226, 246),
        Colour.ALARM_TINT: (255, 226, 222),
        Colour.WARN_TINT: (255, 242, 204),
        Colour.BRIGHT: (0, 0, 0),
        Colour.COASTING: (8, 0, 205),
        Colour.OUT_OF_VIEW: (53, 60, 70),
        Colour.MISPLACED: (127, 6, 2),
        Colour.NO_NEW_FRAME: (0, 7, 21),
    },
    dark=False,
    palette={Colour.TENTATIVE: 58},
)

HIGH_CONTRAST: Final = _theme(
    "high-contrast",
    {
        Colour.GAP: (64, 64, 64),
        Colour.PANEL: (0, 0, 0),
        Colour.HEAD: (22, 22, 22),
        Colour.PICKED: (0, 0, 96),
        Colour.ALARM_TINT: (52, 0, 0),
        Colour.WARN_TINT: (28, 22, 0),
        Colour.LINE: (140, 148, 160),
        Colour.FAINT: (196, 200, 208),
        Colour.INK: (234, 238, 244),
        Colour.BRIGHT: (255, 255, 255),
        Colour.ACCENT: (130, 205, 255),
        Colour.CONFIRMED: (150, 255, 130),
        Colour.TENTATIVE: (240, 190, 20),
        Colour.COASTING: (125, 175, 255),
        Colour.UNIDENTIFIED: (255, 190, 255),
        Colour.OUT_OF_VIEW: (176, 182, 194),
        Colour.NO_POSITION: (255, 125, 105),
        Colour.MISPLACED: (255, 125, 105),
        Colour.NO_NEW_FRAME: (255, 255, 255),
    },
)

THEMES: Final[Mapping[str, Theme]] = MappingProxyType({theme.name: theme for theme in (DARK, LIGHT, HIGH_CONTRAST)})


def next_theme(name: str) -> str:
    """Dark, light, high contrast, dark …"""
    names = list(THEMES)
    return names[(names.index(name) + 1) % len(names)]


def hex_of(rgb: Rgb) -> str:
    """``#rrggbb``."""
    return "#{:02x}{:02x}{:02x}".format(*rgb)


def textual_theme(theme: Theme) -> TextualTheme:
    """Return the theme for Textual's own widgets and style sheets."""
    colours = {colour: hex_of(rgb) for colour, rgb in theme.colours.items()}
    return TextualTheme(
        name=theme.name,
        dark=theme.dark,
        primary=colours[Colour.ACCENT],
        accent=colours[Colour.ACCENT],
        secondary=colours[Colour.COASTING],
        warning=colours[Colour.TENTATIVE],
        error=colours[Colour.NO_POSITION],
        success=colours[Colour.CONFIRMED],
        foreground=colours[Colour.INK],
        background=colours[Colour.GAP],
        surface=colours[Colour.PANEL],
        panel=colours[Colour.HEAD],
        variables={
            "block-cursor-background": colours[Colour.PICKED],
            "block-cursor-foreground": colours[Colour.BRIGHT],
            "block-cursor-blurred-background": colours[Colour.PICKED],
            "block-cursor-blurred-foreground": colours[Colour.BRIGHT],
            "text-muted": colours[Colour.FAINT],
            "scrollbar": colours[Colour.LINE],
            "scrollbar-background": colours[Colour.HEAD],
            "scrollbar-corner-color": colours[Colour.HEAD],
        },
    )
