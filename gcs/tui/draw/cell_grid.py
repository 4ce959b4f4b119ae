"""A grid of coloured cells on numpy arrays, and its quick way to strips."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from rich.cells import cell_len
from rich.color import Color
from rich.segment import Segment
from rich.style import Style
from textual.strip import Strip

from gcs.tui.draw.braille import BrailleCanvas

__all__ = ["CellGrid"]

HALF = ord("▀")
CACHE_SIZE = 24_576


class CellGrid:
    """Letter, ink and paper of every cell."""

    def __init__(self, columns: int, rows: int, paper: int) -> None:
        self.columns, self.rows = columns, rows
        self.letter: NDArray[np.int64] = np.full((rows, columns), ord(" "), dtype=np.int64)
        self.ink: NDArray[np.int64] = np.full((rows, columns), paper, dtype=np.int64)
        self.paper: NDArray[np.int64] = np.full((rows, columns), paper, dtype=np.int64)

    def image(self, pixels: NDArray[np.int64], left: int, top: int) -> None:
        """Put (2·rows, columns) packed pixels as half blocks, two above each other in a cell."""
        rows, columns = pixels.shape[0] // 2, pixels.shape[1]
        window = np.s_[top : top + rows, left : left + columns]
        self.letter[window] = HALF
        self.ink[window] = pixels[0::2]
        self.paper[window] = pixels[1::2]

    def dots(self, dots: BrailleCanvas) -> None:
        """Lay braille over the cells; half blocks below become the darkened mean of their two pixels."""
        at = dots.bits > 0
        under = at & (self.letter == HALF)
        mean = _mean(self.ink[under], self.paper[under])
        # half as bright as the image, so that the line is visible on busy ground
        self.paper[under] = _mean(mean, np.zeros_like(mean))
        self.letter[at] = 0x2800 + dots.bits[at]
        self.ink[at] = dots.ink[at]

    def text(self, x: int, y: int, text: str, ink: int, paper: int | None = None) -> None:
        """Write text, cut at the edges; double-width letters are shown as ``·`` so that the grid holds."""
        if not 0 <= y < self.rows:
            return
        for at, letter in enumerate(text, start=x):
            if 0 <= at < self.columns:
                self.letter[y, at] = ord(letter) if cell_len(letter) == 1 else ord("·")
                self.ink[y, at] = ink
                if paper is not None:
                    self.paper[y, at] = paper

    def strips(self) -> list[Strip]:
        """One strip per row; equal neighbours share a segment."""
        looks = self.ink << 24 | self.paper
        rows = zip(self.letter.tolist(), looks.tolist(), strict=True)
        return [Strip(_segments(letters, row), self.columns) for letters, row in rows]


def _mean(a: NDArray[np.int64], b: NDArray[np.int64]) -> NDArray[np.int64]:
    # (a + b) / 2 per byte without carry between bytes
    return (a & b) + (((a ^ b) & 0xFEFEFE) >> 1)


class _Looks(dict[int, Segment]):
    """Half-block segments by packed ink and paper, bounded: a new Rich style costs 5 µs, a look-up 0.05 µs."""

    def __missing__(self, look: int) -> Segment:
        if len(self) >= CACHE_SIZE:
            self.clear()
        ink, paper = look >> 24, look & 0xFFFFFF
        style = Style.from_color(_colour(ink), _colour(paper))
        self[look] = segment = Segment("▀", style)
        return segment


@lru_cache(maxsize=4096)
def _colour(packed: int) -> Color:
    return Color.from_rgb(packed >> 16, packed >> 8 & 255, packed & 255)


_LOOKS = _Looks()


def _segments(letters: list[int], looks: list[int]) -> list[Segment]:
    segments: list[Segment] = []
    start, end = 0, len(letters)
    while start < end:
        look = looks[start]
        stop = start + 1
        while stop < end and looks[stop] == look:
            stop += 1
        known = _LOOKS[look]
        if stop == start + 1 and letters[start] == HALF:
            segments.append(known)
        else:
            segments.append(Segment("".join(map(chr, letters[start:stop])), known.style))
        start = stop
    return segments
