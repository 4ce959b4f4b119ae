"""A camera's map from rays to pixels: focal lengths, principal point and lens, and what size and zoom change of them.

Reference:
    D. C. Brown, "Close-range camera calibration", Photogrammetric Engineering 37(8), 1971, in the form of OpenCV's
    ``projectPoints`` with five coefficients k1 k2 p1 p2 k3.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vision.camera.lens import distort, fold_radius, undistort
from vision.errors import CameraError

Floats = NDArray[np.float64]

SAME_ASPECT = 0.01
"""Share by which aspects may differ: codecs round sides to even numbers, some to whole blocks of 16."""
SQUARE = 0.1
"""Share by which pixels may be wider than high before the two fields of view cannot belong to one image."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Intrinsics:
    """A pinhole camera with a radial-tangential lens.

    Pixels are continuous: (0, 0) is the image's upper left corner, so the middle of the first pixel is at (0.5, 0.5)
    and ``cx``, ``cy`` are half a pixel more than OpenCV's.

    Raises:
        CameraError: sizes or focal lengths that are not positive, a number that is not finite, a wrong shape.
    """

    width: int
    """px"""
    height: int
    fx: float
    """Focal length, px."""
    fy: float
    cx: float
    """Principal point, px."""
    cy: float
    distortion: Floats = field(default_factory=lambda: np.zeros(5))
    """(5,) k1 k2 p1 p2 k3, of the normalised image."""

    def __post_init__(self) -> None:
        lens = np.array(self.distortion, dtype=np.float64)
        if lens.shape != (5,):
            raise CameraError(f"camera distortion needs the five numbers k1 k2 p1 p2 k3, got shape {lens.shape}")
        lens.flags.writeable = False
        object.__setattr__(self, "distortion", lens)
        if min(self.width, self.height, self.fx, self.fy) <= 0:
            raise CameraError(
                f"camera width, height, fx and fy must be positive, got {self.width} {self.height} {self.fx} {self.fy}"
            )
        if not (np.isfinite([self.fx, self.fy, self.cx, self.cy]).all() and np.isfinite(lens).all()):
            raise CameraError("camera intrinsics must be finite numbers, got NaN or infinity")

    @property
    def K(self) -> Floats:  # noqa: N802 - the field's name of the matrix
        """Camera matrix (3, 3)."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    @property
    def corners(self) -> Floats:
        """Corners of the image (4, 2) px, top left first, clockwise."""
        w, h = float(self.width), float(self.height)
        return np.array([[0.0, 0.0], [w, 0.0], [w, h], [0.0, h]])

    def rays(self, uv: ArrayLike) -> Floats:
        """Unit rays (..., 3) in the camera frame through pixels (..., 2), distortion removed; NaN beyond the lens."""
        pixels = np.asarray(uv, dtype=np.float64)
        seen = (pixels - (self.cx, self.cy)) / (self.fx, self.fy)
        ideal = undistort(seen, self.distortion)
        ray = np.ones((*ideal.shape[:-1], 3))
        ray[..., :2] = ideal
        return np.asarray(ray / np.sqrt(np.add.reduce(ray * ray, axis=-1, keepdims=True)))

    def pixels(self, p_cam: ArrayLike) -> tuple[Floats, NDArray[np.bool_]]:
        """Pixels (..., 2) of points (..., 3) in the camera frame, and whether each can be seen (...,).

        NaN for points behind the camera or so far aside that the lens model folds back into the image.
        """
        p = np.asarray(p_cam, dtype=np.float64)
        ahead = p[..., 2] > 1e-9
        ideal = p[..., :2] / np.where(ahead, p[..., 2], 1.0)[..., None]
        seen = ahead & ((ideal**2).sum(axis=-1) < fold_radius(self.distortion) ** 2)
        ideal = np.where(seen[..., None], ideal, np.nan)
        uv = distort(ideal, self.distortion) * (self.fx, self.fy) + (self.cx, self.cy)
        return np.asarray(uv), np.asarray(seen)

    @property
    def hfov(self) -> float:
        """Field of view across the image without the lens's distortion, rad."""
        return float(np.arctan(self.cx / self.fx) + np.arctan((self.width - self.cx) / self.fx))


@lru_cache(maxsize=8)
def resized(intrinsics: Intrinsics, width: int, height: int, *, drawn_out: bool = False) -> Intrinsics:
    """Return the camera as it delivers an image of another size.

    Args:
        intrinsics: as it is described.
        width: px.
        height: px.
        drawn_out: an image of another aspect shows the same part of the sensor: its pixels were not square.

    Raises:
        CameraError: the image has another aspect, so it shows another part of the sensor; which one is not known.
    """
    if (width, height) == (intrinsics.width, intrinsics.height):
        return intrinsics
    kx, ky = width / intrinsics.width, height / intrinsics.height
    if abs(kx / ky - 1.0) > SAME_ASPECT and not drawn_out:
        raise CameraError(
            f"the camera is described for images of {intrinsics.width}×{intrinsics.height}, these are "
            f"{width}×{height}: another aspect shows another part of the sensor; calibrate on such images"
        )
    return replace(
        intrinsics,
        width=width,
        height=height,
        fx=intrinsics.fx * kx,
        fy=intrinsics.fy * ky,
        cx=intrinsics.cx * kx,
        cy=intrinsics.cy * ky,
    )


@lru_cache(maxsize=8)
def zoomed(intrinsics: Intrinsics, factor: float) -> Intrinsics:
    """Return the camera with its image magnified about the middle, as digital zoom does.

    The lens's coefficients belong to rays, so they stay. An optical zoom bends in its own way: calibrate it where it is
    used.
    """
    if factor == 1.0:
        return intrinsics
    middle_x, middle_y = intrinsics.width / 2.0, intrinsics.height / 2.0
    return replace(
        intrinsics,
        fx=intrinsics.fx * factor,
        fy=intrinsics.fy * factor,
        cx=middle_x + (intrinsics.cx - middle_x) * factor,
        cy=middle_y + (intrinsics.cy - middle_y) * factor,
    )


def from_field_of_view(width: int, height: int, hfov: float, vfov: float) -> tuple[Intrinsics, bool]:
    """A camera without distortion that sees these angles (rad, one may be NaN).

    Returns:
        The camera, and whether both angles were used. Where they would make pixels that are not square they belong to a
        image of another aspect, and the horizontal one counts: cameras cut their images above and below.
    """
    # f = (w / 2) / tan(fov / 2)
    fx, fy = width / 2.0 / np.tan(hfov / 2.0), height / 2.0 / np.tan(vfov / 2.0)
    fits = bool(abs(fx / fy - 1.0) <= SQUARE)
    if not fits:
        fx = fy = fy if np.isnan(fx) else fx
    camera = Intrinsics(width=width, height=height, fx=float(fx), fy=float(fy), cx=width / 2.0, cy=height / 2.0)
    return camera, fits
