"""Steps that no vehicle makes: positions that stay while it moves, altitudes that count from elsewhere all at once."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from gcs.importing.vehicle_log import Where

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

STALE = "positions that stay to the last digit while the vehicle goes on"
STAYS = "its position stays the same to the last digit, while it goes on,"
_MIN_S = 5.0
"""Positions that are the same to the last digit for a shorter time are taken as they are."""
_BEHIND_M, _BEHIND_STEPS, _BEHIND_MPS = 3.0, 4.0, 0.5
"""Least leap by which a vehicle had gone on while its position stayed: metres, usual steps, and m/s."""
_MOVES_MPS, _CELLS, _STEADY = 1.5, 4.0, 0.08
"""Speed, m/s, and cells of its coordinates in a second above which a vehicle does not stop within a row."""
_SECOND_S = 1.0
_GOES_MPS = 1.0
"""Speed that a vehicle tells, m/s, above which it does not stand."""
_MAX_DECIMALS, _ROUND_DEG = 9, 1e-11
_DEG_M = 111_320.0
_STEP_M, _STEP_MPS2, _AROUND = 5.0, 5.0, 5
"""Least step of an altitude, its least acceleration, and the rows on either side that are compared."""


def stays(t_us: Ints, degrees: Floats, path_m: Floats, speed_mps: Floats | None = None) -> Bools:
    """(n,) which positions are those of an earlier time, repeated while the vehicle went on.

    Args:
        t_us: (n,) increasing.
        degrees: (n, 2) latitude and longitude, as they stand in the file.
        path_m: (n, 2) the same in metres.
        speed_mps: (n,) over ground, NaN unknown; then that it stands is not concluded from the path.
    """
    found = np.zeros(len(t_us), np.bool_)
    first = np.flatnonzero(np.r_[True, (np.diff(degrees, axis=0) != 0.0).any(axis=1)])
    last = np.r_[first[1:], len(t_us)] - 1
    t_s = (t_us - t_us[0]) * 1e-6
    long = np.flatnonzero(t_s[last] - t_s[first] >= _MIN_S)
    if not len(long) or len(first) < 3:
        return found
    usual_m = float(np.median(np.linalg.norm(np.diff(path_m[first], axis=0), axis=1)))
    cell_m = cell_size_m(degrees, path_m)
    for begin, end in zip(first[long].tolist(), last[long].tolist(), strict=True):
        if speed_mps is not None:
            reported = speed_mps[begin : end + 1]
            speed = float(np.nanmedian(reported)) if np.isfinite(reported).any() else 0.0
            # in coarse coordinates a place stays until the next cell
            went_on = speed > _GOES_MPS and speed * float(t_s[end] - t_s[begin]) > _CELLS * cell_m
        else:
            went_on = _leaps_on(t_s, path_m, begin, end, usual_m) or _was_moving(t_s, path_m, begin, cell_m)
        found[begin + 1 : end + 1] = went_on
    return found


def cell_size_m(degrees: Floats, path_m: Floats) -> float:
    """Size of the cells to which coordinates were rounded, by their decimals.

    Without such, the least step along an axis where most positions repeat the one before.
    """
    decimals = (k for k in range(_MAX_DECIMALS) if np.abs(np.round(degrees, k) - degrees).max() < _ROUND_DEG)
    found = next(decimals, None)
    if found is not None:
        return _DEG_M * 10.0**-found
    axes = [axis for axis in path_m.T if np.count_nonzero(np.diff(axis)) * 2 <= len(axis) and np.ptp(axis) > 1e-3]
    return max((float(np.diff(np.unique(np.round(axis, 4))).min(initial=np.inf)) for axis in axes), default=0.0)


def _leaps_on(t_s: Floats, path_m: Floats, begin: int, end: int, usual_m: float) -> bool:
    """Tell whether what stayed is then where it had gone meanwhile."""
    if end + 1 >= len(t_s):
        return False
    behind_m = math.dist(path_m[end], path_m[end + 1])
    least_m = max(_BEHIND_M, _BEHIND_STEPS * usual_m, _BEHIND_MPS * float(t_s[end + 1] - t_s[begin]))
    # a receiver that corrects itself leaps too, and the vehicle stands on
    later = min(int(np.searchsorted(t_s, t_s[end + 1] + _SECOND_S)), len(t_s) - 1)
    return behind_m > least_m and math.dist(path_m[later], path_m[end + 1]) > _BEHIND_MPS * _SECOND_S


def _was_moving(t_s: Floats, path_m: Floats, begin: int, cell_m: float) -> bool:
    """Tell whether what stays moved steadily up to then: a vehicle that brakes is slower in its last second."""
    before = np.searchsorted(t_s, t_s[begin] - np.array([_SECOND_S, 2.0 * _SECOND_S]), side="right") - 1
    if before[1] < 0:
        return False
    spans = (begin, int(before[0])), (int(before[0]), int(before[1]))
    later, earlier = (math.dist(path_m[b], path_m[a]) / float(t_s[b] - t_s[a]) if b > a else 0.0 for b, a in spans)
    fast = later > _MOVES_MPS and later * _SECOND_S > _CELLS * cell_m
    return fast and abs(later - earlier) < _STEADY * later


def altitude_words(t_us: Ints, alt_m: Floats, what: str, where: Where) -> tuple[str, ...]:
    """Return sentences on where an altitude counts from elsewhere, or in another unit, from one row on.

    Args:
        t_us: (n,) increasing.
        alt_m: (n,) NaN unknown.
        what: its name.
        where: place of a row, in words.
    """
    rows = np.flatnonzero(np.isfinite(alt_m))
    if len(rows) < 2 * _AROUND:
        return ()
    t_s, up_m = (t_us[rows] - t_us[0]) * 1e-6, alt_m[rows]
    step = np.diff(up_m)
    # by how much more than before and after it: what climbs has a rate, and changes it within bounds
    beside = 0.5 * (np.r_[step[:1], step[:-1]] + np.r_[step[1:], step[-1:]])
    excess = np.abs(step - beside)
    found = [
        row
        for row in np.flatnonzero((excess > _STEP_M) & (excess > _STEP_MPS2 * np.diff(t_s) ** 2)).tolist()
        if _holds(up_m, row)
    ]
    if not found:
        return ()
    worst = max(found, key=lambda row: float(excess[row]))
    more = f", the largest of {len(found)} such steps" if len(found) > 1 else ""
    return (
        f"its {what} steps by {step[worst]:+.1f} m at {where(int(rows[worst + 1]))}{more}: does it count from "
        "elsewhere, or in another unit, from there on?",
    )


def _holds(up_m: Floats, row: int) -> bool:
    """Tell whether a step behind a row is still there some rows later."""
    before, after = up_m[max(0, row + 1 - _AROUND) : row + 1], up_m[row + 1 : row + 1 + _AROUND]
    step = float(up_m[row + 1] - up_m[row])
    held = float(np.median(after) - np.median(before)) if min(len(after), len(before)) > 1 else 0.0
    return abs(held - step) < 0.5 * abs(step)
