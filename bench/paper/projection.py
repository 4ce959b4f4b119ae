"""Projection-based association: every assignment fits its own projection, the one that predicts best wins.

Reference: Chen, Du, Wu, Drones 2025, 9(9), 612, section 3.2, doi:10.3390/drones9090612.

Symbols: x_i^t = (a, b, c) vehicle i minus UAV in world coordinates, metres, at frame t, n_rl vehicles; y_j^t = (u, v)
pixel position of track j, n_im tracks; θ (3 × 2) projection matrix, y = θᵀx. Every injective assignment of the fewer
to the more is a hypothesis. Its normal equations are sums of per-vehicle and per-pair Gram blocks,

    XᵀX = Σ_i G_i,  G_i = Σ_t x_i^t x_i^tᵀ      XᵀY = Σ_(i,j) H_ij,  H_ij = Σ_t x_i^t y_j^tᵀ      θ = (XᵀX)⁻¹ XᵀY

so the frames are summed once and not once per hypothesis. An assignment of s = min(n_rl, n_im) pairs is a set of s
vehicles, whose members in ascending order are its places, and an order: the track that each place meets. XᵀX depends on
the set alone: it is solved once per set, for all pairs, and the θ of all hypotheses of a set are one product Θ = B A, B
the solved pairs and A the 0/1 matrix of which place meets which track. Hypotheses are the last axis of every array.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations, permutations
from math import perm

import numpy as np
from numpy.typing import NDArray

from assoc.errors import AssocError, DegenerateError, ShapeError

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]
_RANK_TOLERANCE = 1e-9
"""Smallest ratio of the least to the largest eigenvalue of XᵀX at which θ counts as determined."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Orders:
    """All orders of s of n_im tracks."""

    track: IntArray
    """(s, h) track of each place."""
    meets: FloatArray
    """(s · n_im, h) A: 1 in row k · n_im + j where place k meets track j, else 0."""


@lru_cache(maxsize=8)
def orders(n_im: int, s: int) -> Orders:
    """All orders of s of n_im tracks, lexicographic; shared, read-only arrays.

    Example:
        >>> orders(3, 2).track.T.tolist()
        [[0, 1], [0, 2], [1, 0], [1, 2], [2, 0], [2, 1]]
    """
    track = np.array(list(permutations(range(n_im), s)), np.int64).T
    meets = np.zeros((s * n_im, track.shape[1]))
    # A[k · n_im + j_k, h] = 1
    np.put_along_axis(meets, n_im * np.arange(s)[:, None] + track, 1.0, axis=0)
    track.setflags(write=False)
    meets.setflags(write=False)
    return Orders(track=track, meets=meets)


@dataclass(frozen=True, slots=True, kw_only=True)
class Projection:
    """The winning hypothesis."""

    vehicle: IntArray
    """(n_im,) vehicle of each track, −1 for surplus tracks."""
    theta: FloatArray
    """(3, 2) its projection matrix, pixels per metre."""
    votes: int
    """Future frames in which its error is the least."""
    error_px: float
    """Pixel error of the pose, summed over tracks and future frames."""
    hypotheses: int
    """Hypotheses compared."""
    degenerate: int
    """Hypotheses left out because their vehicles do not determine θ."""


@dataclass(slots=True)
class _Best:
    """The best hypothesis of each of F future frames; s pairs."""

    track: IntArray
    """(F, s) its tracks."""
    vehicle: IntArray
    """(F, s) their vehicles."""
    theta: FloatArray
    """(F, 3, 2) its projection matrix, pixels per metre."""
    per_frame: FloatArray
    """(F, F) its pixel error in every future frame."""


def associate_by_projection(x: FloatArray, y: FloatArray, *, history: int = 10, most: int = 200_000) -> Projection:
    """Find the assignment whose own least-squares projection predicts the future frames best.

    Each future frame votes for the hypothesis with the least summed pixel error; the most votes win, ties go to the
    smaller error over all future frames.

    Args:
        x: (T, n_rl, 3) vehicles relative to the UAV, metres.
        y: (T, n_im, 2) tracks, pixels.
        history: Frames used for the fit; the remaining T − history vote.
        most: Largest number of hypotheses that is enumerated.

    Returns:
        The winner.

    Raises:
        ShapeError: Arrays do not belong together, or there is no future frame.
        DegenerateError: No hypothesis determines θ (X has rank below 3 for all of them).
        AssocError: More hypotheses than ``most``.
    """
    _check(x, y, history)
    n_rl, n_im = x.shape[1], y.shape[1]
    total = perm(max(n_rl, n_im), min(n_rl, n_im))
    if total > most:
        raise AssocError(f"projection: {total} assignments of {n_im} tracks to {n_rl} vehicles; at most {most} allowed")
    past_x, past_y, next_x, next_y = x[:history], y[:history], x[history:], y[history:]
    G = np.einsum("tia,tib->iab", past_x, past_x)
    H = np.einsum("tia,tjc->ijac", past_x, past_y)
    best, degenerate = _enumerate(G, H, next_x, next_y)
    if best is None:
        raise DegenerateError(
            f"projection: X has rank below 3 for all {total} assignments; vehicles and UAV lie in one plane through it"
        )
    return _elect(best, n_im, total, degenerate)


