"""A grid of coloured cells on numpy arrays, and its quick way to strips."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache, lru_cache, partial
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from rich.cells import cell_len
from rich.color import Color
from rich.segment import Segment
from rich.style import Style
from textual.strip import Strip

from gcs.tui.draw.braille import BrailleCanvas
from gcs.tui.draw.mosaic import HALF, Mosaic
from gcs.tui.palette import depth_in_use, terminal_colour
from gcs.tui.themes import Depth

CACHE_SIZE = 24_576
RESET = "\x1b[0m"


class CellGrid:
    """Grid of cells: the letter of each, its foreground (ink) and its background (paper)."""

    def __init__(self, columns: int, rows: int, paper: int, *, depth: Depth | None = None) -> None:
        """Make an empty grid.

        Args:
            columns: Cells.
            rows: Cells.
            paper: 0xRRGGBB.
            depth: Of the terminal's colours; that in use unless given.
        """
        self.columns, self.rows = columns, rows
        self._depth: Depth = depth or depth_in_use()
        self._pictured: NDArray[np.bool_] = np.zeros((rows, columns), dtype=np.bool_)
        self.letter: NDArray[np.int64] = np.full((rows, columns), ord(" "), dtype=np.int64)
        self.ink: NDArray[np.int64] = np.full((rows, columns), paper, dtype=np.int64)
        self.paper: NDArray[np.int64] = np.full((rows, columns), paper, dtype=np.int64)

    def picture(self, mosaic: Mosaic, left: int, top: int) -> None:
        """Put an image's cells with their corner at a place."""
        rows, columns = mosaic.letter.shape
        window = np.s_[top : top + rows, left : left + columns]
        self.letter[window], self.ink[window], self.paper[window] = mosaic.letter, mosaic.ink, mosaic.paper
        self._pictured[window] = True

    def place(self, window: CellGrid, left: int, top: int) -> None:
        """Put another grid's cells over these, with its corner at a place; all of it must be inside."""
        at = np.s_[top : top + window.rows, left : left + window.columns]
        self.letter[at], self.ink[at], self.paper[at] = window.letter, window.ink, window.paper
        self._pictured[at] = window._pictured

    def dots(self, dots: BrailleCanvas) -> None:
        """Lay braille over the cells; those of a picture become the darkened mean of their two colours."""
        at = dots.bits > 0
        under = at & self._pictured
        self._pictured &= ~at
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
        """One strip per row."""
        looks, known = self.ink << 24 | self.paper, _looks_in(self._depth)
        rows = zip(self.letter, looks, _ansi_of(self.letter, self.ink, self.paper, self._depth), strict=True)
        return [CellRow(letters, row, known, rendered) for letters, row, rendered in rows]


def _mean(a: NDArray[np.int64], b: NDArray[np.int64]) -> NDArray[np.int64]:
    # (a + b) / 2 per byte without carry between bytes
    return (a & b) + (((a ^ b) & 0xFEFEFE) >> 1)


Cells = NDArray[np.int64]


def _ansi_of(letter: Cells, ink: Cells, paper: Cells, depth: Depth) -> list[str]:
    """Each row as a terminal gets it: a colour only where it is another than in the cell before."""
    colours, number = np.unique(np.stack([ink, paper]), return_inverse=True)
    number = number.reshape(2, *ink.shape)
    other = np.ones(number.shape, dtype=np.bool_)
    np.not_equal(number[..., 1:], number[..., :-1], out=other[..., 1:])
    inks, papers = (
        _padded([_code(colour, depth, foreground) for colour in colours.tolist()]) for foreground in (True, False)
    )
    letters, letter_number = np.unique(letter, return_inverse=True)
    cells = np.concatenate(
        [
            inks[number[0]] * other[0, ..., None],
            papers[number[1]] * other[1, ..., None],
            _padded([chr(each).encode() for each in letters.tolist()])[letter_number.reshape(letter.shape)],
        ],
        axis=-1,
    ).reshape(len(letter), -1)
    shown = cells[cells > 0].tobytes()
    ends = np.cumsum(np.count_nonzero(cells, axis=1)).tolist()
    return [f"{shown[start:end].decode()}{RESET}" for start, end in pairwise([0, *ends])]


@lru_cache(maxsize=CACHE_SIZE)
def _code(packed: int, depth: Depth, foreground: bool) -> bytes:
    return f"\x1b[{';'.join(terminal_colour(packed, depth).get_ansi_codes(foreground))}m".encode()


def _padded(texts: Sequence[bytes]) -> NDArray[np.uint8]:
    """(n, bytes of the longest), the shorter ones followed by zeros."""
    return np.array(texts).view(np.uint8).reshape(len(texts), -1)


class CellRow(Strip):
    """A row of a grid, ready for the terminal: its segments, which take longer, are made for those who ask."""

    __slots__ = ("_changes", "_known", "_letters", "_looks", "_made")

    def __init__(self, letters: NDArray[np.int64], looks: NDArray[np.int64], known: _Looks, rendered: str) -> None:
        """Make a row.

        Args:
            letters: (n,) code points.
            looks: (n,) ink and paper.
            known: Segments by letter and look.
            rendered: Control sequences and letters.
        """
        self._made: list[Segment] | None = None
        super().__init__((), len(letters))
        self._letters, self._looks, self._known = letters, looks, known
        self._render_cache = rendered
        self._changes = 0

    def __eq__(self, other: object) -> bool:
        """Rows that the terminal shows alike are alike."""
        return self._render_cache == other._render_cache if isinstance(other, CellRow) else super().__eq__(other)

    __hash__ = None  # type: ignore[assignment]

    @property
    def changes(self) -> int:
        """Number of cells that look other than the cell before, the first among them."""
        if not self._changes:
            self._changes = 1 + int(np.count_nonzero(self._looks[1:] != self._looks[:-1]))
        return self._changes

    @property
    def _segments(self) -> list[Segment]:
        """Segments as Textual has them; equal neighbours share one."""
        if self._made is None:
            self._made = _segments(self._letters.tolist(), self._looks.tolist(), self._known)
        return self._made

    @_segments.setter
    def _segments(self, segments: list[Segment]) -> None:
        self._made = segments or None


class _Looks(dict[int, Segment]):
    """Segments of one letter by letter, ink and paper, bounded: a new Rich style costs 5 µs, a look-up 0.05 µs."""

    def __init__(self, colour: Callable[[int], Color]) -> None:
        super().__init__()
        self._colour = colour

    def __missing__(self, look: int) -> Segment:
        if len(self) >= CACHE_SIZE:
            self.clear()
        letter, ink, paper = look >> 48, look >> 24 & 0xFFFFFF, look & 0xFFFFFF
        if letter == HALF:
            style = Style.from_color(self._colour(ink), self._colour(paper))
        else:  # letters of one look share its style
            style = self[HALF << 48 | look & 0xFFFFFFFFFFFF].style or Style.null()
        self[look] = segment = Segment(chr(letter), style)
        return segment


@cache
def _looks_in(depth: Depth) -> _Looks:
    return _Looks(partial(terminal_colour, depth=depth))


def _segments(letters: list[int], looks: list[int], known: _Looks) -> list[Segment]:
    segments: list[Segment] = []
    start, end = 0, len(letters)
    while start < end:
        look = looks[start]
        stop = start + 1
        while stop < end and looks[stop] == look:
            stop += 1
        if stop == start + 1:
            segments.append(known[letters[start] << 48 | look])
        else:
            segments.append(Segment("".join(map(chr, letters[start:stop])), known[HALF << 48 | look].style))
        start = stop
    return segments
