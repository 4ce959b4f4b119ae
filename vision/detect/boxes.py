"""Oriented boxes: overlap, suppression, conversions. Pure functions on rows ``cx cy w h angle``.

Pixels: x right, y down; ``angle`` (rad) turns image +x into the width axis, clockwise on screen. Coordinates are
continuous: the image spans 0..width and 0..height, a pixel's centre is at + 0.5.

References:
    J. Murrugarra-Llerena, L. N. Kirsten, C. R. Jung, "Gaussian Bounding Boxes and Probabilistic
    Intersection-over-Union for Object Detection", arXiv:2106.06072, section 3 (Hellinger distance of two boxes).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]

_UNIT = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])


def wrap(angle: ArrayLike) -> Floats:
    """Wrap a direction into [-π, π)."""
    return np.asarray((np.asarray(angle, dtype=np.float64) + np.pi) % (2 * np.pi) - np.pi)


def corners(boxes: ArrayLike) -> Floats:
    """Corners (..., 4, 2) of boxes (..., 5), clockwise on screen from the one that is top left at angle 0."""
    rows = np.asarray(boxes, dtype=np.float64)
    # p = c + R(angle) · diag(w, h) · unit corner
    local = _UNIT * rows[..., None, 2:4]
    c, s = np.cos(rows[..., 4, None]), np.sin(rows[..., 4, None])
    x = rows[..., 0, None] + c * local[..., 0] - s * local[..., 1]
    y = rows[..., 1, None] + s * local[..., 0] + c * local[..., 1]
    return np.stack([x, y], axis=-1)


def hull(boxes: ArrayLike) -> Floats:
    """Upright boxes (..., 4) ``x0 y0 x1 y1`` around oriented boxes (..., 5)."""
    points = corners(boxes)
    return np.concatenate([points.min(axis=-2), points.max(axis=-2)], axis=-1)


def canonical(boxes: ArrayLike) -> Floats:
    """Return rectangles (..., 5) with w ≥ h and the angle in [-π/2, π/2): one row per rectangle, front forgotten."""
    rows = np.array(boxes, dtype=np.float64)
    w, h, angle = rows[..., 2].copy(), rows[..., 3].copy(), rows[..., 4]
    turned = h > w
    rows[..., 2], rows[..., 3] = np.where(turned, h, w), np.where(turned, w, h)
    rows[..., 4] = (angle + np.where(turned, np.pi / 2, 0.0) + np.pi / 2) % np.pi - np.pi / 2
    return rows


def rotated_iou(a: ArrayLike, b: ArrayLike) -> Floats:
    """Exact intersection over union of every pair.

    Args:
        a: (m, 5) boxes.
        b: (k, 5) boxes.

    Returns:
        (m, k) in [0, 1]; 0 for boxes without area.
    """
    rows_a, rows_b = _rows(a), _rows(b)
    iou = np.zeros((len(rows_a), len(rows_b)))
    i, j = _touching(hull(rows_a), hull(rows_b))
    if len(i):
        area = _intersection(rows_a[i], rows_b[j])
        union = rows_a[i, 2] * rows_a[i, 3] + rows_b[j, 2] * rows_b[j, 3] - area
        iou[i, j] = np.clip(area / np.where(union > 0, union, np.inf), 0.0, 1.0)
    return iou


def prob_iou(a: ArrayLike, b: ArrayLike) -> Floats:
    """Probabilistic overlap of every pair: 1 − Hellinger distance of the boxes as Gaussians (arXiv:2106.06072).

    Smooth, never undefined, and above 0 also for boxes that only come near each other; cheap enough for thousands of
    pairs. A box of sides w, h is the Gaussian with the variance of a uniform rectangle, w²/12 and h²/12.

    Args:
        a: (m, 5) boxes.
        b: (k, 5) boxes.

    Returns:
        (m, k) in [0, 1].
    """
    return prob_iou_pairs(_rows(a)[:, None], _rows(b)[None])


def prob_iou_pairs(a: Floats, b: Floats) -> Floats:
    """Probabilistic overlap of boxes (..., 5) with boxes (..., 5), element by element with broadcasting: (...)."""
    mean_a, u_a, v_a, area_a = _gaussian(a)
    mean_b, u_b, v_b, area_b = _gaussian(b)
    # S = Σa + Σb (twice the mean covariance), d = μa − μb
    mean, u, v = mean_a + mean_b, u_a + u_b, v_a + v_b
    dx, dy = a[..., 0] - b[..., 0], a[..., 1] - b[..., 1]
    xx, yy = dx * dx, dy * dy
    det = mean * mean - u * u - v * v
    # e^−B = e^(−¼ dᵀ S⁻¹ d) · √(4 √(det Σa · det Σb) / det S),  √det Σ = w h / 12
    near = (mean * (xx + yy) - u * (xx - yy) - 2.0 * v * dx * dy) / (4.0 * det)
    alike = np.exp(-near) * np.sqrt(area_a * area_b / (36.0 * det))
    # H = √(1 − e^−B)
    return np.asarray(1.0 - np.sqrt(np.maximum(1.0 - alike, 0.0)))


def nms(boxes: ArrayLike, score: ArrayLike, overlap: float = 0.45) -> NDArray[np.intp]:
    """Keep the best of boxes of the same object: greedy suppression by probabilistic overlap.

    Args:
        boxes: (m, 5) boxes.
        score: (m,) higher is better.
        overlap: raise → boxes close together survive; lower → fewer doubles.

    Returns:
        Indices of the survivors, best score first.
    """
    rows, value = _rows(boxes), np.asarray(score, dtype=np.float64)
    order = np.argsort(-value, kind="stable")
    clash = prob_iou(rows[order], rows[order]) > overlap
    alive = np.ones(len(order), dtype=bool)
    for i in range(len(order)):
        if alive[i]:
            alive[i + 1 :] &= ~clash[i, i + 1 :]
    return order[alive]


def _rows(boxes: ArrayLike) -> Floats:
    rows = np.asarray(boxes, dtype=np.float64)
    if rows.size == 0:
        return np.empty((0, 5))
    if rows.ndim != 2 or rows.shape[1] != 5:
        raise ValueError(f"boxes need rows of cx cy w h angle, shape (m, 5), got {rows.shape}")
    return rows


def _gaussian(rows: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Covariance R diag(w²/12, h²/12) Rᵀ as m, u, v with the entries xx = m + u, yy = m − u, xy = v; and w h.

    A side below a tenth of a pixel counts as that.
    """
    w, h = np.maximum(rows[..., 2], 0.1), np.maximum(rows[..., 3], 0.1)
    along, across, twice = w * w, h * h, 2.0 * rows[..., 4]
    # m = (w² + h²) / 24,  (u, v) = (w² − h²) / 24 · (cos 2θ, sin 2θ)
    uneven = (along - across) / 24.0
    return (along + across) / 24.0, uneven * np.cos(twice), uneven * np.sin(twice), w * h


