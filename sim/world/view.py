"""View that a renderer is given: the camera, the bodies and the roads; and the pinhole projection they share.

World frame: ENU metres, ground z = 0, headings in radians clockwise from north. Camera frame: OpenCV axes (x right,
y down, z forward); ``R_enu_cam`` maps camera vectors into ENU. Distortion is Brown's k1 k2 p1 p2 k3, as OpenCV has it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]

UGV, OTHER_VEHICLE, PERSON, OCCLUDER = 0, 1, 2, 3
"""Values of ``Bodies.kind``."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraView:
    """The true camera at one instant."""

    width: int
    """Pixels."""
    height: int
    fx: float
    """Focal lengths and principal point in pixels."""
    fy: float
    cx: float
    cy: float
    distortion: FloatArray
    """(5,) k1 k2 p1 p2 k3."""
    R_enu_cam: FloatArray
    """(3, 3) camera axes in ENU."""
    p_enu: FloatArray
    """(3,) optical centre, metres."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Bodies:
    """All bodies on the ground, n boxes; occluders hide what is below them."""

    kind: NDArray[np.int8]
    """(n,) 0 UGV, 1 other car, 2 person, 3 occluder (tree or roof)."""
    x: FloatArray
    """(n,) centre, metres east."""
    y: FloatArray
    """(n,) centre, metres north."""
    heading: FloatArray
    """(n,) radians clockwise from north."""
    length: FloatArray
    """(n,) metres along the heading."""
    width: FloatArray
    """(n,) metres across."""
    height: FloatArray
    """(n,) metres."""
    color: NDArray[np.uint8]
    """(n, 3) BGR."""
    z: FloatArray | float = 0.0
    """(n,) or one for all: metres from the world's z = 0 up to the ground below it."""

    @classmethod
    def from_rows(cls, rows: Sequence[Sequence[float]], colors: Sequence[ArrayLike]) -> Bodies:
        """Bodies from one row each.

        Args:
            rows: n of kind, x, y, heading, length, width and height.
            colors: n of BGR.
        """
        kind, x, y, heading, length, width, height = np.array(rows, np.float64).reshape(-1, 7).T
        return cls(
            kind=kind.astype(np.int8),
            x=x,
            y=y,
            heading=heading,
            length=length,
            width=width,
            height=height,
            color=np.array(colors, np.uint8).reshape(-1, 3),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Road:
    """One road by its centre line."""

    centre: FloatArray
    """(k, 2) ENU metres, a point every metre or so."""
    width: float
    """Metres over all lanes."""
    lanes: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Scene:
    """Still parts of the world: the roads; none on open ground."""

    roads: tuple[Road, ...] = ()


def project(view: CameraView, p_enu: ArrayLike) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Pixels of points of the world.

    Args:
        p_enu: (..., 3) metres.

    Returns:
        uv (..., 2) pixels, NaN where not imaged; in_front (...,), True for points before the camera and within the
        field where the distortion is one to one (beyond it, strong distortion folds far points back into the image).
    """
    # p_cam = R_enu_camᵀ (p − c)
    p_cam = (np.asarray(p_enu, dtype=np.float64) - view.p_enu) @ view.R_enu_cam
    z = p_cam[..., 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        xy = p_cam[..., :2] / z[..., None]
    k1, k2, _, _, k3 = view.distortion
    r2 = np.sum(xy * xy, axis=-1)
    # d/dr [r (1 + k1 r² + k2 r⁴ + k3 r⁶)] > 0
    monotonic = 1.0 + r2 * (3.0 * k1 + r2 * (5.0 * k2 + r2 * 7.0 * k3)) > 0.0
    in_front = (z > 1e-6) & monotonic
    uv = distort(xy, view.distortion) * (view.fx, view.fy) + (view.cx, view.cy)
    return np.where(in_front[..., None], uv, np.nan), in_front


def ray_ground(view: CameraView, uv: ArrayLike, z: float = 0.0) -> FloatArray:
    """Points at which the rays of pixels meet the plane at height z.

    Args:
        uv: (..., 2) pixels.
        z: height of the plane, metres.

    Returns:
        (..., 3) ENU metres; NaN at and above the horizon.
    """
    xy = _undistort((np.asarray(uv, dtype=np.float64) - (view.cx, view.cy)) / (view.fx, view.fy), view.distortion)
    rays = np.concatenate([xy, np.ones_like(xy[..., :1])], axis=-1) @ view.R_enu_cam.T
    down = rays[..., 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = (z - view.p_enu[2]) / down
    hit = np.isfinite(scale) & (scale > 0.0)
    return np.where(hit[..., None], view.p_enu + rays * np.where(hit, scale, 0.0)[..., None], np.nan)


def distort(xy: FloatArray, distortion: FloatArray) -> FloatArray:
    """Brown's distortion of normalised image points (..., 2)."""
    if not distortion.any():
        return xy
    k1, k2, p1, p2, k3 = distortion
    x, y = xy[..., 0], xy[..., 1]
    with np.errstate(over="ignore", invalid="ignore"):
        r2 = x * x + y * y
        # x' = x (1 + k1 r² + k2 r⁴ + k3 r⁶) + 2 p1 xy + p2 (r² + 2x²);  y' alike with p1, p2 swapped
        radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
        return np.stack(
            [
                x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
                y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
            ],
            axis=-1,
        )


def _undistort(xy_distorted: FloatArray, distortion: FloatArray) -> FloatArray:
    if not distortion.any():
        return xy_distorted
    xy = xy_distorted
    for _ in range(20):
        # fixed point: x ← x − (distort(x) − x_d)
        xy = xy - (distort(xy, distortion) - xy_distorted)
    return xy
