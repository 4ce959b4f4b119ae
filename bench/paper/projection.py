"""Projection-based association: every assignment fits its own projection, the one that predicts best wins.

Reference: Chen, Du, Wu, Drones 2025, 9(9), 612, section 3.2, doi:10.3390/drones9090612.

Symbols: x_i^t = (a, b, c) vehicle i minus UAV in world coordinates, metres, at frame t, n_rl vehicles; y_j^t = (u, v)
pixel position of track j, n_im tracks; θ (3 × 2) projection matrix, y = θᵀx. Every injective assignment of the fewer
to the more is a hypothesis: a set of s = min(n_rl, n_im) vehicles, and an order, the track that each of them meets.
The pseudoinverse of X depends on the set alone, so the θ of all its orders are one product.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations, permutations
from math import perm

import numpy as np
from numpy.typing import NDArray

from assoc.errors import AssocError, DegenerateError, ShapeError

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
_RANK_TOLERANCE = 3e-5
"""Smallest ratio of the least to the largest singular value of X at which θ counts as determined."""


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
    """Its pixel error summed over tracks and future frames."""
    hypotheses: int
    """Hypotheses compared."""
    degenerate: int
    """Hypotheses left out because their vehicles do not determine θ."""


@dataclass(frozen=True, slots=True)
class _FrameBest:
    """The best hypothesis of one future frame so far."""

    error: float
    """Its pixel error in that frame, summed over pairs."""
    vehicle: IntArray
    """(n_im,)."""
    theta: FloatArray
    """(3, 2)."""
    summed: float
    """Its pixel error over all future frames."""


def associate_by_projection(x: FloatArray, y: FloatArray, *, history: int = 10, most: int = 100_000) -> Projection:
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
    s, total = min(n_rl, n_im), perm(max(n_rl, n_im), min(n_rl, n_im))
    if total > most:
        raise AssocError(f"projection: {total} assignments of {n_im} tracks to {n_rl} vehicles; at most {most} allowed")
    order = np.array(list(permutations(range(n_im), s)), np.int64)
    past, then = y[:history, order], y[history:, order]
    rows = past.transpose(0, 2, 1, 3).reshape(history * s, -1)
    best: list[_FrameBest | None] = [None] * len(then)
    degenerate = 0
    for chosen in combinations(range(n_rl), s):
        X = x[:history, chosen].reshape(-1, 3)
        spread = np.linalg.svd(X, compute_uv=False)
        if len(spread) < 3 or spread[2] <= _RANK_TOLERANCE * spread[0]:
            degenerate += len(order)
            continue
        # θ = (XᵀX)⁻¹ Xᵀ Y of all orders
        theta = (np.linalg.pinv(X) @ rows).reshape(3, -1, 2)
        away = np.tensordot(x[history:, chosen], theta, axes=1).transpose(0, 2, 1, 3) - then
        error = np.sum(np.linalg.norm(away, axis=3), axis=2)
        best = [_better(one, f, error, np.array(chosen), order, theta, n_im) for f, one in enumerate(best)]
    found = [one for one in best if one is not None]
    if not found:
        raise DegenerateError(
            f"projection: X has rank below 3 for all {total} assignments; vehicles and UAV lie in one plane through it"
        )
    return _elect(found, total, degenerate)


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


def _better(
    best: _FrameBest | None,
    frame: int,
    error: FloatArray,
    chosen: IntArray,
    order: IntArray,
    theta: FloatArray,
    n_im: int,
) -> _FrameBest:
    """Best of a future frame so far and a further set of vehicles, errors (F, h); the earlier of equals."""
    k = int(np.argmin(error[frame]))
    if best is not None and best.error <= error[frame, k]:
        return best
    vehicle = np.full(n_im, -1, np.int64)
    vehicle[order[k]] = chosen
    return _FrameBest(float(error[frame, k]), vehicle, theta[:, k], float(error[:, k].sum()))


def _elect(best: list[_FrameBest], total: int, degenerate: int) -> Projection:
    """The hypothesis with the most votes of future frames."""
    votes = [sum(np.array_equal(one.vehicle, other.vehicle) for other in best) for one in best]
    k = min(range(len(best)), key=lambda k: (-votes[k], best[k].summed))
    return Projection(
        vehicle=best[k].vehicle,
        theta=best[k].theta,
        votes=votes[k],
        error_px=best[k].summed,
        hypotheses=total,
        degenerate=degenerate,
    )
