"""A path through positions that were rounded, repeated or noisy, and the velocity along it.

Along each axis the velocity is a random walk, x = (p, v):

    x_k = F x_{k−1} + w,   F = [1 Δ; 0 1],   w ~ N(0, q [Δ³/3 Δ²/2; Δ²/2 Δ]),   z_k = p_k + n,   n ~ N(0, σ²)

filtered forward and smoothed backward (Rauch, Tung, Striebel 1965, doi:10.2514/3.3166).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from gcs.importing.vehicle_log import PlaceTrack, thinned

__all__ = ["smooth_path", "smoothed_places"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_STEP_US = 90_000
"""Positions closer together are thinned: a receiver has ten a second."""
_GAP_US = 10_000_000
"""Longer holes are not bridged."""
_DEG_M = 111_320.0

ACCELERATION = 1.5
"""q in m²/s³: a multicopter or a car that changes its speed by this in a second, 1σ."""
FIRST_SPEED = 15.0
"""1σ of the velocity at first, m/s."""


def smooth_path(t_s: Floats, p: Floats, std_m: float) -> tuple[Floats, Floats]:
    """Positions and velocities.

    Args:
        t_s: (n,) seconds, increasing.
        p: (n, k) metres, k axes.
        std_m: σ of each, more than 0.

    Returns:
        (n, k) metres and (n, k) m/s.
    """
    n = len(t_s)
    if n == 0:
        return p.copy(), np.zeros_like(p)
    steps, r = np.diff(t_s), std_m**2
    means, priors = np.empty((n, 2, p.shape[1])), np.empty((n, 2, p.shape[1]))
    covs, prior_covs = np.empty((n, 2, 2)), np.empty((n, 2, 2))
    mean, cov = np.stack([p[0], np.zeros(p.shape[1])]), np.diag([r, FIRST_SPEED**2])
    means[0], covs[0] = mean, cov
    for k in range(1, n):
        d = float(steps[k - 1])
        F = np.array([[1.0, d], [0.0, 1.0]])
        Q = ACCELERATION * np.array([[d**3 / 3.0, d**2 / 2.0], [d**2 / 2.0, d]])
        mean, cov = F @ mean, F @ cov @ F.T + Q
        priors[k], prior_covs[k] = mean, cov
        # gain = P Hᵀ / (H P Hᵀ + σ²), H = (1 0)
        gain = cov[:, 0] / (cov[0, 0] + r)
        mean = mean + gain[:, None] * (p[k] - mean[0])
        cov = cov - np.outer(gain, cov[0])
        means[k], covs[k] = mean, cov
    for k in range(n - 2, -1, -1):
        F = np.array([[1.0, float(steps[k])], [0.0, 1.0]])
        back = np.linalg.solve(prior_covs[k + 1], F @ covs[k]).T
        means[k] += back @ (means[k + 1] - priors[k + 1])
    return means[:, 0], means[:, 1]


def smoothed_places(
    t_us: Ints, degrees: Floats, *, alt_m: Floats, height_m: Floats, noise_m: float, std_m: float
) -> PlaceTrack:
    """Positions with the path smoothed and the velocity along it.

    Args:
        t_us: (n,) increasing.
        degrees: (n, 2) latitude and longitude.
        alt_m: (n,) above sea level.
        height_m: (n,) above the take-off.
        noise_m: 1σ per axis of what differs from one position to the next: rounding and noise.
        std_m: 1σ per axis of a position.
    """
    rows = thinned(t_us, _STEP_US)
    t, middle = t_us[rows], np.asarray(np.median(degrees, axis=0))
    scale = np.array([_DEG_M, _DEG_M * math.cos(math.radians(float(middle[0])))])
    level: Floats = (degrees[rows] - middle) * scale
    smooth, v = np.empty_like(level), np.empty_like(level)
    for part in np.split(np.arange(len(t)), np.flatnonzero(np.diff(t) > _GAP_US) + 1):
        smooth[part], v[part] = smooth_path(np.asarray((t[part] - t[part[:1]]) * 1e-6), level[part], noise_m)
    places = smooth / scale + middle
    return PlaceTrack.of(
        t,
        places[:, 0],
        places[:, 1],
        alt_m=alt_m[rows],
        height_m=height_m[rows],
        v_ned=np.column_stack([v, np.full(len(t), np.nan)]),
        std_m=std_m,
    )
