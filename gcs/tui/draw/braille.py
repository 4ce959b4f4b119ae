"""Braille dots: a grid of 2×4 dots per cell, drawn on with lines and circles, each cell in the last ink used."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

BITS = np.array([[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]], dtype=np.int64)
LONGEST = 4096


class BrailleCanvas:
    """Bits and inks of a grid of cells; coordinates in dots, x right, y down, outside is cut off."""

    def __init__(self, columns: int, rows: int) -> None:
        self.columns, self.rows = columns, rows
        self.bits: NDArray[np.int64] = np.zeros((rows, columns), dtype=np.int64)
        """(rows, columns) braille pattern, 0 where nothing is drawn."""
        self.ink: NDArray[np.int64] = np.zeros((rows, columns), dtype=np.int64)
        """(rows, columns) packed 0xRRGGBB of the last thing drawn there."""

    def points(self, xy: NDArray[np.float64], ink: int) -> None:
        """Set dots at (k, 2) positions; NaN and far ones are skipped."""
        whole = np.floor(xy[np.isfinite(xy).all(axis=1)])
        keep = ((whole >= 0) & (whole < (2 * self.columns, 4 * self.rows))).all(axis=1)
        x, y = whole[keep].astype(np.int64).T
        np.bitwise_or.at(self.bits, (y // 4, x // 2), BITS[y % 4, x % 2])
        self.ink[y // 4, x // 2] = ink

    def line(self, start: NDArray[np.float64], end: NDArray[np.float64], ink: int, every: float = 1.0) -> None:
        """A straight line; ``every`` above 1 leaves gaps between dots."""
        self.points(self._along(start.tolist(), end.tolist(), every), ink)

    def path(self, xy: NDArray[np.float64], inks: NDArray[np.int64]) -> None:
        """Lines between neighbours of (k, 2) positions, each with its own ink; a row of NaN interrupts them.

        Args:
            xy: Positions; where both ends of a line are beyond the same edge it is left out.
            inks: (k,) of the line that begins there.
        """
        size = np.array([2.0 * self.columns, 4.0 * self.rows])
        start, step = xy[:-1], np.diff(xy, axis=0)
        end = xy[1:]
        inside = ~((np.maximum(start, end) < 0) | (np.minimum(start, end) >= size)).any(axis=1)
        keep = inside & np.isfinite(step).all(axis=1)
        start, step, inks = start[keep], step[keep], inks[:-1][keep]
        counts = np.clip(np.ceil(np.abs(step).max(axis=1, initial=0.0)), 1, LONGEST).astype(np.int64)
        which = np.repeat(np.arange(len(counts)), counts)
        # 0, 1/n, … (n − 1)/n along each line of n dots
        along = (np.arange(len(which)) - np.repeat(np.cumsum(counts) - counts, counts)) / counts[which]
        dots = np.floor(start[which] + step[which] * along[:, None])
        seen = ((dots >= 0) & (dots < size)).all(axis=1)
        x, y = dots[seen].astype(np.int64).T
        np.bitwise_or.at(self.bits, (y // 4, x // 2), BITS[y % 4, x % 2])
        self.ink[y // 4, x // 2] = inks[which][seen]

    def polygon(self, corners: NDArray[np.float64], ink: int, every: float = 1.0) -> None:
        """A closed outline through (k, 2) corners."""
        places = corners.tolist()
        edges = [self._along(start, end, every) for start, end in pairwise([*places, *places[:1]])]
        if edges:
            self.points(np.concatenate(edges), ink)

    def _along(self, start: Sequence[float], end: Sequence[float], every: float) -> NDArray[np.float64]:
        """(k, 2) dots of a straight line, as far as it is inside the grid."""
        clipped = _clip(start, end, 2.0 * self.columns, 4.0 * self.rows)
        if clipped is None:
            return np.empty((0, 2))
        (x, y), (end_x, end_y) = clipped
        count = min(LONGEST, max(1, math.ceil(max(abs(end_x - x), abs(end_y - y)) / every)))
        # p = a + (b − a) k / n
        step = np.array([(end_x - x) / count, (end_y - y) / count])
        return np.asarray(np.array([x, y]) + np.arange(count + 1)[:, None] * step, dtype=np.float64)

    def circle(self, centre: NDArray[np.float64], radius: float, ink: int, every: float = 1.0) -> None:
        """A circle; nothing for radii that are unknown or beyond all sense."""
        if not (math.isfinite(radius) and 0 < radius < LONGEST):
            return
        turn = np.linspace(0.0, 2 * math.pi, max(8, math.ceil(2 * math.pi * radius / every)), endpoint=False)
        self.points(centre + radius * np.stack([np.cos(turn), np.sin(turn)], axis=1), ink)


# Shorter than this along an axis, in dots, a line is parallel to the edge.
LEAST_STEP = 1e-9


def _clip(
    start: Sequence[float], end: Sequence[float], width: float, height: float
) -> tuple[tuple[float, float], tuple[float, float]] | None:
    """The part of a segment inside the grid (Liang–Barsky), None when there is none or an end is unknown."""
    (x, y), (end_x, end_y) = start, end
    if not all(map(math.isfinite, (x, y, end_x, end_y))):
        return None
    across, down = end_x - x, end_y - y
    enter, leave = 0.0, 1.0
    for step, low in ((-across, x), (across, width - x), (-down, y), (down, height - y)):
        if abs(step) < LEAST_STEP:
            if low < 0:
                return None
            continue
        at = low / step
        enter, leave = (max(enter, at), leave) if step < 0 else (enter, min(leave, at))
    return ((x + across * enter, y + down * enter), (x + across * leave, y + down * leave)) if enter <= leave else None
