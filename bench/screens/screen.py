"""What is on a screen: letters and their colours, read from the terminal's side, and where each pane is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from rich.cells import cell_len
from rich.style import Style
from textual.app import App

from gcs.tui.panes.pane import Pane

Rect = tuple[int, int, int, int]
"""Left, top, width, height in cells."""
NO_COLOUR = -1


@dataclass(frozen=True, slots=True, kw_only=True)
class Screen:
    """One picture of the terminal."""

    rows: tuple[str, ...]
    """A letter a cell; a wide letter is followed by a NUL."""
    ink: NDArray[np.int64]
    """(rows, columns) 0xRRGGBB of the letter, -1 the terminal's own."""
    paper: NDArray[np.int64]
    """(rows, columns) 0xRRGGBB behind it."""
    panes: Mapping[str, Rect]
    """Those on the screen, by name."""

    @property
    def width(self) -> int:
        """Columns."""
        return len(self.rows[0])

    def pane_rows(self, pane: str) -> list[str]:
        """The text of a pane, heading first; empty where it is not on the screen."""
        if pane not in self.panes:
            return []
        left, top, width, height = self.panes[pane]
        return [row[left : left + width].replace("\0", "") for row in self.rows[top : top + height]]

    def __str__(self) -> str:
        return "\n".join(row.replace("\0", "").rstrip() for row in self.rows)


def read_screen(app: App[None]) -> Screen:
    """The screen of a running app as its terminal gets it."""
    lines = app.screen._compositor.render_strips()
    width, height = app.size
    ink = np.full((height, width), NO_COLOUR, dtype=np.int64)
    paper = np.full((height, width), NO_COLOUR, dtype=np.int64)
    rows = []
    for y, line in enumerate(lines[:height]):
        letters: list[str] = []
        for segment in line:
            start = len(letters)
            if segment.text.isascii() or cell_len(segment.text) == len(segment.text):
                letters += segment.text
            else:
                for letter in segment.text:
                    letters += [letter] + ["\0"] * (cell_len(letter) - 1)
            ink[y, start : len(letters)], paper[y, start : len(letters)] = _colours(segment.style)
        rows.append("".join(letters)[:width].ljust(width))
    panes = {
        str(pane.id): (pane.region.x, pane.region.y, pane.region.width, pane.region.height)
        for pane in app.query(Pane)
        if pane.display and pane.region.area
    }
    return Screen(rows=tuple(rows), ink=ink, paper=paper, panes=panes)


def _colours(style: Style | None) -> tuple[int, int]:
    if style is None:
        return NO_COLOUR, NO_COLOUR
    colours = []
    for colour in (style.color, style.bgcolor):
        triplet = colour.triplet if colour is not None else None
        colours.append(NO_COLOUR if triplet is None else triplet.red << 16 | triplet.green << 8 | triplet.blue)
    return (colours[1], colours[0]) if style.reverse else (colours[0], colours[1])


def contrast(ink: int, paper: int) -> float:
    """Contrast of two colours 0xRRGGBB after WCAG 2: 1 none, 21 black on white."""
    low, high = sorted((_luminance(ink), _luminance(paper)))
    return (high + 0.05) / (low + 0.05)


def _luminance(colour: int) -> float:
    # L = 0.2126 R + 0.7152 G + 0.0722 B of linear parts
    parts = [(colour >> shift & 255) / 255 for shift in (16, 8, 0)]
    linear = [part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]
