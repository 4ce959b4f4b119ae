"""Association of one frame by triangles alone: targets with the same neighbours at the same angles are the same (TTS).

Reference: X. Li, L. Wu, Y. Niu, A. Ma, "Multi-Target Association for UAVs Based on Triangular Topological Sequence",
Drones 2022, 6(5), 119, doi:10.3390/drones6050119; the method that Chen, Du and Wu (Drones 2025, 9(9), 612) compare
with. Positions only, no headings, no threshold.

Each view is triangulated (Delaunay). A target is described by the sequence of the triangles around it, each triangle by
three angles in degrees: at the target, and at its next and previous neighbour anticlockwise. With d the differences of
two triangles' angles, x a triangle of target a, y one of target b and φ the angle at the target,

    w(x, y) = 1 − ln(1 + 1.72 Σ|d| / 180)          1.72 ≈ e − 1: w is 1 for equal triangles, 0 for 180° apart
    S(a, b) = Σ_(x,y) (φ_x + φ_y) w(x, y) / (Σ_x φ_x + Σ_y φ_y)

A sequence begins where the turn to the next triangle is widest: at the opening of a fan on the rim.

The pairs (x, y) that are summed, of which the paper does not say enough, are those of the best cyclic alignment of the
shorter sequence with the longer one, so that S is at most 1; with all pairs fewer boxes are named rightly up to 4 m
of noise. In a second step one
affine map is fitted to the better half of the first step's pairs, and all targets are assigned again by their distance
under it.

Angles do not change under rotation, translation and scale, but a mirrored view has its sequences the wrong way round:
points are therefore (right, forward) as for :mod:`assoc.methods.topology`, +u and −v in the image.

Two points, points on a line and coinciding points have no triangles. Such a view has no similarity to anything, and
nothing is associated.
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.spatial import Delaunay, QhullError

from assoc.errors import ShapeError

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_SCALE = 1.72
"""Factor of the similarity w, see above."""
_COLLINEAR = 1e-9
"""Ratio of the second to the first singular value below which points count as collinear."""
_AFFINE_PAIRS = 3
"""Pairs needed to determine an affine map."""


def triangle_sequences(points: FloatArray) -> list[FloatArray] | None:
    """The triangles around every point.

    Args:
        points: (n, 2) as (right, forward), any unit.

    Returns:
        n arrays (k, 3), one row per triangle in anticlockwise order: degrees at the point itself, at the next and at
        the previous corner; None where there is no triangle.

    Raises:
        ShapeError: Not (n, 2).
    """
    if points.ndim != 2 or points.shape[1] != 2:
        raise ShapeError(f"TTS: expected points (n, 2), got {points.shape}")
    corners = _triangles(points)
    if corners is None:
        return None
    # each triangle once for each of its corners, the next corner anticlockwise second
    turned = np.concatenate([corners, corners[:, [1, 2, 0]], corners[:, [2, 0, 1]]])
    p = points[turned]
    middle = np.sum(p, axis=1) / 3.0 - p[:, 0]
    bearing = np.arctan2(middle[:, 1], middle[:, 0])
    order = np.lexsort((bearing, turned[:, 0]))
    ends = np.cumsum(np.bincount(turned[:, 0], minlength=len(points))).tolist()
    pieces = list(pairwise([0, *ends]))
    bearings = bearing[order].tolist()
    firsts = [start + _after_widest_gap(bearings[start:stop]) for start, stop in pieces]
    opened = [
        row for (start, stop), k in zip(pieces, firsts, strict=True) for row in (*range(k, stop), *range(start, k))
    ]
    angles = _angles(p[order[opened]])
    return [angles[start:stop] for start, stop in pieces]


def tts_similarity(image: FloatArray, world: FloatArray) -> FloatArray:
    """Similarity S of every track and vehicle.

    Args:
        image: (m, 2) tracks as (right, forward): +u, −v.
        world: (n, 2) vehicles as (right, forward): east, north in any rotation.

    Returns:
        (m, n), at most 1. All zero where either side has no triangle.
    """
    result = np.zeros((len(image), len(world)))
    a, b = triangle_sequences(image), triangle_sequences(world)
    if a is None or b is None:
        return result
    (x, k), (y, h) = _padded(a), _padded(b)
    # Σ|d| of all triangle pairs, then (φ_x + φ_y) w; pairs with padding are worth nothing
    d = sum(np.abs(x[:, None, :, None, c] - y[None, :, None, :, c]) for c in range(3))
    real = (np.arange(x.shape[1]) < k[:, None])[:, None, :, None] & (np.arange(y.shape[1]) < h[:, None])[None, :, None]
    term = real * (x[:, None, :, None, 0] + y[None, :, None, :, 0]) * (1.0 - np.log1p(_SCALE / 180.0 * d))
    summed = _aligned(term, k, h)
    norm = np.sum(x[..., 0], axis=1)[:, None] + np.sum(y[..., 0], axis=1)
    np.divide(summed, norm, out=result, where=norm > 0.0)
    return result


def associate_by_tts_once(similarity: FloatArray) -> IntArray:
    """The first step alone: largest total similarity (Hungarian algorithm).

    Args:
        similarity: (m, n).

    Returns:
        (m,) vehicle of each track, −1 for surplus tracks and for all where nothing is similar.
    """
    answer = np.full(len(similarity), -1, np.int64)
    if similarity.size and np.any(similarity != 0.0):
        rows, columns = linear_sum_assignment(similarity, maximize=True)
        answer[rows] = columns
    return answer


def associate_by_tts(image: FloatArray, world: FloatArray) -> IntArray:
    """Associate in both steps: by similarity, then by distance under the affine map fitted to the best pairs.

    Args:
        image: (m, 2) tracks as (right, forward).
        world: (n, 2) vehicles as (right, forward).

    Returns:
        (m,) vehicle of each track, −1 for surplus tracks and for all where there is no triangle.
    """
    similarity = tts_similarity(image, world)
    first = associate_by_tts_once(similarity)
    tracks = np.flatnonzero(first >= 0)
    if len(tracks) < _AFFINE_PAIRS:
        return first
    trusted = tracks[np.argsort(-similarity[tracks, first[tracks]], kind="stable")]
    trusted = trusted[: max(_AFFINE_PAIRS, (len(tracks) + 1) // 2)]
    # y ≈ A x + t, least squares over the trusted pairs
    x = np.concatenate([world, np.ones((len(world), 1))], axis=1)
    chosen = x[first[trusted]]
    if np.linalg.matrix_rank(chosen) < _AFFINE_PAIRS:
        return first
    affine = np.linalg.lstsq(chosen, image[trusted], rcond=None)[0]
    away = np.linalg.norm(image[:, None, :] - (x @ affine)[None, :, :], axis=2)
    rows, columns = linear_sum_assignment(away)
    answer = np.full(len(image), -1, np.int64)
    answer[rows] = columns
    return answer


def _triangles(points: FloatArray) -> IntArray | None:
    """(k, 3) corners anticlockwise, None without any."""
    if len(points) < 3 or not np.isfinite(points).all():
        return None
    spread = np.linalg.svd(points - np.mean(points, axis=0), compute_uv=False)
    if spread[1] <= _COLLINEAR * spread[0]:
        return None
    try:
        corners = np.asarray(Delaunay(points).simplices, np.int64)
    except QhullError:
        return None
    p = points[corners]
    u, v = p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]
    clockwise = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0] < 0.0
    return np.where(clockwise[:, None], corners[:, ::-1], corners)


def _after_widest_gap(bearings: list[float]) -> int:
    """Index of the direction, in ascending order, that follows the widest gap."""
    if len(bearings) < 2:
        return 0
    gaps = [b - a for a, b in pairwise([bearings[-1] - 2.0 * math.pi, *bearings])]
    return gaps.index(max(gaps))


def _angles(p: FloatArray) -> FloatArray:
    """(k, 3) degrees at the three corners of triangles (k, 3, 2)."""
    u, v = p[:, [1, 2, 0]] - p, p[:, [2, 0, 1]] - p
    cross = u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0]
    return np.asarray(np.degrees(np.arctan2(np.abs(cross), np.sum(u * v, axis=-1))))


def _padded(sequences: list[FloatArray]) -> tuple[FloatArray, IntArray]:
    """(n, K, 3) sequences filled up with zeros, and their lengths (n,)."""
    length = np.array([len(s) for s in sequences], np.int64)
    result = np.zeros((len(sequences), int(np.max(length)), 3))
    result[np.arange(result.shape[1]) < length[:, None]] = np.concatenate(sequences)
    return result, length


def _aligned(term: FloatArray, k: IntArray, h: IntArray) -> FloatArray:
    """(m, n) largest sum over cyclic alignments of a sequence of k triangles with one of h, terms (m, n, K, L)."""
    m, n, width, depth = term.shape
    short, long = (f(k[:, None], h[None, :]) for f in (np.minimum, np.maximum))
    first = (k[:, None] <= h[None, :])[..., None, None]
    at, shift = np.arange(min(width, depth)), np.arange(max(width, depth))[:, None]
    # triangle i of the shorter sequence is compared with triangle i + shift of the longer
    partner = (at + shift) % np.maximum(long, 1)[..., None, None]
    cell = np.where(first, at * depth + partner, partner * depth + at)
    value = term.ravel()[np.arange(0, term.size, width * depth).reshape(m, n, 1, 1) + cell]
    return np.asarray(np.max(np.sum(value * (at < short[..., None, None]), axis=3), axis=2))
