"""A path through positions that were rounded, repeated or noisy, and the velocity along it.

Along each axis the velocity is a random walk with q m²/s³. Of positions z_k with noise σ at times t_k,

    minimise Σ (p_k − z_k)² / σ² + Σ (v_k − v_{k−1})² / (q Δ_k),   v_k = (p_{k+1} − p_k) / (t_{k+1} − t_k)

Where positions were rounded to cells of metres there is no noise to speak of: the path is the smoothest that stays
within them, |p_k − z_k| ≤ cell / 2, by alternating directions (ADMM: Boyd et al. 2011, doi:10.1561/2200000016, 5.2).
When a cell is left tells more than how often it was reported.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline
from scipy.linalg import solveh_banded

from gcs.importing.vehicle_log import PlaceTrack, at_times, thinned

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

ACCELERATION = 1.5
"""q in m²/s³: a multicopter or a car that changes its speed by this in a second, 1σ."""
COARSE_CELL_M = 1.0
"""Cell size from which on the rounding of positions is more than their noise."""
ROUNDS = 200
"""Rounds of ADMM: the path is within centimetres of its end by then."""
_STEP_US = 90_000
"""Positions closer together are thinned: a receiver has ten a second."""
_GAP_US = 10_000_000
"""Longest hole that is bridged."""
_SPARSE_US, _LOST_US = 250_000, 3_000_000
"""Positions farther apart than the first are filled in; than the second, nobody knows where it was in between."""
_DEG_M = 111_320.0


def smooth_path(t_s: Floats, p: Floats, noise_m: float, cell_m: float) -> tuple[Floats, Floats]:
    """Positions and velocities along one axis.

    Args:
        t_s: (n,) seconds, increasing.
        p: (n,) metres.
        noise_m: σ of each, more than 0.
        cell_m: to which they were rounded.

    Returns:
        (n,) metres and (n,) m/s.
    """
    if len(t_s) < 3:
        return p.copy(), np.gradient(p, t_s) if len(t_s) == 2 else np.zeros_like(p)
    banded = _banded(t_s, noise_m)
    x = np.asarray(solveh_banded(banded, p))
    if cell_m > COARSE_CELL_M:
        u = np.zeros_like(p)
        for _ in range(ROUNDS):
            # y = Π(x + u),   u ← u + x − y,   x = argmin of the sum with y − u for z
            y = np.clip(x + u, p - 0.5 * cell_m, p + 0.5 * cell_m)
            u += x - y
            x = np.asarray(solveh_banded(banded, y - u))
    return x, np.gradient(x, t_s)


def _banded(t_s: Floats, noise_m: float) -> Floats:
    """(3, n) upper bands of I + σ²/q Σ d dᵀ / Δ, d the difference of two velocities as weights of three positions."""
    step = np.diff(t_s)
    before, after = 1.0 / step[:-1], 1.0 / step[1:]
    weights = (before, -(before + after), after)
    scale = noise_m**2 / ACCELERATION / (0.5 * (step[:-1] + step[1:]))
    bands = np.zeros((3, len(t_s)))
    bands[2] = 1.0
    for i in range(3):
        for j in range(i, 3):
            bands[2 - (j - i), j : j + len(scale)] += scale * weights[i] * weights[j]
    return bands


def smoothed_places(
    t_us: Ints, degrees: Floats, *, alt_m: Floats, height_m: Floats, noise_m: float, cell_deg: float, std_m: float
) -> PlaceTrack:
    """Positions with the path smoothed and the velocity along it.

    Args:
        t_us: (n,) increasing.
        degrees: (n, 2) latitude and longitude.
        alt_m: (n,) above sea level.
        height_m: (n,) above the take-off.
        noise_m: 1σ per axis of what differs from one position to the next.
        cell_deg: to which latitude and longitude were rounded.
        std_m: 1σ per axis of a position.
    """
    rows = thinned(t_us, _STEP_US)
    t, middle = t_us[rows], np.asarray(np.median(degrees, axis=0))
    scale = np.array([_DEG_M, _DEG_M * math.cos(math.radians(float(middle[0])))])
    level: Floats = (degrees[rows] - middle) * scale
    smooth, v = np.empty_like(level), np.empty_like(level)
    for part in np.split(np.arange(len(t)), np.flatnonzero(np.diff(t) > _GAP_US) + 1):
        t_s = np.asarray((t[part] - t[part[:1]]) * 1e-6)
        for axis, cell_m in enumerate((cell_deg * scale).tolist()):
            smooth[part, axis], v[part, axis] = smooth_path(t_s, level[part, axis], noise_m, cell_m)
    places = smooth / scale + middle
    if (cell_deg * scale).max() > COARSE_CELL_M:
        v[:] = np.nan  # half a metre a second of error would turn the camera
    return PlaceTrack.of(
        t,
        places[:, 0],
        places[:, 1],
        alt_m=alt_m[rows],
        height_m=height_m[rows],
        v_ned=np.column_stack([v, np.full(len(t), np.nan)]),
        std_m=std_m,
    )


def filled_in(places: PlaceTrack) -> PlaceTrack:
    """The track of a camera with ten positions a second: between two that are farther apart, by both velocities.

    What follows a flight knows a position only once it is reported; a log knows the next one too. Holes of seconds
    stay holes.
    """
    step_us = np.diff(places.t_us)
    if not len(step_us) or np.median(step_us) <= _SPARSE_US:
        return places
    t = places.t_us
    bridged = (step_us > _SPARSE_US) & (step_us <= _LOST_US)
    starts = [
        np.arange(a, b, _STEP_US) if fill else np.array([a]) for a, b, fill in zip(t[:-1], t[1:], bridged, strict=True)
    ]
    at = np.concatenate([*starts, t[-1:]]).astype(np.int64)
    scale = np.array([_DEG_M, _DEG_M * math.cos(math.radians(float(np.median(places.lat_deg))))])
    level = np.column_stack([places.lat_deg, places.lon_deg])
    middle = np.median(level, axis=0)
    level = (level - middle) * scale
    t_s, at_s = (t - t[0]) * 1e-6, (at - t[0]) * 1e-6
    v = np.where(np.isfinite(places.v_ned[:, :2]), places.v_ned[:, :2], np.gradient(level, t_s, axis=0))
    velocity_known = np.isfinite(places.v_ned[:, :2]).all()
    path = CubicHermiteSpline(t_s, level, v)
    degrees = path(at_s) / scale + middle
    heading = at_times(at, t, places.heading, _LOST_US, turns=True)
    down = np.interp(at_s, t_s, places.v_ned[:, 2])
    return PlaceTrack.of(
        at,
        degrees[:, 0],
        degrees[:, 1],
        alt_m=np.interp(at_s, t_s, places.alt_m),
        height_m=np.interp(at_s, t_s, places.height_m),
        v_ned=np.column_stack([np.where(velocity_known, path(at_s, 1), np.nan), down]),
        heading=heading,
        std_m=places.std_m,
    )
