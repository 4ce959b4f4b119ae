"""How what a camera sees depends on its rotation.

Camera frame: OpenCV, x right, y down, z forward; a camera's rotation R maps its vectors into the world, and its error
is ξ with R_true = R Exp ξ.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def image_jacobians(d: Floats, R: Floats) -> tuple[Floats, Floats, Floats]:
    """Where places are in the image, and how that depends on the camera's rotation and on the places.

    Args:
        d: (k, 3) from the camera to the places, in its frame.
        R: (3, 3) the camera's rotation.

    Returns:
        u (k, 2) = d_xy / d_z; ∂u/∂ξ (k, 2, 3); ∂u/∂g (k, 2, 2) by a place's first two world coordinates.
    """
    # d = Exp(−ξ) Rᵀ (g − p):  ∂d/∂ξ = [d]×,  ∂d/∂g = Rᵀ
    u = d[:, :2] / d[:, 2:]
    by_d = np.zeros((len(d), 2, 3))
    by_d[:, 0, 0] = by_d[:, 1, 1] = 1.0 / d[:, 2]
    by_d[:, :, 2] = -u / d[:, 2:]
    return u, by_d @ _cross(d), by_d @ R.T[:, :2]


def ground_jacobians(ray: Floats, R: Floats, height: float) -> tuple[Floats, Floats, Floats]:
    """Where rays meet level ground, and how that depends on the camera's rotation and on the rays.

    Args:
        ray: (k, 3) in the camera's frame, all falling.
        R: (3, 3) the camera's rotation.
        height: of the camera above the ground, metres.

    Returns:
        Places g (k, 2) from the camera's foot; ∂g/∂ξ (k, 2, 3); ∂g/∂u (k, 2, 2) by a ray's first two coordinates.
    """
    # g = s d with d = R ray, s = −h / d_z:  ∂g/∂d = s (I − d e_zᵀ / d_z), first two rows;  ∂d/∂ξ = −R [ray]×
    d = ray @ R.T
    s = -height / d[:, 2]
    by_d = np.zeros((len(d), 2, 3))
    by_d[:, 0, 0] = by_d[:, 1, 1] = s
    by_d[:, :, 2] = -s[:, None] * d[:, :2] / d[:, 2:]
    return s[:, None] * d[:, :2], -by_d @ R @ _cross(ray), by_d @ R[:, :2]


def _cross(v: Floats) -> Floats:
    """(k, 3, 3) matrices [v]× of vectors (k, 3)."""
    K = np.zeros((len(v), 3, 3))
    K[:, 0, 1], K[:, 0, 2], K[:, 1, 2] = -v[:, 2], v[:, 1], -v[:, 0]
    K[:, 1, 0], K[:, 2, 0], K[:, 2, 1] = v[:, 2], -v[:, 1], v[:, 0]
    return K