def _touching(a: Floats, b: Floats) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Pairs whose upright hulls overlap."""
    low = np.maximum(a[:, None, :2], b[None, :, :2])
    high = np.minimum(a[:, None, 2:], b[None, :, 2:])
    i, j = np.nonzero((low < high).all(axis=-1))
    return i, j


def _intersection(a: Floats, b: Floats) -> Floats:
    """Area (p,) of the common polygon of the p pairs a[i], b[i] (p, 5).

    The corners of the common polygon are the corners of either box inside the other and the crossings of their
    edges; put in order about their mean, the shoelace formula gives the area.
    """
    ca, cb = corners(a), corners(b)
    crossing, real = _crossings(ca, cb)
    points = np.concatenate([ca, cb, crossing], axis=1)
    valid = np.concatenate([_inside(ca, b), _inside(cb, a), real], axis=1)
    count = np.maximum(valid.sum(axis=1), 1)
    mean = np.where(valid[..., None], points, 0.0).sum(axis=1) / count[:, None]
    offset = points - mean[:, None]
    turn = np.where(valid, np.arctan2(offset[..., 1], offset[..., 0]), np.inf)
    order = np.argsort(turn, axis=1)
    ring = np.take_along_axis(offset, order[..., None], axis=1)
    kept = np.take_along_axis(valid, order, axis=1)
    # points that are not corners fall onto the first one and add no area
    ring = np.where(kept[..., None], ring, ring[:, :1])
    following = np.roll(ring, -1, axis=1)
    twice = (ring[..., 0] * following[..., 1] - ring[..., 1] * following[..., 0]).sum(axis=1)
    return np.where(valid.sum(axis=1) >= 3, np.abs(twice) / 2, 0.0)


def _inside(points: Floats, box: Floats) -> NDArray[np.bool_]:
    """Tell whether points (p, 4, 2) lie in the boxes (p, 5), edges included."""
    d = points - box[:, None, :2]
    c, s = np.cos(box[:, None, 4]), np.sin(box[:, None, 4])
    along, across = np.abs(c * d[..., 0] + s * d[..., 1]), np.abs(-s * d[..., 0] + c * d[..., 1])
    slack = 1e-9 * (1 + box[:, None, 2] + box[:, None, 3])
    return np.asarray((along <= box[:, None, 2] / 2 + slack) & (across <= box[:, None, 3] / 2 + slack))


def _crossings(a: Floats, b: Floats) -> tuple[Floats, NDArray[np.bool_]]:
    """Return where the 4 × 4 edges of corner rings (p, 4, 2) cross: points (p, 16, 2) and whether they are real."""
    edge_a, edge_b = np.roll(a, -1, axis=1) - a, np.roll(b, -1, axis=1) - b
    gap = b[:, None, :] - a[:, :, None]
    # a + t·ea = b + u·eb  ⇒  t = (gap × eb) / (ea × eb),  u = (gap × ea) / (ea × eb)
    ea, eb = edge_a[:, :, None], edge_b[:, None, :]
    cross = ea[..., 0] * eb[..., 1] - ea[..., 1] * eb[..., 0]
    parallel = np.abs(cross) < 1e-12
    safe = np.where(parallel, 1.0, cross)
    t = (gap[..., 0] * eb[..., 1] - gap[..., 1] * eb[..., 0]) / safe
    u = (gap[..., 0] * ea[..., 1] - gap[..., 1] * ea[..., 0]) / safe
    real = ~parallel & (t >= 0) & (t <= 1) & (u >= 0) & (u <= 1)
    points = a[:, :, None] + t[..., None] * ea
    return points.reshape(len(a), 16, 2), real.reshape(len(a), 16)
