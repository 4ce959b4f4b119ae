"""Projection of ENU metres onto a field of braille dots. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gcs.snapshot import Snapshot

STEPS = (1.0, 1.4, 2.0, 2.8, 4.0, 5.6, 8.0)
"""Scales of a decade: the map changes in steps, not with every metre driven."""
FINEST_M, COARSEST_M = 0.01, 10_000.0
MARGIN_X, MARGIN_Y = 20.0, 12.0
"""Dots kept free for names."""
DEFAULT_SPAN_M = 40.0
HOME_ENU = np.zeros(2)
"""The UAV's first position, which the metres are counted from."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MapView:
    """A north-up window on the ground."""

    east: float
    north: float
    metres_per_dot: float
    columns: int
    rows: int

    def dots(self, p_enu: NDArray[np.float64]) -> NDArray[np.float64]:
        """(k, 2+) metres to (k, 2) dots, x right, y down."""
        # x = W/2 + (e − e0)/s, y = H/2 − (n − n0)/s
        shift = (p_enu[:, :2] - (self.east, self.north)) / self.metres_per_dot
        return np.asarray(shift * (1.0, -1.0) + (self.columns, 2.0 * self.rows), dtype=np.float64)

    def cell(self, p_enu: NDArray[np.float64]) -> tuple[int, int] | None:
        """Column and row of a place, (2+,) metres; None outside and for NaN."""
        east, north = p_enu[:2].tolist()
        # as for dots; one place costs less without arrays
        x = (east - self.east) / self.metres_per_dot + self.columns
        y = (self.north - north) / self.metres_per_dot + 2.0 * self.rows
        # NaN is in no cell
        return (int(x // 2), int(y // 4)) if 0 <= x < 2 * self.columns and 0 <= y < 4 * self.rows else None

    def ground(self, column: float, row: float) -> NDArray[np.float64]:
        """(2,) metres of the middle of a cell."""
        # the inverse of dots, at the middle of 2 × 4 dots
        x, y = 2 * column + 1 - self.columns, 4 * row + 2 - 2 * self.rows
        return np.array([self.east + x * self.metres_per_dot, self.north - y * self.metres_per_dot])

    def moved(self, columns: int, rows: int) -> MapView:
        """The window that many cells further east and south."""
        step = self.metres_per_dot
        return replace(self, east=self.east + 2 * columns * step, north=self.north - 4 * rows * step)

    def zoomed(self, steps: int, column: int, row: int) -> MapView:
        """Return the view closer (positive) or farther, with the same ground in a cell as before."""
        scale = step_scale(self.metres_per_dot, -steps)
        held, ratio = self.ground(column, row), scale / self.metres_per_dot
        east, north = held + (np.array([self.east, self.north]) - held) * ratio
        return replace(self, east=float(east), north=float(north), metres_per_dot=scale)


def points_of(snapshot: Snapshot) -> NDArray[np.float64]:
    """(k, 2) known positions: UAV, vehicles, footprints, boxes without a name."""
    points = [snapshot.uav_enu[:2], *(row.p_enu[:2] for row in snapshot.vehicles)]
    points += [box.p_enu[:2] for box in snapshot.boxes if not box.system_id]
    if snapshot.footprint_enu is not None:
        points += list(snapshot.footprint_enu[:, :2])
    points += [corner for footprint in snapshot.footprints_elsewhere for corner in footprint]
    stacked = np.array(points, dtype=np.float64).reshape(-1, 2)
    return stacked[np.isfinite(stacked).all(axis=1)]


def map_view_of(
    points: NDArray[np.float64],
    columns: int,
    rows: int,
    *,
    before: float = 0.0,
    zoom: int = 0,
    centre: NDArray[np.float64] | None = None,
) -> MapView:
    """A view that holds all points, in a scale that changes seldom.

    Args:
        points: (k, 2) metres; none gives a default span round the origin.
        columns: Of the field, cells.
        rows: Of the field, cells.
        before: Scale of the view before, metres per dot; kept while it still fits and is not twice too coarse.
        zoom: Steps closer (positive) or farther from the fitting scale.
        centre: (2,) metres to hold in the middle; the middle of all points unless given.
    """
    low, high = (points.min(axis=0), points.max(axis=0)) if len(points) else (np.zeros(2), np.zeros(2))
    middle = (low + high) / 2 if centre is None or not np.isfinite(centre).all() else centre
    span = 2 * np.maximum(high - middle, middle - low)
    if not span.max() > 0:
        span = np.full(2, DEFAULT_SPAN_M)
    free = np.maximum(4.0, np.array([2.0 * columns, 4.0 * rows]) - (MARGIN_X, MARGIN_Y))
    needed = float((span / free).max())
    fitting = before if needed <= before <= 2 * needed else _round_up(needed)
    scale = step_scale(fitting, -zoom)
    # snapped to cells, so that a slow drift does not shake the map
    snap = 4 * scale
    east, north = (float(np.round(value / snap) * snap) for value in middle)
    return MapView(east=east, north=north, metres_per_dot=scale, columns=columns, rows=rows)


def _round_up(needed: float) -> float:
    needed = min(max(needed, FINEST_M), COARSEST_M)
    decade = 10.0 ** math.floor(math.log10(needed))
    return next((decade * step for step in STEPS if decade * step >= needed), 10 * decade)


def step_scale(scale: float, steps: int) -> float:
    """A scale some steps coarser (positive) or finer."""
    at = round(len(STEPS) * math.log10(max(scale, FINEST_M))) + steps
    decade, step = divmod(at, len(STEPS))
    return min(max(10.0**decade * STEPS[step], FINEST_M), COARSEST_M)


def scale_bar(metres_per_dot: float, longest_cells: int) -> tuple[str, float]:
    """A bar of a round length of 1, 2 or 5 times a power of ten that fits: its text and its metres."""
    longest_m = max(2.0, longest_cells) * 2 * metres_per_dot
    decade = 10.0 ** math.floor(math.log10(longest_m))
    # just below a power of ten the logarithm rounds up to it
    metres = max(decade * step for step in (0.5, 1, 2, 5) if decade * step <= longest_m)
    cells = max(2, round(metres / (2 * metres_per_dot)))
    label = f"{metres / 1000:g} km" if metres >= 1000 else f"{metres:g} m"
    return "├" + "─" * (cells - 2) + "┤ " + label, metres
