"""A clock that leaps by less than a gap is long, told by even steps and by how the path goes on."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from infra.clock_steps import usual_steps

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_AROUND, _AROUND_US, _MAX_AROUND, _NEAREST = 6, (1_200_000, 3_000_000), 100, 2
"""Rows on either side that tell how a path goes on: at least this many and those of this time, at most this many,
without the nearest, which may be late."""
_NEXT, _EASE = 4, 1.1
"""Steps on either side between whose speeds, and a little beyond, those of a vehicle in between are."""
_MIN_M, _SIGMAS, _AGREED = 0.1, 5.0, 0.3
"""A leap moves the path by more than this, than this many times its error, and by what the step tells ± a share."""


def path_leaps(t_us: Ints, path_m: Floats) -> list[tuple[int, int]]:
    """Rows behind which a clock leaps, and by how much, µs: the path goes on as if a usual step had passed.

    Around such a row the path is a parabola, p(t) = a + b t + c t² + e [behind it]. A clock that was set forward by L
    makes e = −b L; where rows are lost, or the clock is right, e = 0.

    Args:
        t_us: (n,) by the clock of what moves; where it goes back is not looked at.
        path_m: (n, 2).
    """
    usual_us, even = usual_steps(t_us)
    steps, ways = np.diff(t_us), np.linalg.norm(np.diff(path_m, axis=0), axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        speeds, by_usual = ways / steps, ways / usual_us
    # a short stretch where the vehicle brakes or turns, a longer one where places are coarse
    widths = [int(np.clip(width_us // max(usual_us, 1.0), _AROUND, _MAX_AROUND)) for width_us in _AROUND_US]
    found = []
    for row in np.flatnonzero(~even & (steps > 0)).tolist():
        near = np.r_[speeds[max(0, row - _NEXT) : row], speeds[row + 1 : row + 1 + _NEXT]]
        slowest, fastest = near.min(initial=math.inf) / _EASE, near.max(initial=0.0) * _EASE
        if slowest <= speeds[row] <= fastest or not slowest <= by_usual[row] <= fastest:
            continue  # as fast as before or after
        leap_us = int(steps[row]) - round(usual_us)
        if any(_goes_on(t_us, path_m, row, leap_us, width) for width in dict.fromkeys(widths)):
            found.append((row, leap_us))
    return found


def _goes_on(t_us: Ints, path_m: Floats, row: int, leap_us: int, width: int) -> bool:
    """Tell whether a path goes on behind a row as if its clock had leapt, by this many rows on either side."""
    rows = np.arange(max(0, row + 1 - width), min(len(t_us), row + 1 + width))
    rows = rows[np.abs(rows - row - 0.5) > _NEAREST]
    behind, t_s = rows > row, (t_us[rows] - t_us[row]) * 1e-6
    if min(behind.sum(), (~behind).sum()) < _AROUND - _NEAREST:
        return False
    terms = np.column_stack([np.ones_like(t_s), t_s, t_s**2, behind])
    fitted, *_ = np.linalg.lstsq(terms, path_m[rows], rcond=None)
    left = path_m[rows] - terms @ fitted
    # var e = σ² (AᵀA)⁻¹
    std_m = np.sqrt((left**2).sum() / (2 * len(rows) - 8) * np.linalg.pinv(terms.T @ terms)[3, 3])
    moved_m, way_m = fitted[3], fitted[1] * leap_us * 1e-6
    far_m = float(np.linalg.norm(way_m))
    agreed = float(np.linalg.norm(moved_m + way_m)) < _AGREED * far_m
    return agreed and far_m > max(_MIN_M, _SIGMAS * float(std_m))
