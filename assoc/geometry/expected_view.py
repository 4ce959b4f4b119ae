"""Vehicles that should be in view, by where they report to be."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from assoc.geometry.ground import ground_to_rays
from assoc.records import CameraState

FloatArray = NDArray[np.float64]

_HALF_VEHICLE_M = 1.0
"""Half the length of a vehicle, metres: at the border part of it is still seen."""
_FRESH_S = 3.0
"""Time constant with which a report loses its value, seconds."""


def chance_in_view(
    p: FloatArray, age_s: FloatArray, std_m: float, camera: CameraState, theta: FloatArray
) -> FloatArray:
    """Return the probability that each vehicle is inside the image's border.

    With the place as (x, y, z) in the camera's frame and t the tangent of half the view, it is inside by
    m = min(t_x z − |x|, t_y z − |y|) metres, uncertain by σ:  P = Φ(m/σ) exp(−age/3 s).

    Args:
        p: (n, 2) east and north of the vehicles now, metres, NaN unknown.
        age_s: (n,) age of their reports, seconds.
        std_m: σ of a place, metres.
        camera: The camera as reported.
        theta: (9,) its correction.

    Returns:
        (n,) chances; 0 where place or view are unknown.
    """
    x, y, z = ground_to_rays(p, camera.R_enu_cam, camera.p_enu, camera.ground_z, theta).T
    across, along = camera.half_view
    inside = np.minimum(across * z - np.abs(x), along * z - np.abs(y))
    chance = ndtr(inside / np.hypot(std_m, _HALF_VEHICLE_M)) * np.exp(-np.maximum(np.abs(age_s), 0.0) / _FRESH_S)
    chance = np.where(np.isfinite(chance) & (z > 0.0), chance, 0.0)
    return np.asarray(chance if np.isfinite(across + along) else np.full(len(p), 0.5))
