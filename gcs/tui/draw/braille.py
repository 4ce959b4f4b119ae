"""Braille dots: a grid of 2×4 dots per cell, drawn on with lines and circles, each cell in the last ink used.

Many lines are drawn at once: what NumPy does costs as much for one as for some hundred.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

BITS = np.array([[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]], dtype=np.int64)
LONGEST = 4096
FARTHEST = 1e12
MIN_STEP = 1e-9
"""Extent along an axis, in dots, below which a line is parallel to the edge."""

Inks = int | NDArray[np.int64]
"""Packed 0xRRGGBB of all, or of each."""


class BrailleCanvas:
    """Bits and inks of a grid of cells; coordinates in dots, x right, y down, outside is cut off.

    Lines wait until somebody asks for cells, or draws something else over them.
    """

    def __init__(self, columns: int, rows: int) -> None:
        self.columns, self.rows = columns, rows
        self._bits: NDArray[np.int64] = np.zeros((rows, columns), dtype=np.int64)
        self._ink: NDArray[np.int64] = np.zeros((rows, columns), dtype=np.int64)
        self._waiting: list[tuple[NDArray[np.float64], NDArray[np.int64]]] = []
        """Ends of lines and steps between their dots, (k, 5), with their inks."""

    @property
    def bits(self) -> NDArray[np.int64]:
        """(rows, columns) braille pattern, 0 where nothing is drawn."""
        self._draw_lines()
        return self._bits

    @property
    def ink(self) -> NDArray[np.int64]:
        """(rows, columns) packed 0xRRGGBB of the last thing drawn there."""
        self._draw_lines()
        return self._ink

    def points(self, xy: NDArray[np.float64], inks: Inks) -> None:
        """Set dots at (k, 2) positions, later ones over earlier ones; NaN and far ones are skipped."""
        self._draw_lines()
        self._set(xy, inks)

    def _set(self, xy: NDArray[np.float64], inks: Inks) -> None:
        x, y = xy[:, 0], xy[:, 1]
        seen = (x >= 0) & (y >= 0) & (x < 2 * self.columns) & (y < 4 * self.rows)
        x, y = xy[seen].astype(np.int64).T
        at = y >> 2, x >> 1
        np.bitwise_or.at(self._bits, at, BITS[y & 3, x & 1])
        self._ink[at] = inks if isinstance(inks, int) else inks[seen]

    def line(self, start: NDArray[np.float64], end: NDArray[np.float64], ink: int, every: float = 1.0) -> None:
        """A straight line; ``every`` above 1 leaves gaps between dots."""
        self.lines(start[None], end[None], ink, every)

    def lines(
        self,
        start: NDArray[np.float64],
        end: NDArray[np.float64],
        inks: Inks,
        every: float | NDArray[np.float64] = 1.0,
    ) -> None:
        """Straight lines, as far as they are inside the grid; later ones over earlier ones.

        Args:
            start: (k, 2) dots; a line with an end that is unknown, or beyond all sense, is left out.
            end: (k, 2) dots.
            inks: of all, or (k,).
            every: steps between dots, of all or (k,): above 1 there are gaps.
        """
        count = len(start)
        steps = np.broadcast_to(np.asarray(every, dtype=np.float64), count)
        self._waiting.append(
            (np.column_stack([start, end, steps]), np.broadcast_to(np.asarray(inks, dtype=np.int64), count))
        )

    def _draw_lines(self) -> None:
        if not self._waiting:
            return
        waiting, self._waiting = self._waiting, []
        lines, inks = (np.concatenate(parts) for parts in zip(*waiting, strict=True))
        # far ones are beyond all sense, and NaN is not below anything
        known = (np.abs(lines) < FARTHEST).all(axis=1)
        start, step, every = lines[known, :2], lines[known, 2:4] - lines[known, :2], lines[known, 4]
        enter, leave = self._inside(start, step)
        inside = enter <= leave
        enter, leave, step = enter[inside, None], leave[inside, None], step[inside]
        start, step = start[inside] + enter * step, (leave - enter) * step
        counts = np.clip(np.ceil(np.abs(step).max(axis=1, initial=0.0) / every[inside]), 1, LONGEST).astype(np.int64)
        which, at = _spread(counts + 1)
        # p = a + (b − a) k / n
        self._set(start[which] + at[:, None] * (step / counts[:, None])[which], inks[known][inside][which])

    def _inside(
        self, start: NDArray[np.float64], step: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(k,) shares of lines at which each enters and leaves the grid (Liang–Barsky); enters last: it never does."""
        step = np.where(np.abs(step) < MIN_STEP, MIN_STEP, step)
        low, high = -start / step, ((2.0 * self.columns, 4.0 * self.rows) - start) / step
        return np.minimum(low, high).max(axis=1, initial=0.0), np.maximum(low, high).min(axis=1, initial=1.0)

    def polygon(self, corners: NDArray[np.float64], ink: int, every: float = 1.0) -> None:
        """Draw a closed outline through (k, 2) corners."""
        self.lines(corners, np.roll(corners, -1, axis=0), ink, every)

    def circles(self, centres: NDArray[np.float64], radii: NDArray[np.float64], ink: int) -> None:
        """Circles round (k, 2) centres of (k,) radii; nothing for radii that are unknown or beyond all sense."""
        known = (radii > 0) & (radii < LONGEST)
        centres, radii = centres[known], radii[known]
        counts = np.maximum(8, np.ceil(2 * np.pi * radii)).astype(np.int64)
        which, at = _spread(counts)
        turn = 2 * np.pi * at / counts[which]
        self.points(centres[which] + radii[which, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1), ink)


def _spread(counts: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The line of each dot, where each line has this many, and how many of its dots come before."""
    which = np.repeat(np.arange(len(counts)), counts)
    return which, np.arange(len(which)) - np.repeat(np.cumsum(counts) - counts, counts)
