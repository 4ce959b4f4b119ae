"""The cells of a picture that are taken by texts and marks. Units as for ``gcs.report.labels``."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Final

Cells = tuple[int, int, int, int]
"""Rectangle of cells: left, top, width, height."""
Measure = Callable[[str], tuple[int, int]]
"""Width and height of a text."""

COVER_COST: Final = 8.0
"""Cost of a label that lies wholly on boxes: it rather goes four steps away."""
CROSSING_COST: Final = 8.0
"""Cost of a line to the mark that runs under another label or mark."""
NEAR: Final = 0.5
"""Steps between a text and its mark across which the eye joins them."""
MARK_GAP: Final = 1
"""Cells between a text and the mark of another, so that it is not read as its letter."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Grid:
    """Grid that labels are placed in, with what they must keep clear of."""

    columns: int
    rows: int
    measure: Measure
    step: tuple[int, int] = (2, 1)
    """Across and down, how much farther each ring of places is."""
    gap: int = 2
    """Cells between two texts in a row, so that they are not read as one."""
    blocked: tuple[Cells, ...] = ()
    """Areas in which something else is written."""
    covered: bool = False
    """Marks may be covered where there is no better place: boxes are larger than their labels."""


def line_between(rect: Cells, anchor: Cells) -> tuple[float, float, float, float]:
    """Return the line from a text to its mark: x and y of the nearest point of the text's middle row, and of the
    ellipse in the mark, since a box that is turned does not reach its corners."""
    left, top, width, height = rect
    x, y, w, h = anchor
    centre_x, centre_y = x + w / 2, y + h / 2
    start_x, start_y = min(max(centre_x, left), left + width), top + height / 2
    across, down = start_x - centre_x, start_y - centre_y
    # (x / a)² + (y / b)² = 1
    outside = math.hypot(2 * across / w, 2 * down / h)
    if max(w, h) == 1 or outside <= 1:
        return start_x, start_y, centre_x, centre_y
    return start_x, start_y, centre_x + across / outside, centre_y + down / outside


def needs_line(rect: Cells, anchor: Cells, step: tuple[int, int]) -> bool:
    """Tell whether a text is so far from its mark that a line must tell whose it is."""
    left, top, width, height = rect
    _, _, x, y = line_between(rect, anchor)
    across, down = max(left - x, x - left - width, 0.0), max(top - y, y - top - height, 0.0)
    return across > NEAR * step[0] or down > NEAR * step[1]


class Occupied:
    """The cells that are taken, as one whole number of bits for each row."""

    def __init__(self, grid: Grid, anchors: Sequence[Cells], marks: Sequence[Cells]) -> None:
        self.grid = grid
        self._taken = [0] * grid.rows
        self._marks = [0] * grid.rows
        for rect in grid.blocked:
            self._fill(self._taken, rect)
        for rect in (*anchors, *marks):
            self._fill(self._marks, rect)

    def take(self, rect: Cells) -> None:
        """Keep others off from now on."""
        self._fill(self._taken, rect)

    def release(self, rect: Cells) -> None:
        """Let others have it again."""
        for row in range(rect[1], rect[1] + rect[3]):
            self._taken[row] &= ~_bits(rect, row)

    def take_first(self, text: str, rows: Iterable[int]) -> Cells | None:
        """The leftmost place for a text in the first of these rows that has one."""
        width, height = self.grid.measure(text)
        columns, gap = self.grid.columns, self.grid.gap
        for top in rows:
            taken = 0
            for row in range(max(0, top), min(self.grid.rows, top + height)):
                taken |= self._taken[row] | (0 if self.grid.covered else self._marks[row])
            # beyond the edges nothing is in the way
            free = ~taken << gap | (1 << gap) - 1
            length, needed = 1, width + 2 * gap
            while length < needed:
                step = min(length, needed - length)
                free &= free >> step
                length += step
            left = (free & -free).bit_length() - 1
            if 0 <= left <= columns - width and 0 <= top <= self.grid.rows - height:
                self.take((left, top, width, height))
                return left, top, width, height
        return None

    def fits(self, rect: Cells, own: Cells | None = None, margin: int = 0) -> bool:
        """Tell whether a text there is whole and covers no other text, and no mark where those must stay visible."""
        left, top, width, height = rect
        if left < 0 or top < 0 or left + width > self.grid.columns or top + height > self.grid.rows:
            return False
        gap = self.grid.gap + margin
        wide = _bits((left - gap, top, width + 2 * gap, 1), top)
        for row in range(max(0, top - margin), min(self.grid.rows, top + height + margin)):
            if self._taken[row] & wide:
                return False
        if self.grid.covered:
            return True
        wide = _bits((left - MARK_GAP, top, width + 2 * MARK_GAP, 1), top)
        bits = _bits((left, top, width, 1), top)
        for row in range(top, top + height):
            mine = _bits(own, row) if own else 0
            if self._marks[row] & wide & ~mine or mine & bits:
                return False
        return True

    def _share_covered(self, rect: Cells) -> float:
        """Share of a text that lies on marks."""
        _, top, width, height = rect
        bits = _bits(rect, top)
        return sum((self._marks[row] & bits).bit_count() for row in range(top, top + height)) / (width * height)

    def nuisance(self, rect: Cells, anchor: Cells) -> float:
        """Cost of a place beside its distance: what it covers, and whether the line to its mark is cut."""
        cost = COVER_COST * self._share_covered(rect) if self.grid.covered else 0.0
        line = needs_line(rect, anchor, self.grid.step)
        return cost + CROSSING_COST if line and self._cuts_line(rect, anchor) else cost

    def _cuts_line(self, rect: Cells, anchor: Cells) -> bool:
        """Tell whether the line from a label to its mark runs under another label or mark."""
        x, y, end_x, end_y = line_between(rect, anchor)
        count = 2 + int(max(abs(end_x - x), abs(end_y - y)))
        for at in range(1, count):
            column, row = int(x + (end_x - x) * at / count), int(y + (end_y - y) * at / count)
            if not (0 <= column < self.grid.columns and 0 <= row < self.grid.rows):
                continue
            taken = self._taken[row]
            if not self.grid.covered:
                taken |= self._marks[row] & ~_bits(anchor, row)
            if taken >> column & 1 and not _bits(rect, row) >> column & 1:
                return True
        return False

    def _fill(self, rows: list[int], rect: Cells) -> None:
        top, height = rect[1], rect[3]
        for row in range(max(0, top), min(self.grid.rows, top + height)):
            rows[row] |= _bits(rect, row)


def _bits(rect: Cells, row: int) -> int:
    left, top, width, height = rect
    if not top <= row < top + height:
        return 0
    right = left + width
    left = max(0, left)
    return ((1 << (right - left)) - 1) << left if right > left else 0
