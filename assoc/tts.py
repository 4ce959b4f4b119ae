"""Association of one frame by triangles alone: who has the same neighbours at the same angles (TTS).

Reference: X. Li, L. Wu, Y. Niu, A. Ma, "Multi-Target Association for UAVs Based on Triangular Topological Sequence",
Drones 2022, 6(5), 119, doi:10.3390/drones6050119; the method that Chen, Du and Wu (Drones 2025, 9(9), 612) compare
with. Positions only, no headings, no threshold.

Each view is triangulated (Delaunay). A target is described by the sequence of the triangles around it, each triangle by
three angles in degrees: at the target, and at its next and previous neighbour anticlockwise. With d the differences of
two triangles' angles, x a triangle of target a, y one of target b and φ the angle at the target,

    w(x, y) = 1 − ln(1 + 1.72 Σ|d| / 180)          1.72 ≈ e − 1: w is 1 for equal triangles, 0 for 180° apart
    S(a, b) = Σ_(x,y) (φ_x + φ_y) w(x, y) / (Σ_x φ_x + Σ_y φ_y)

Where the source leaves room, both readings are named. Which pairs (x, y) are summed: ``"sequence"``, the best cyclic
alignment of the shorter sequence with the longer one, bounded by 1, or ``"pairs"``, all of them. The second step: one
affine map is fitted to the better half of the first step's pairs, and everybody is assigned again by distance under it.

Angles do not change under rotation, translation and scale, but a mirrored view has its sequences the wrong way round:
points are therefore (right, forward) as for :mod:`assoc.topology`, +u and −v in the picture.

Two points, points on a line and coinciding points have no triangles. Such a view has no similarity to anything, and
nobody is associated.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.spatial import Delaunay, QhullError

from assoc.errors import ShapeError

__all__ = ["Reading", "associate_by_tts", "associate_by_tts_once", "triangle_sequences", "tts_similarity"]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Reading = Literal["sequence", "pairs"]

_SCALE = 1.72
_FLAT = 1e-9
_AFFINE = 3


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
    rows: list[FloatArray] = []
    # every triangle is seen from each of its corners, next corner anticlockwise second
    turned = np.concatenate([corners, np.roll(corners, -1, axis=1), np.roll(corners, -2, axis=1)])
    angle = _angles(points[turned])
    middle = np.mean(points[turned], axis=1) - points[turned[:, 0]]
    bearing = np.arctan2(middle[:, 1], middle[:, 0])
    for target in range(len(points)):
        mine = np.flatnonzero(turned[:, 0] == target)
        rows.append(angle[mine[np.argsort(bearing[mine], kind="stable")]])
    return rows


def tts_similarity(image: FloatArray, world: FloatArray, reading: Reading = "sequence") -> FloatArray:
    """S of every track and vehicle.

    Args:
        image: (m, 2) tracks as (right, forward): +u, −v.
        world: (n, 2) vehicles as (right, forward): east, north in any rotation.
        reading: Which pairs of triangles are summed.

    Returns:
        (m, n); "sequence" is at most 1. All zero where either side has no triangle.
    """
    result = np.zeros((len(image), len(world)))
    a, b = triangle_sequences(image), triangle_sequences(world)
    if a is None or b is None:
        return result
    for rows, x in _by_length(a):
        for columns, y in _by_length(b):
            result[np.ix_(rows, columns)] = _similarity(x, y, reading)
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


def associate_by_tts(image: FloatArray, world: FloatArray, reading: Reading = "sequence") -> IntArray:
    """Both steps.

    Args:
        image: (m, 2) tracks as (right, forward).
        world: (n, 2) vehicles as (right, forward).
        reading: Which pairs of triangles are summed.

    Returns:
        (m,) vehicle of each track, −1 for surplus tracks and for all where there is no triangle.
    """
    similarity = tts_similarity(image, world, reading)
    first = associate_by_tts_once(similarity)
    tracks = np.flatnonzero(first >= 0)
    if len(tracks) < _AFFINE:
        return first
    trusted = tracks[np.argsort(-similarity[tracks, first[tracks]], kind="stable")]
    trusted = trusted[: max(_AFFINE, (len(tracks) + 1) // 2)]
    # y ≈ A x + t, least squares over the trusted pairs
    x = np.concatenate([world, np.ones((len(world), 1))], axis=1)
    chosen = x[first[trusted]]
    if np.linalg.matrix_rank(chosen) < _AFFINE:
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
    if spread[1] <= _FLAT * max(spread[0], 1e-300):
        return None
    try:
        corners = np.asarray(Delaunay(points).simplices, np.int64)
    except QhullError:
        return None
    p = points[corners]
    u, v = p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]
    clockwise = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0] < 0.0
    return np.where(clockwise[:, None], corners[:, ::-1], corners)


def _angles(p: FloatArray) -> FloatArray:
    """(k, 3) degrees at the three corners of triangles (k, 3, 2)."""
    u, v = np.roll(p, -1, axis=1) - p, np.roll(p, -2, axis=1) - p
    cross = u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0]
    return np.asarray(np.degrees(np.arctan2(np.abs(cross), np.sum(u * v, axis=-1))))


def _by_length(sequences: list[FloatArray]) -> list[tuple[IntArray, FloatArray]]:
    """Targets with equally many triangles together: their rows (g,) and sequences (g, k, 3)."""
    length = np.array([len(s) for s in sequences])
    groups = []
    for k in np.unique(length[length > 0]):
        rows = np.flatnonzero(length == k)
        groups.append((rows, np.stack([sequences[i] for i in rows])))
    return groups


def _similarity(x: FloatArray, y: FloatArray, reading: Reading) -> FloatArray:
    """(g, h) S between targets x (g, k, 3) and y (h, l, 3)."""
    d = np.sum(np.abs(x[:, None, :, None, :] - y[None, :, None, :, :]), axis=-1)
    # (φ_x + φ_y) w
    weight = x[:, None, :, None, 0] + y[None, :, None, :, 0]
    term = weight * (1.0 - np.log1p(_SCALE * d / 180.0))
    norm = np.sum(x[:, None, :, 0], axis=-1) + np.sum(y[None, :, :, 0], axis=-1)
    if reading == "pairs":
        return np.asarray(np.sum(term, axis=(2, 3)) / norm)
    if term.shape[2] > term.shape[3]:
        term = np.swapaxes(term, 2, 3)
    short, long = np.arange(term.shape[2]), np.arange(term.shape[3])
    # one alignment per shift: triangle i of the shorter sequence meets triangle i + shift of the longer
    met = term[:, :, short[None, :], (short[None, :] + long[:, None]) % len(long)]
    return np.asarray(np.max(np.sum(met, axis=3), axis=2) / norm)
