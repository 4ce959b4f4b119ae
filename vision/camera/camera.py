"""The view of a camera: pose from the vehicle's attitude, pixel ↔ ground.

Camera frame: OpenCV, x right, y down, z forward. World: ENU metres. Body and gimbal frames: FRD, the gimbal's x along
the optical axis. ``R_a_b`` maps b-vectors into a. Pixels: continuous, x right, y down.

Reference:
    R. Hartley, A. Zisserman, "Multiple View Geometry", 2nd ed., section 13.1 (plane-induced homography).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vision.camera.intrinsics import Intrinsics
from vision.errors import CameraError

Floats = NDArray[np.float64]

R_ENU_NED = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
"""(3, 3) rotation from NED to ENU."""
R_GIMBAL_CAM = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
"""Camera z is the gimbal's x (optical axis), camera x its y (image right), camera y its z (image down)."""

SKIM = 1e-6
"""Sine of the least angle below the horizon at which a ray still meets the ground."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Mount:
    """Mount of the camera on the vehicle. Angles turn the optical axis from the nose: yaw, then pitch, then roll.

    At pitch −π/2 the camera looks straight down and image up is the nose turned by ``yaw``.
    """

    kind: Literal["stabilized", "fixed"] = "stabilized"
    """``stabilized``: a gimbal holds the horizon, yaw follows the body. ``fixed``: bolted to the body."""
    roll: float = 0.0
    """rad, clockwise as seen from behind the camera."""
    pitch: float = -np.pi / 2
    """rad, negative looks down."""
    yaw: float = 0.0
    """rad, clockwise from the nose."""

    def __post_init__(self) -> None:
        if self.kind not in ("stabilized", "fixed"):
            raise CameraError(f'camera mount must be "stabilized" or "fixed", got "{self.kind}"')
        if not np.isfinite([self.roll, self.pitch, self.yaw]).all():
            raise CameraError("camera mount angles must be finite numbers")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CameraPose:
    """Place and attitude of the camera."""

    R_enu_cam: Floats
    """(3, 3) camera vectors into ENU."""
    p_enu: Floats
    """(3,) m."""


def camera_pose(
    mount: Mount, p_enu: ArrayLike, R_enu_body: ArrayLike, R_enu_gimbal: ArrayLike | None = None
) -> CameraPose:
    """Pose of the camera of a vehicle.

    Args:
        p_enu: (3,) m, the vehicle; the lever arm to the camera is neglected.
        R_enu_body: (3, 3) the vehicle's attitude (FRD).
        R_enu_gimbal: (3, 3) attitude that a gimbal reports; a stabilized mount believes it more than its own angles,
            but for its roll: by that the image is turned against the gimbal.
    """
    return CameraPose(
        R_enu_cam=camera_rotation(mount, R_enu_body, R_enu_gimbal), p_enu=np.array(p_enu, dtype=np.float64)
    )


def camera_rotation(mount: Mount, R_enu_body: ArrayLike, R_enu_gimbal: ArrayLike | None = None) -> Floats:
    """(3, 3) rotation alone of :func:`camera_pose`, camera vectors into ENU."""
    if R_enu_gimbal is not None and mount.kind == "stabilized":
        return np.asarray(np.asarray(R_enu_gimbal, np.float64) @ _turn_x(mount.roll) @ R_GIMBAL_CAM)
    R_enu_body = np.asarray(R_enu_body, dtype=np.float64)
    base = R_enu_body if mount.kind == "fixed" else R_ENU_NED @ _turn_z(_yaw(R_enu_body))
    return np.asarray(base @ _base_to_camera(mount.roll, mount.pitch, mount.yaw))


@lru_cache(maxsize=8)
def _base_to_camera(roll: float, pitch: float, yaw: float) -> Floats:
    """(3, 3) the camera's vectors into the frame that a mount's angles refer to: Rz(yaw) · Ry(pitch) · Rx(roll)."""
    return np.asarray(_turn_z(yaw) @ _turn_y(pitch) @ _turn_x(roll) @ R_GIMBAL_CAM)


def project(intrinsics: Intrinsics, pose: CameraPose, p_enu: ArrayLike) -> tuple[Floats, NDArray[np.bool_]]:
    """Pixels of world points.

    Args:
        pose: where it is.
        p_enu: (..., 3) m.

    Returns:
        uv (..., 2) px, NaN where not in front; in_front (...,) bool. A point in front may lie outside the image.
    """
    # p_cam = Rᵀ (p − c)
    p_cam = (np.asarray(p_enu, dtype=np.float64) - pose.p_enu) @ pose.R_enu_cam
    return intrinsics.pixels(p_cam)


def ground(intrinsics: Intrinsics, pose: CameraPose, uv: ArrayLike, z: ArrayLike) -> Floats:
    """Points at which the rays through pixels (..., 2) meet the level plane at height z (m, broadcast over ...).

    Returns:
        p_enu (..., 3) m; NaN for rays that do not come down on the plane.
    """
    return _on_level(intrinsics.rays(uv), pose, z)


def _on_level(rays: Floats, pose: CameraPose, z: ArrayLike) -> Floats:
    """Return the points at which unit rays (..., 3) in the camera frame meet the level plane."""
    ray = rays @ pose.R_enu_cam.T
    # p = c + s·ray with s = (z − c_z) / ray_z
    drop = np.asarray(z, dtype=np.float64) - pose.p_enu[2]
    meets = (np.abs(ray[..., 2]) > SKIM) & (drop * ray[..., 2] > 0)
    reach = np.where(meets, drop / np.where(meets, ray[..., 2], 1.0), np.nan)
    return np.asarray(pose.p_enu + reach[..., None] * ray)


def footprint(intrinsics: Intrinsics, pose: CameraPose, z: float) -> Floats | None:
    """Corners of the image on the ground (4, 2) east, north m, top left first; None when one is above the horizon."""
    border = _on_level(_grid(intrinsics, 2)[1], pose, z)[[0, 1, 3, 2], :2]
    return border if np.isfinite(border).all() else None


def ground_sampling(intrinsics: Intrinsics, pose: CameraPose, z: float) -> float:
    """Ground metres per pixel across the line of sight at the middle of the image; NaN above the horizon."""
    middle = ground(intrinsics, pose, np.array([intrinsics.width / 2, intrinsics.height / 2]), z)
    return float(np.linalg.norm(middle - pose.p_enu) / np.sqrt(intrinsics.fx * intrinsics.fy))


def image_warp(
    intrinsics: Intrinsics,
    pose_from: CameraPose,
    pose_to: CameraPose,
    z: float,
    *,
    intrinsics_to: Intrinsics | None = None,
) -> Floats:
    """Homography (3, 3) that carries pixels of the ground at height z from one image to another.

    Exact without distortion; with it, the best homography over the part of the image that shows ground. The
    identity where the camera is not above the ground, because there no homography relates the images.

    Args:
        pose_from: where it was taken.
        pose_to: where the other was.
        z: m.
        intrinsics_to: of the other, where the camera has zoomed between the two; None: the same.
    """
    if min(pose_from.p_enu[2], pose_to.p_enu[2]) - z < 0.1:
        return np.eye(3)
    later = intrinsics_to or intrinsics
    if not (intrinsics.distortion.any() or later.distortion.any()):
        return _normal(_plane(later, pose_to, z) @ np.linalg.inv(_plane(intrinsics, pose_from, z)))
    before, rays = _grid(intrinsics, 9)
    after, seen = project(later, pose_to, _on_level(rays, pose_from, z))
    seen &= np.isfinite(after).all(axis=-1)
    return _fit_homography(before[seen], after[seen]) if seen.sum() >= 8 else np.eye(3)


@lru_cache(maxsize=8)
def _grid(intrinsics: Intrinsics, side: int) -> tuple[Floats, Floats]:
    """Pixels (side², 2) over the image, row by row and corner to corner, and the rays (side², 3) through them."""
    x, y = (np.linspace(0, length, side) for length in (intrinsics.width, intrinsics.height))
    uv = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    return uv, intrinsics.rays(uv)


def _plane(intrinsics: Intrinsics, pose: CameraPose, z: float) -> Floats:
    """Homography from (east, north, 1) relative to the camera's foot to pixels: K Rᵀ [e1 e2 z·e3 − c]."""
    basis = np.array([[1.0, 0.0, -pose.p_enu[0]], [0.0, 1.0, -pose.p_enu[1]], [0.0, 0.0, z - pose.p_enu[2]]])
    return np.asarray(intrinsics.K @ pose.R_enu_cam.T @ basis)


