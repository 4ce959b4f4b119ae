"""Rotations as vectors along their axis, of the length of their angle, and back; quickly for one at a time.

Reference:
    R. Hartley, A. Zisserman, "Multiple View Geometry", 2nd ed., section A4.3.2 (Rodrigues' formula).
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

__all__ = ["turned_by", "vector_of"]

FloatArray = NDArray[np.float64]

NEAR_HALF_TURN = -0.9
"""Cosine of an angle near π, at which the difference of R and its transpose no longer shows the axis well."""


def turned_by(v: FloatArray) -> FloatArray:
    """(3, 3) Exp(v) of a rotation vector (3,), radians."""
    return np.asarray(cv2.Rodrigues(v)[0], np.float64)


def vector_of(R: FloatArray) -> FloatArray:
    """(3,) the shortest v with Exp(v) = R (3, 3), radians."""
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = R.tolist()
    cosine = 0.5 * (xx + yy + zz - 1.0)
    if not cosine > NEAR_HALF_TURN:
        return np.asarray(Rotation.from_matrix(R).as_rotvec(), np.float64)
    # R − Rᵀ = 2 sin θ [n]×
    x, y, z = 0.5 * (zy - yz), 0.5 * (xz - zx), 0.5 * (yx - xy)
    sine = math.hypot(x, y, z)
    stretch = math.atan2(sine, cosine) / sine if sine > 0.0 else 1.0
    return np.array([stretch * x, stretch * y, stretch * z])
