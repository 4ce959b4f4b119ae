"""The homography that most pairs of points agree on, and how sure it is across the image.

Reference:
    R. Hartley, A. Zisserman, "Multiple View Geometry", 2nd ed., section 5.2 (covariance of an estimated homography).
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

INLIER_PX = 0.6
"""Largest distance from its place of a point that follows the homography."""
MIN_INLIERS = 24
"""Least number of points: three times the eight numbers of a homography."""
MAX_TRIES = 500
"""Samples of four points: where a third of all follow one homography, one of them is right with 99.8 %."""
MAX_CORNER_STD_PX = 1.5
"""Largest uncertainty at the picture's corners, 1σ."""
MAX_SCALE = 1.6
"""Largest factor by which a picture can grow or shrink from one frame to the next, in length."""
MIN_STD_PX = 0.02
"""1σ of a followed point at least: the search ends within such a step."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlaneFit:
    """A homography fitted to pairs of points."""

    H: Floats
    """(3, 3), its last entry is 1."""
    std: float
    """1σ per axis of the points that follow it, px."""
    inliers: NDArray[np.bool_]
    """(k,) which follow it."""


def mapped(H: Floats, points: Floats) -> Floats:
    """Points (k, 2) where a homography puts them, (k, 2)."""
    x = points @ H[:, :2].T + H[:, 2]
    return np.asarray(x[:, :2] / x[:, 2:])


def fit_plane(a: Floats, b: Floats, size: tuple[int, int], least: int) -> PlaneFit | None:
    """Fit the homography that takes points a (k, 2) to b (k, 2), px.

    Args:
        size: width and height of both, px.

    Returns:
        None where fewer do, or where it says nothing that can be relied on about some corner of the picture.
    """
    if len(a) < max(least, MIN_INLIERS):
        return None
    H, _ = cv2.findHomography(a, b, cv2.USAC_MAGSAC, INLIER_PX, maxIters=MAX_TRIES)
    if H is None or not np.isfinite(H).all() or abs(H[2, 2]) < 1e-9:
        return None
    H = np.asarray(H, dtype=np.float64) / H[2, 2]
    residual = mapped(H, a) - b
    inliers = (residual * residual).sum(axis=1) < INLIER_PX**2
    count = int(np.count_nonzero(inliers))
    if count < max(least, MIN_INLIERS) or not _possible(H, size):
        return None
    # two equations a point, eight unknowns
    std = max(float(np.sqrt((residual[inliers] ** 2).sum() / (2 * count - 8))), MIN_STD_PX)
    if _corner_std(H, a[inliers], std, size) > MAX_CORNER_STD_PX:
        return None
    return PlaneFit(H=H, std=std, inliers=inliers)


def _possible(H: Floats, size: tuple[int, int]) -> bool:
    """Tell whether it maps the picture to one of nearly its size that is not turned over."""
    corners = _corners(size)
    if ((corners @ H[2, :2] + 1.0) <= 0.0).any():
        return False
    # det J of (x, y) → (u, v) is det H / w³
    growth = np.linalg.det(H) / (corners @ H[2, :2] + 1.0) ** 3
    return bool((growth > MAX_SCALE**-2).all() and (growth < MAX_SCALE**2).all())


def _corner_std(H: Floats, a: Floats, std: float, size: tuple[int, int]) -> float:
    """1σ of where it puts the worst of the picture's corners, px."""
    # C = σ² (JᵀJ)⁻¹ over the points, then J C Jᵀ at the corners
    J = _jacobian(H, a).reshape(-1, 8)
    at = _jacobian(H, _corners(size))
    try:
        spread = np.linalg.solve(J.T @ J, at.reshape(-1, 8).T)
    except np.linalg.LinAlgError:
        return float("inf")
    return float(std * np.sqrt(np.abs(np.einsum("ij,ji->i", at.reshape(-1, 8), spread)).max()))


def _jacobian(H: Floats, points: Floats) -> Floats:
    """(k, 2, 8) derivative of mapped points by the first eight entries of H."""
    x, y = points.T
    w = points @ H[2, :2] + H[2, 2]
    u, v = mapped(H, points).T
    one, nil = np.ones_like(x), np.zeros_like(x)
    rows = np.stack(
        [
            np.stack([x, y, one, nil, nil, nil, -u * x, -u * y], axis=-1),
            np.stack([nil, nil, nil, x, y, one, -v * x, -v * y], axis=-1),
        ],
        axis=1,
    )
    return np.asarray(rows / w[:, None, None])


def _corners(size: tuple[int, int]) -> Floats:
    """Corners of the picture (4, 2), px."""
    width, height = size
    return np.array([[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]])