def _fit_homography(a: Floats, b: Floats) -> Floats:
    """Least-squares homography (3, 3) taking points a (p, 2) to b (p, 2), in coordinates scaled to about 1."""
    centre, scale = a.mean(axis=0), np.abs(a - a.mean(axis=0)).max() + 1e-9
    T = np.array([[1 / scale, 0, -centre[0] / scale], [0, 1 / scale, -centre[1] / scale], [0, 0, 1]])
    (x, y), (u, v) = ((a - centre) / scale).T, ((b - centre) / scale).T
    one, nil = np.ones_like(x), np.zeros_like(x)
    # u (h7 x + h8 y + 1) = h1 x + h2 y + h3, and so for v
    rows = np.concatenate(
        [
            np.stack([x, y, one, nil, nil, nil, -u * x, -u * y], axis=-1),
            np.stack([nil, nil, nil, x, y, one, -v * x, -v * y], axis=-1),
        ]
    )
    h = np.linalg.lstsq(rows, np.concatenate([u, v]), rcond=None)[0]
    return _normal(np.linalg.inv(T) @ np.append(h, 1.0).reshape(3, 3) @ T)


def _normal(H: Floats) -> Floats:
    """Scaled so that the last entry is 1 where it can be."""
    return H / H[2, 2] if abs(H[2, 2]) > 1e-12 else H


def _yaw(R_enu_body: Floats) -> float:
    """Direction of the nose, clockwise from north."""
    return float(np.arctan2(R_enu_body[0, 0], R_enu_body[1, 0]))


def _turn_x(angle: float) -> Floats:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


def _turn_y(angle: float) -> Floats:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def _turn_z(angle: float) -> Floats:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
