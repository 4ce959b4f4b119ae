"""SORT's filter of upright boxes, for all tracks at once, and their overlap: the ground that SORT and OC-SORT share.

State x = (u, v, s, r, u', v', s'): centre px, area px², aspect w / h, and the changes of the first three in a frame.

Reference: A. Bewley et al., "Simple Online and Realtime Tracking", ICIP 2016, arXiv:1602.00763, section 3.2; the noises
are those of the authors' release.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vision.detect.detections import Detections

__all__ = ["born", "box", "correct", "iou", "measured", "predict", "upright"]

FloatArray = NDArray[np.float64]

_F = np.eye(7) + np.eye(7, k=4)
_Q = np.diag([1.0, 1.0, 1.0, 1.0, 1e-2, 1e-2, 1e-4])
_R = np.diag([1.0, 1.0, 10.0, 10.0])
_P = np.diag([10.0, 10.0, 10.0, 10.0, 1e4, 1e4, 1e4])


def upright(boxes: Detections) -> FloatArray:
    """(m, 4) left, top, right, bottom around each oriented box."""
    corners = boxes.corners()
    return np.concatenate([corners.min(axis=1), corners.max(axis=1)], axis=1)


def measured(edges: FloatArray) -> FloatArray:
    """(m, 4) u, v, s, r of boxes given by their edges."""
    side = np.maximum(edges[:, 2:] - edges[:, :2], 1e-3)
    middle = 0.5 * (edges[:, :2] + edges[:, 2:])
    return np.column_stack([middle, side[:, 0] * side[:, 1], side[:, 0] / side[:, 1]])


def box(x: FloatArray) -> FloatArray:
    """(k, 4) edges of the boxes of states."""
    area, aspect = np.maximum(x[:, 2], 1e-3), np.maximum(x[:, 3], 1e-3)
    w = np.sqrt(area * aspect)
    half = 0.5 * np.column_stack([w, area / w])
    return np.concatenate([x[:, :2] - half, x[:, :2] + half], axis=1)


def born(z: FloatArray) -> tuple[FloatArray, FloatArray]:
    """States (k, 7) and covariances (k, 7, 7) of boxes seen once."""
    return np.concatenate([z, np.zeros((len(z), 3))], axis=1), np.tile(_P, (len(z), 1, 1))


def predict(x: FloatArray, P: FloatArray) -> tuple[FloatArray, FloatArray]:
    """One frame on; an area never shrinks below nothing."""
    x = x.copy()
    x[x[:, 2] + x[:, 6] <= 0, 6] = 0.0
    # x ← F x,  P ← F P Fᵀ + Q
    return x @ _F.T, _F @ P @ _F.T + _Q


def correct(x: FloatArray, P: FloatArray, z: FloatArray) -> tuple[FloatArray, FloatArray]:
    """After seeing z (k, 4)."""
    # K = P Hᵀ (H P Hᵀ + R)⁻¹
    K = np.linalg.solve(P[:, :4, :4] + _R, P[:, :4]).transpose(0, 2, 1)
    x = x + (K @ (z - x[:, :4])[:, :, None])[:, :, 0]
    return x, P - K @ P[:, :4]


def iou(a: FloatArray, b: FloatArray) -> FloatArray:
    """(p, q) overlap of boxes given by their edges."""
    low, high = np.maximum(a[:, None, :2], b[:, :2]), np.minimum(a[:, None, 2:], b[:, 2:])
    common = np.maximum(high - low, 0.0).prod(axis=2)
    area_a, area_b = (a[:, 2:] - a[:, :2]).prod(axis=1), (b[:, 2:] - b[:, :2]).prod(axis=1)
    return np.asarray(common / (area_a[:, None] + area_b - common))
