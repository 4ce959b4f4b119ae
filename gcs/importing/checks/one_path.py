"""Paths that are one, or those of two or more vehicles or receivers that take turns."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from gcs.importing.checks.plausible import metres
from gcs.importing.checks.steps import cell_size_m
from gcs.importing.vehicle_log import Where

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_BESIDE_M, _CELLS = 2.0, 1.5
"""Least distance of paths that are told apart, and in cells to which coordinates were rounded."""
_MIN_MPS2 = 3.0
"""Acceleration with which no ground vehicle is thrown to and fro, or circles, all the time."""
_MAX_IN_TURN = 8
_WHOLE = 0.88
"""Share of positions that are not damaged; of eight in turn a quarter is off."""
_CLEARLY = 0.4
"""Positions are those of several in turn if each fits its own n-th neighbours this much better than its next ones."""
_MIN_LEAPS, _MIN_SHARE, _ALIKE = 4, 0.03, 0.25
"""Leaps of one receiver differ; those between two paths follow each other with the same length and direction."""
_STEPS = 3.0
"""A leap goes back to where it came from, to a share of its length."""
_FAR_M, _MANY = 15.0, 0.1
"""Leaps that are longer and more than this share of all are those of no path, also where they differ."""
_MIN_ROWS = 8


def several_paths(t_us: Ints, degrees: Floats, where: Where) -> str:
    """Return sentences on where a path is several that take turns; empty where it is one.

    Args:
        t_us: (n,) increasing.
        degrees: (n, 2) latitude and longitude.
        where: place of a row in the file.
    """
    moved = np.flatnonzero(np.r_[True, (np.diff(degrees, axis=0) != 0.0).any(axis=1)])
    if len(moved) < _MIN_ROWS:
        return ""
    path_m = metres(degrees)
    cell_m = cell_size_m(degrees, path_m)
    path_m, t_s = path_m[moved], (t_us[moved] - t_us[0]) * 1e-6
    away_m, row = _take_turns(t_s, path_m, max(_BESIDE_M, _CELLS * cell_m)), 1
    if not away_m:
        away_m, row = _leaps_alike(t_s, path_m, cell_m)
    if not away_m:
        return ""
    at = where(int(moved[row]))
    return f"its positions leap {away_m:.1f} m to and fro, as at {at}: two vehicles or receivers take turns in it"


def _take_turns(t_s: Floats, path_m: Floats, far_m: float) -> float:
    """Distance of positions from where those around them lie, metres; 0 where these are of the same path."""
    off = _off_m(t_s, path_m, 1)
    away_m = _mean(off)
    thrown = 2.0 * off / (np.diff(t_s)[:-1] * np.diff(t_s)[1:])
    if away_m < far_m or _mean(thrown) < _MIN_MPS2:
        return 0.0
    longest = min(_MAX_IN_TURN, len(t_s) // 3)
    best = min((_mean(_off_m(t_s, path_m, n)) for n in range(2, longest + 1)), default=np.inf)
    return away_m if best < _CLEARLY * away_m else 0.0


def _mean(off: Floats) -> float:
    """Mean without the largest ones, which single damaged positions make."""
    return float(np.sort(off)[: math.ceil(_WHOLE * len(off))].mean())


def _off_m(t_s: Floats, path_m: Floats, n: int) -> Floats:
    """Distances of positions from the straight line between the n-th ones before and after.

    r_k = |p_k − (1 − w) p_{k−n} − w p_{k+n}|,   w = (t_k − t_{k−n}) / (t_{k+n} − t_{k−n})
    """
    w = ((t_s[n:-n] - t_s[: -2 * n]) / (t_s[2 * n :] - t_s[: -2 * n]))[:, None]
    between = (1.0 - w) * path_m[: -2 * n] + w * path_m[2 * n :]
    return np.asarray(np.linalg.norm(path_m[n:-n] - between, axis=1))


def _leaps_alike(t_s: Floats, path_m: Floats, cell_m: float) -> tuple[float, int]:
    """Median length of leaps away and back that are alike, or far and many, else 0; and the row of the first."""
    to, fro = path_m[1:-1] - path_m[:-2], path_m[2:] - path_m[1:-1]
    leaps = 0.5 * (to - fro)
    leg = np.minimum(np.linalg.norm(to, axis=1), np.linalg.norm(fro, axis=1))
    thrown = 2.0 * np.linalg.norm(leaps, axis=1) / (np.diff(t_s)[:-1] * np.diff(t_s)[1:])
    found = (leg > max(_BESIDE_M, _CELLS * cell_m) + _STEPS * np.linalg.norm(to + fro, axis=1)) & (thrown > _MIN_MPS2)
    # what turns round has come the same way, step by step
    came = np.linalg.norm(to[1:] - to[:-1], axis=1) < 0.5 * np.linalg.norm(to[1:], axis=1)
    found &= ~np.r_[False, came]
    leaps, first = leaps[found], int(np.argmax(found)) + 1
    if len(leaps) < max(_MIN_LEAPS, _MIN_SHARE * len(t_s)):
        return 0.0, 0
    length_m = float(np.median(np.linalg.norm(leaps, axis=1)))
    before, after = leaps[:-1], leaps[1:]
    apart = np.minimum(np.linalg.norm(after - before, axis=1), np.linalg.norm(after + before, axis=1))
    most_m = _ALIKE * np.linalg.norm(before, axis=1) + cell_m
    alike = np.count_nonzero(apart < most_m) * 2 > len(before)
    if alike or (length_m > _FAR_M and len(leaps) > _MANY * len(t_s)):
        return length_m, first
    return 0.0, 0
