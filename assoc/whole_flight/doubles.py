"""Segments, and boxes, that may as well be another vehicle that has none of its own then."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from assoc.whole_flight.chains import CommonPose, given_rest
from assoc.whole_flight.evidence import Segments
from assoc.whole_flight.residuals import Errors, Residuals

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

_NATS, _LEAST = 8.0, 2.0
"""A vehicle without a segment of its own fits another's segment if its score there is this close, and this much."""
_COVER = 0.3
"""Share of a segment's time for which a vehicle with a segment of its own has one, at least."""
_P = 0.5
"""Most that a name counts for where another vehicle may as well be that segment."""
_WITHIN_M = 2.5
"""A vehicle is in a box whose middle is this near, metres, or half as far as the box is long: half of its length."""
_WITHIN_STDS = 5.0
"""Pairs further apart than that and this many σ_b are not looked at."""
_ALONE_BLOCKS = 4
"""Blocks on end in which a vehicle has no box before it is in another's: shorter, it is missed."""


def without_doubles(p: FloatArray, score: FloatArray, owner: IntArray, segments: Segments) -> FloatArray:
    """The probabilities without sure names of segments that a vehicle without a segment of its own fits as well.

    One of the two reports where it is not, and the places do not tell which.

    Args:
        p: (S, n + 1) of each vehicle, and of none of ours.
        score: (S, n) of each segment by itself.
        owner: (S,) vehicle of each segment, −1 none.
        segments: The pieces of tracks.
    """
    p = p.copy()
    for segment in np.flatnonzero(owner >= 0).tolist():
        own, frames = owner[segment], segments.seen[:, segment]
        for other in np.flatnonzero(score[segment] > max(score[segment, own] - _NATS, _LEAST)).tolist():
            has = np.any(segments.seen[frames][:, owner == other], axis=1)
            if other != own and np.mean(has) < _COVER:
                p[segment] = limited(p[segment], own, other)
    return p


def limited(p: FloatArray, own: int, other: int, limit: float = _P) -> FloatArray:
    """(n + 1,) probabilities of which what is over a limit for one answer counts for another one."""
    p, over = p.copy(), max(p[own] - limit, 0.0)
    p[own] -= over
    p[other] += over
    return p


def boxes_of_two(
    segments: Segments, residuals: Residuals, pose: CommonPose, errors: Errors, owner: IntArray, block_s: float
) -> IntArray:
    """(B, S) vehicle that is in a segment's box, too, or alone, −1 nobody.

    A detector draws one box round two that nearly touch. What has no box of its own for long, and is where another
    one's is by its reports and what its own segments say of their errors, is in that.

    Args:
        segments: The pieces of tracks.
        residuals: Of all pairs.
        pose: The camera's, and what is common.
        errors: Of the vehicles' positions.
        owner: (S,) vehicle of each segment, −1 none: the chains.
        block_s: Length of a block, seconds.
    """
    seen = _seen_blocks(segments, residuals, block_s)
    r = residuals.at(pose.theta, pose.common)
    within_m = _reach_m(segments, residuals, block_s)
    away_m = np.linalg.norm(r, axis=3)
    near = (residuals.blocks.count > 0) & (away_m < within_m[:, :, None] + _WITHIN_STDS * errors.bias_std)
    near &= (seen & (owner >= 0))[:, :, None]
    found = np.full(seen.shape, -1)
    for vehicle in range(near.shape[2]):
        chain = np.flatnonzero(owner == vehicle)
        near[:, chain, vehicle] = False
        near[~_lasting(np.asarray(~seen[:, chain].any(axis=1))), :, vehicle] = False
        for segment in np.flatnonzero(near[:, :, vehicle].any(axis=0)).tolist():
            rows = np.flatnonzero(near[:, segment, vehicle])
            pairs = rows, np.full_like(rows, segment)
            _, _, given, _ = given_rest(residuals, r, errors, vehicle, pairs, chain)
            found[rows[np.hypot(*given.reshape(2, -1)) < within_m[rows, segment]], segment] = vehicle
    return found


def _reach_m(segments: Segments, residuals: Residuals, block_s: float) -> FloatArray:
    """(B, S) distance, metres, from the middle of each segment's box up to which a vehicle is in it."""
    half_m = np.full(residuals.blocks.count.shape[:2], _WITHIN_M)
    for (t_us, track), length_m in segments.length_m.items():
        t = np.array(1e-6 * (t_us - segments.origin_us))
        at = int(_block_at(t, residuals, block_s)), segments.of[t_us, track]
        half_m[at] = max(half_m[at], 0.5 * length_m)
    return half_m


def _seen_blocks(segments: Segments, residuals: Residuals, block_s: float) -> BoolArray:
    """(B, S) blocks in which each segment was seen."""
    history, seen = segments.history, np.zeros(residuals.blocks.count.shape[:2], np.bool_)
    np.logical_or.at(seen, _block_at(history.t[: history.n], residuals, block_s), segments.seen)
    return seen


def _block_at(t: FloatArray, residuals: Residuals, block_s: float) -> IntArray:
    """(...) block of each time, seconds from the first frame; the first or last one before and after all."""
    block = np.floor(t / block_s).astype(np.int64) - residuals.blocks.first
    return np.asarray(np.clip(block, 0, len(residuals.blocks.count) - 1))


def _lasting(so: BoolArray) -> BoolArray:
    """(B,) blocks of runs that are long enough to count."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], so, [False]]).astype(np.int64))).reshape(-1, 2)
    lasting = np.zeros_like(so)
    for first, end in edges[np.diff(edges, axis=1)[:, 0] >= _ALONE_BLOCKS].tolist():
        lasting[first:end] = True
    return lasting
