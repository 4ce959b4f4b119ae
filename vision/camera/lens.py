"""Lens distortion of the normalised image plane and its exact undoing.

The five-coefficient model of OpenCV, k1 k2 p1 p2 k3 (D. C. Brown, "Close-range camera calibration", 1971). With
r² = x² + y² and radial = 1 + k1 r² + k2 r⁴ + k3 r⁶:

    x' = x·radial + 2 p1 x y + p2 (r² + 2 x²)
    y' = y·radial + p1 (r² + 2 y²) + 2 p2 x y
"""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

STEPS = 30
"""Most Newton steps that undo a distortion."""
CLOSE = 1e-10
"""Residual, in focal lengths, at which a point counts as found: far below 1e-6 px for any real camera."""
_PLAIN = np.eye(3)
"""Camera matrix of the normalised image."""
_FIXED_POINT = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 20, 1e-12)
"""Most fixed-point steps of a start, and the residual in focal lengths at which they end."""


def distort(xy: Floats, lens: Floats) -> Floats:
    """Ideal points (..., 2) as the lens (5,) shows them."""
    if not lens.any():
        return xy
    k1, k2, p1, p2, k3 = lens.tolist()
    x, y = xy[..., 0], xy[..., 1]
    r2 = x**2 + y**2
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    bent = np.empty(xy.shape)
    bent[..., 0] = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x**2)
    bent[..., 1] = y * radial + p1 * (r2 + 2 * y**2) + 2 * p2 * x * y
    return bent


def undistort(xy: Floats, lens: Floats) -> Floats:
    """Ideal points (..., 2) that the lens (5,) shows at these; NaN where none does.

    Newton's method from a starting point that fixed-point steps have brought near; a step may not leave the disc in
    which the model is one-to-one, so the answer is the true branch.
    """
    if not (lens.any() and xy.size):
        return xy
    limit = fold_radius(lens)
    ideal = _start(xy, lens, limit)
    error = distort(ideal, lens) - xy
    for _ in range(STEPS):
        if not (np.abs(error) > CLOSE).any():
            return ideal
        ideal = _clamp(ideal - _solve(_jacobian(ideal, lens), error), limit)
        error = distort(ideal, lens) - xy
    missed = np.abs(error).max(axis=-1) > CLOSE
    return np.where(missed[..., None], np.nan, ideal)


def fold_radius(lens: Floats) -> float:
    """Radius, in focal lengths, up to which the radial model grows; points beyond it fold back. inf: it always does."""
    k1, k2, _, _, k3 = lens.tolist()
    return _fold_radius(k1, k2, k3)


@lru_cache(maxsize=64)
def _fold_radius(k1: float, k2: float, k3: float) -> float:
    # coefficients too small to bend anything would only upset the root finding
    k1, k2, k3 = (0.0 if abs(k) < 1e-12 else k for k in (k1, k2, k3))
    if min(k1, k2, k3) >= 0:
        return float(np.inf)
    # d(r·radial)/dr = 1 + 3 k1 q + 5 k2 q² + 7 k3 q³ = 0 with q = r²
    roots = np.roots(np.array([7 * k3, 5 * k2, 3 * k1, 1.0]))
    real = roots[np.abs(roots.imag) < 1e-9].real
    return float(np.sqrt(real[real > 0].min(initial=np.inf)))


def _start(xy: Floats, lens: Floats, limit: float) -> Floats:
    """Fixed-point steps from the seen point: x ← (x' − tangential) / radial, which is enough for most lenses."""
    found = cv2.undistortImagePoints(xy.reshape(-1, 1, 2), _PLAIN, lens, None, _FIXED_POINT)
    return _clamp(np.where(np.isfinite(found), found, xy.reshape(-1, 1, 2)).reshape(xy.shape), limit)


def _clamp(xy: Floats, limit: float) -> Floats:
    """Points drawn back into the disc of 0.999 limit."""
    if not np.isfinite(limit):
        return xy
    r = np.linalg.norm(xy, axis=-1, keepdims=True)
    return np.asarray(xy * np.minimum(1.0, 0.999 * limit / np.maximum(r, 1e-12)))


def _jacobian(xy: Floats, lens: Floats) -> tuple[Floats, Floats, Floats]:
    """Entries xx, xy (= yx), yy of ∂distort/∂xy, each (...,)."""
    k1, k2, p1, p2, k3 = lens.tolist()
    x, y = xy[..., 0], xy[..., 1]
    r2 = x**2 + y**2
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    # ∂radial/∂x = 2 x · slope
    slope = k1 + r2 * (2 * k2 + r2 * 3 * k3)
    return (
        radial + 2 * x**2 * slope + 2 * p1 * y + 6 * p2 * x,
        2 * x * y * slope + 2 * p1 * x + 2 * p2 * y,
        radial + 2 * y**2 * slope + 6 * p1 * y + 2 * p2 * x,
    )


def _solve(jacobian: tuple[Floats, Floats, Floats], error: Floats) -> Floats:
    """J⁻¹ · error for symmetric 2 × 2 matrices."""
    xx, xy, yy = jacobian
    det = xx * yy - xy**2
    det = np.where(np.abs(det) < 1e-12, 1e-12, det)
    ex, ey = error[..., 0], error[..., 1]
    step = np.empty(error.shape)
    step[..., 0], step[..., 1] = (yy * ex - xy * ey) / det, (xx * ey - xy * ex) / det
    return step
