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
    """Bits and inks of a grid of cells; coordinates in dots, x right, y down, outside is cut off."""

    def __init__(self, columns: int, rows: int) -> None:
        self.columns, self.rows = columns, rows
        self.bits: NDArray[np.int64] = np.zeros((rows, columns), dtype=np.int64)
        """(rows, columns) braille pattern, 0 where nothing is drawn."""
        self.ink: NDArray[np.int64] = np.zeros((rows, columns), dtype=np.int64)
        """(rows, columns) packed 0xRRGGBB of the last thing drawn there."""

    def points(self, xy: NDArray[np.float64], inks: Inks) -> None:
        """Set dots at (k, 2) positions, later ones over earlier ones; NaN and far ones are skipped."""
        x, y = xy[:, 0], xy[:, 1]
        seen = (x >= 0) & (y >= 0) & (x < 2 * self.columns) & (y < 4 * self.rows)
        x, y = xy[seen].astype(np.int64).T
        at = y >> 2, x >> 1
        np.bitwise_or.at(self.bits, at, BITS[y & 3, x & 1])
        self.ink[at] = inks if isinstance(inks, int) else inks[seen]

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
        known = (np.abs(np.hstack([start, end])) < FARTHEST).all(axis=1)
        keep = np.asarray(known, dtype=np.bool_)
        step = end[keep] - start[keep]
        enter, leave = self._inside(start[keep], step)
        inside = enter <= leave
        keep[keep] = inside
        enter, leave, step = enter[inside, None], leave[inside, None], step[inside]
        start, step = start[keep] + enter * step, (leave - enter) * step
        every = every if isinstance(every, float) else every[keep]
        counts = np.clip(np.ceil(np.abs(step).max(axis=1, initial=0.0) / every), 1, LONGEST).astype(np.int64)
        which, at = _spread(counts + 1)
        # p = a + (b − a) k / n
        dots = start[which] + at[:, None] * (step / counts[:, None])[which]
        self.points(dots, inks if isinstance(inks, int) else inks[keep][which])

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
