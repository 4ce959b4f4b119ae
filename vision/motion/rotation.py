"""Turn of the camera between two frames, from the homography of the ground between them.

Camera frame: x right, y down, z forward. With the ground's normal n (down) at the distance d from the camera and the
camera's displacement s between the frames, all in the earlier camera frame,

    x' ∝ R (I − s nᵀ/d) x,

so that a turn about x or y and a displacement look nearly alike: R is as good as s is known.

Rotations are converted to vectors along their axis, of the length of their angle, and back.

Reference:
    R. Hartley, A. Zisserman, "Multiple View Geometry", 2nd ed., section 13.1 (plane-induced homography).
    R. Hartley, A. Zisserman, "Multiple View Geometry", 2nd ed., section A4.3.2 (Rodrigues' formula).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from vision.camera.intrinsics import Intrinsics
from vision.motion.image_motion import ImageMotion
from vision.motion.plane_fit import mapped

Floats = NDArray[np.float64]
GRID = (7, 5)
"""Places across and down the image at which the homography is compared with the camera's motion."""
MIN_PLACES = 6
"""Least number of them that show ground."""
MIN_DIP = 0.05
"""Sine of the angle below the horizon from which ground counts: nearer to it what is seen stands high."""
STEPS = 3
"""Steps of Gauss-Newton; a turn of 5° is found to 1e-6 rad in two."""
SYSTEMATIC_PX = 0.3
"""1σ of what no number of points averages out, in each place and in all: a rolling shutter, what stands high, waves of
the ground, the lens."""
NEAR_HALF_TURN = -0.9
"""Cosine of an angle near π, at which the difference of R and its transpose no longer shows the axis well."""


def turned_by(v: Floats) -> Floats:
    """(3, 3) Exp(v) of a rotation vector (3,), radians."""
    return np.asarray(cv2.Rodrigues(v)[0], np.float64)


def vector_of(R: Floats) -> Floats:
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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GroundShift:
    """Motion of the camera over the ground between two frames, in the axes of the earlier camera frame."""

    shift: Floats
    """(3,) displacement of the camera, m."""
    shift_std: float
    """1σ of it per axis, m."""
    down: Floats
    """(3,) unit normal of the ground, away from the camera."""
    height: float
    """Height of the camera above the ground, m."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CameraTurn:
    """A small turn of the camera."""

    vector: Floats
    """(3,) rotation vector of R_later_earlier, which takes earlier camera vectors to later ones, rad."""
    cov: Floats
    """(3, 3) its covariance, rad²."""


def rotation_of(motion: ImageMotion, intrinsics: Intrinsics, ground: GroundShift) -> CameraTurn | None:
    """Turn of the camera that explains a homography best, together with the displacement that is known.

    Returns:
        None where too little of the image is ground.
    """
    size = np.array([intrinsics.width, intrinsics.height])
    across, down = (np.linspace(0.1, 0.9, n) for n in GRID)
    places = np.stack(np.meshgrid(across, down), axis=-1).reshape(-1, 2) * size
    x, seen = intrinsics.rays(places), intrinsics.rays(mapped(motion.H, places))
    dip = x @ ground.down
    usable = (dip > MIN_DIP) & np.isfinite(seen).all(axis=1) & (seen[:, 2] > MIN_DIP)
    if np.count_nonzero(usable) < MIN_PLACES:
        return None
    x, seen, dip = x[usable], seen[usable, :2] / seen[usable, 2:], dip[usable] / ground.height
    focal = np.sqrt(intrinsics.fx * intrinsics.fy)
    # the homography rests on `inliers` points, spread evenly over the places
    weight = focal**2 / (motion.std_px**2 * len(x) / motion.inliers + SYSTEMATIC_PX**2)
    R, s = Rotation.identity(), ground.shift.astype(np.float64)
    prior = np.array([0.0] * 3 + [ground.shift_std**-2] * 3)
    for _ in range(STEPS):
        # y = R (x − s nᵀx/d),  ∂y/∂ω = −[y]×,  ∂y/∂s = −R nᵀx/d
        y = R.apply(x - dip[:, None] * s)
        J = _projected(y) @ np.concatenate([-_cross(y), -dip[:, None, None] * R.as_matrix()], axis=2)
        J = J.reshape(-1, 6)
        residual = (seen - y[:, :2] / y[:, 2:]).reshape(-1)
        information = weight * J.T @ J + np.diag(prior)
        pull = weight * J.T @ residual + prior * np.concatenate([np.zeros(3), ground.shift - s])
        step = np.linalg.solve(information, pull)
        R, s = Rotation.from_rotvec(step[:3]) * R, s + step[3:]
    cov = np.linalg.inv(information)[:3, :3] + np.eye(3) * (SYSTEMATIC_PX / focal) ** 2
    return CameraTurn(vector=R.as_rotvec(), cov=cov)


def _projected(y: Floats) -> Floats:
    """(k, 2, 3) derivative of (y0 / y2, y1 / y2) by y (k, 3)."""
    J = np.zeros((len(y), 2, 3))
    J[:, 0, 0] = J[:, 1, 1] = 1.0 / y[:, 2]
    J[:, :, 2] = -y[:, :2] / y[:, 2:] ** 2
    return J


def _cross(y: Floats) -> Floats:
    """(k, 3, 3) matrices [y]× of the cross product y × ·."""
    M = np.zeros((len(y), 3, 3))
    M[:, 0, 1], M[:, 0, 2], M[:, 1, 2] = -y[:, 2], y[:, 1], -y[:, 0]
    return M - M.swapaxes(1, 2)