def reprojection_errors(x: FloatArray, y: FloatArray, theta: FloatArray) -> FloatArray:
    """e_ji = |θᵀx_i − y_j| of one frame.

    Args:
        x: (n_rl, 3) relative vehicles, metres.
        y: (n_im, 2) tracks, pixels.
        theta: (3, 2).

    Returns:
        (n_im, n_rl) pixels.
    """
    return np.asarray(np.linalg.norm((x @ theta)[None, :, :] - y[:, None, :], axis=2), np.float64)


def _check(x: FloatArray, y: FloatArray, history: int) -> None:
    """Raise ShapeError unless x and y belong together."""
    if x.ndim != 3 or x.shape[2] != 3 or y.ndim != 3 or y.shape[2] != 2 or len(x) != len(y):
        raise ShapeError(f"projection: expected x (T, n, 3) and y (T, m, 2), got {x.shape} and {y.shape}")
    if not 0 < history < len(x):
        raise ShapeError(f"projection: {len(x)} frames leave none after a history of {history}")
    if x.shape[1] == 0 or y.shape[1] == 0:
        raise DegenerateError("projection: no vehicle or no track")


def _enumerate(G: FloatArray, H: FloatArray, x: FloatArray, y: FloatArray) -> tuple[_Best | None, int]:
    """Winner of each future frame over all hypotheses, and how many were degenerate."""
    n_rl, n_im = H.shape[:2]
    s = min(n_rl, n_im)
    sets = np.array(list(combinations(range(n_rl), s)), np.int64)
    gram = np.sum(G[sets], axis=1)
    full = _full_rank(gram)
    degenerate = perm(n_im, s) * int(np.sum(~full))
    if not np.any(full):
        return None, degenerate
    vehicles, order = sets[full], orders(n_im, s)
    # Θ = B A, all hypotheses at once
    theta = (_solved(gram[full], H[vehicles]) @ order.meets).reshape(2, len(vehicles), 3, -1)
    error = _errors(x[:, vehicles].transpose(1, 0, 2, 3), y, theta, order.track)
    return _best_of(error, vehicles, order.track, theta), degenerate


def _full_rank(gram: FloatArray) -> BoolArray:
    """(g,) whether XᵀX determines θ, from (g, 3, 3)."""
    values = np.linalg.eigvalsh(gram)
    return np.asarray(values[:, 0] > _RANK_TOLERANCE * values[:, -1], np.bool_)


def _solved(gram: FloatArray, H: FloatArray) -> FloatArray:
    """(2 · g · 3, s · n_im) B, what each pair adds to the columns of θ, from (g, 3, 3) and (g, s, n_im, 3, 2)."""
    g, s, n_im = H.shape[:3]
    # θ = (XᵀX)⁻¹ Σ H_ij = Σ (XᵀX)⁻¹ H_ij
    solved = np.linalg.solve(gram, H.transpose(0, 3, 4, 1, 2).reshape(g, 3, 2 * s * n_im))
    B = solved.reshape(g, 3, 2, s * n_im).transpose(2, 0, 1, 3).reshape(6 * g, s * n_im)
    return np.asarray(B, np.float64)


def _errors(X: FloatArray, y: FloatArray, theta: FloatArray, track: IntArray) -> FloatArray:
    """Σ over pairs of |θᵀx − y| per hypothesis and future frame.

    Args:
        X: (g, F, s, 3) vehicles of each set.
        y: (F, n_im, 2) tracks.
        theta: (2, g, 3, h) columns of θ of each hypothesis.
        track: (s, h) track of each place.

    Returns:
        (g, F, h) pixels.
    """
    g, F, s, _ = X.shape
    away = (X.reshape(g, F * s, 3) @ theta).reshape(2, g, F, s, -1)
    away -= np.take(y.transpose(2, 0, 1), track, axis=2)[:, None]
    # in place: the passes over memory are what this costs
    away *= away
    distance = np.add(away[0], away[1], out=away[0])
    np.sqrt(distance, out=distance)
    return np.asarray(np.sum(distance, axis=2), np.float64)


def _best_of(error: FloatArray, vehicles: IntArray, track: IntArray, theta: FloatArray) -> _Best:
    """The best hypothesis of each future frame; the first of equals."""
    F, h = error.shape[1:]
    flat = error.transpose(1, 0, 2).reshape(F, -1)
    k = np.argmin(flat, axis=1)
    a, b = k // h, k % h
    return _Best(
        track=track[:, b].T,
        vehicle=vehicles[a],
        theta=theta[:, a, :, b].transpose(0, 2, 1),
        per_frame=error[a, :, b],
    )


def _elect(best: _Best, n_im: int, total: int, degenerate: int) -> Projection:
    """The hypothesis with the most votes of future frames."""
    answers = np.full((len(best.track), n_im), -1, np.int64)
    np.put_along_axis(answers, best.track, best.vehicle, axis=1)
    votes = np.array([np.sum(np.all(answers == one, axis=1)) for one in answers])
    sums = np.sum(best.per_frame, axis=1)
    k = int(np.lexsort((sums, -votes))[0])
    return Projection(
        vehicle=answers[k],
        theta=best.theta[k],
        votes=int(votes[k]),
        error_px=float(sums[k]),
        hypotheses=total,
        degenerate=degenerate,
    )
