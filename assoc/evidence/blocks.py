"""Residuals track − report, summarised per block of time for every pair of track and vehicle.

The track is interpolated to the report's sample time; interpolated reports would have correlated noise.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from assoc.evidence.motion import WHITE_STD_M, Samples
from assoc.geometry.ground import OFFSET, THETA, GroundTracks
from assoc.params import MANY_PAIRS

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

_REACH_M = 25.0
"""Among more pairs than ``MANY_PAIRS``, those that were never this close, metres, are not compared."""
LEAP_M, LEAP_MPS = 2.0, 15.0
"""A track that moves further than the first, metres, plus the second per second has leapt to another object."""
_HEADING_MEMORY_S = 3.0
"""Time constant with which past headings lose weight, seconds."""
_HEADING_REACH_S = 12.0
"""Headings older than this, seconds, are not used: their weight would be below 2 %."""
_FRONT, _REAR, _RANDOM = 0.88, 0.07, 0.05
"""Probability that the front a detector reports is the front, the rear, or random; some detectors report none."""
_MAX_DISAGREEMENTS = 4.0
"""Lasting disagreement of headings counts as at most this many independent samples; agreement counts as one."""
_SPEED_STD_MPS, _ACCELERATION_STD_MPS2 = 0.5, 1.0
"""1σ of the speed and of the acceleration of a vehicle whose report is extrapolated."""
_MIN_SPREAD_S2 = 1e-3
"""Spread of the times in a block from which a velocity can be fitted, s²."""
_BOX_DOF = 6.0
"""Degrees of freedom that what is assumed of boxes counts for, beside what they show."""
_MIN_BOXES = 3
"""Boxes of a block from which on they show their noise; a film of two frames a second has two, and takes two blocks."""
_MAX_BOX_VAR = 1.0
"""Upper limit of what one block shows of a box's variance, m²: a track that changes its vehicle is not noise."""
_LOG_VAR = 2.0 * np.log(WHITE_STD_M)
"""(G,) ln of the variances for which the null model is known."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Blocks:
    """B blocks × T tracks × n vehicles, linearised at ``theta``."""

    first: int
    """Number of the first block."""
    count: FloatArray
    """(B, T, n) samples in the block."""
    mean: FloatArray
    """(B, T, n, 2) mean residual, metres, 0 where there is none."""
    scatter: FloatArray
    """(B, T, n) Σ|r − r̄|², without a jump within the block, m²."""
    log_null: FloatArray
    """(B, T, n) Σ ln p₀ of the samples, for a noise as large as that of the residuals."""
    extra_var: FloatArray
    """(B, T, n) further variance of the block mean, m²: motion over which a report had to be extrapolated."""
    jump_var: FloatArray
    """(B, n) squared jump of the vehicle's own reports, m²."""
    box_var: FloatArray
    """(B, T) variance per axis of a box's place about the track's motion, m²."""
    jacobian: FloatArray
    """(B, T, 2, 9) derivative of the mean residual by θ."""
    heading: FloatArray
    """(T, n) heading log-likelihood ratio of the last seconds, 0 without headings."""
    theta: FloatArray
    """(9,)."""


def _nearest_seen(seen: BoolArray) -> tuple[IntArray, IntArray]:
    """Return for every row the last seen row at or before it (−1 none) and the first at or after it (F none)."""
    rows = np.arange(len(seen))[:, None]
    before = np.maximum.accumulate(np.where(seen, rows, -1), axis=0)
    after = np.minimum.accumulate(np.where(seen, rows, len(seen))[::-1], axis=0)[::-1]
    return before, after


def _heading_ratio(error: FloatArray, std: float) -> FloatArray:
    """ln of 0.88 vM(e) + 0.07 vM(e + π) + 0.05/2π over 1/2π; the second term is a front taken for a rear."""
    kappa = 1.0 / std**2
    scale = np.sqrt(2 * np.pi * kappa)
    c = np.cos(error)
    ratio = _FRONT * scale * np.exp(kappa * (c - 1)) + _REAR * scale * np.exp(-kappa * (c + 1)) + _RANDOM
    return np.asarray(np.log(ratio))


def interpolated(
    tracks: GroundTracks, t: FloatArray, column: IntArray, gap_max_s: float
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Points (N, 2) and headings (N,) of tracks (N,) at video times t (N,), and where they are valid.

    Positions and velocities are computed once per interval between frames, F − 1 of them, and looked up for each time.
    """
    last = len(tracks.t) - 1
    if last < 1:
        return np.full((len(t), 2), np.nan), np.full(len(t), np.nan), np.zeros(len(t), np.bool_)
    before, after = _nearest_seen(np.isfinite(tracks.p[..., 0]))
    a, b = before[:-1], after[1:]
    whole = (a >= 0) & (b <= last)
    a, b = np.where(whole, a, 0), np.where(whole, b, 0)
    n_tracks = tracks.p.shape[1]
    every = np.arange(n_tracks)[None, :]
    span, p0 = tracks.t[b] - tracks.t[a], tracks.p[a, every]
    step = tracks.p[b, every] - p0
    whole &= span <= gap_max_s
    # a step that no vehicle can drive in that time is not interpolated
    whole &= np.nan_to_num(np.hypot(step[..., 0], step[..., 1])) <= LEAP_M + LEAP_MPS * span
    rate, from_t = 1.0 / np.where(span > 0, span, np.inf), tracks.t[a]
    heading0, heading1 = tracks.heading[a, every], tracks.heading[b, every]
    k = np.clip(np.searchsorted(tracks.t, t, side="right") - 1, 0, last - 1) * n_tracks + column
    w = (t - from_t.ravel()[k]) * rate.ravel()[k]
    valid = whole.ravel()[k] & (t >= tracks.t[0]) & (t <= tracks.t[last])
    p = p0.reshape(-1, 2)[k] + w[:, None] * step.reshape(-1, 2)[k]
    return p, np.where(w < 0.5, heading0.ravel()[k], heading1.ravel()[k]), valid


def _near(place: FloatArray, samples: Samples, block: IntArray, n: int) -> BoolArray:
    """(T, n) pairs that came within reach in some block, or all if they are few; place: mean position (B, T, 2)."""
    n_blocks, n_tracks = place.shape[:2]
    if n_tracks * n <= MANY_PAIRS:
        return np.ones((n_tracks, n), np.bool_)
    key, size = block * n + samples.vehicle, n_blocks * n
    sums = np.stack([np.bincount(key, x, size) for x in samples.p.T], axis=1)
    with np.errstate(invalid="ignore"):  # blocks without reports are near no track
        report = sums / np.bincount(key, minlength=size)[:, None]
    gap = place[:, :, None, :] - report.reshape(n_blocks, 1, n, 2)
    return np.asarray(np.any(np.hypot(gap[..., 0], gap[..., 1]) < _REACH_M, axis=0))


def _by_block(
    tracks: GroundTracks, first: int, n_blocks: int, block_s: float, pixel_var: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Block means of the variance of boxes (B, T), of the Jacobian (B, T, 2, 9) and of the place (B, T, 2)."""
    n_tracks = tracks.p.shape[1]
    block = np.floor((tracks.t - tracks.theta[OFFSET]) / block_s).astype(np.int64) - first
    rows = np.flatnonzero((block >= 0) & (block < n_blocks))
    box = np.zeros((n_blocks, n_tracks))
    jacobian = np.zeros((n_blocks, n_tracks, 2, THETA))
    place = np.full((n_blocks, n_tracks, 2), np.nan)
    if not len(rows):
        return box, jacobian, place
    starts = np.flatnonzero(np.diff(block[rows], prepend=-1))
    seen = np.isfinite(tracks.p[rows, :, 0])
    total = np.add.reduceat(seen.astype(np.float64), starts, axis=0)
    count = np.maximum(total, 1.0)
    where = block[rows][starts]
    sums = np.add.reduceat(np.where(seen[..., None], tracks.p[rows], 0.0), starts, axis=0)
    place[where] = np.where(total[..., None] > 0.0, sums / count[..., None], np.nan)
    square = np.where(seen, tracks.pixel_m[rows] ** 2, 0.0)
    velocity, scatter = _straight_lines(tracks.t[rows], tracks.p[rows], seen, starts)
    boxes = total
    if np.max(total) < _MIN_BOXES:  # fewer are on a straight line whatever their noise
        longer = starts[:: math.ceil(_MIN_BOXES / max(np.max(total), 1.0))]
        boxes = np.add.reduceat(seen.astype(np.float64), longer, axis=0)
        scatter = _straight_lines(tracks.t[rows], tracks.p[rows], seen, longer)[1]
    box[where] = _box_variance(pixel_var * np.add.reduceat(square, starts, axis=0) / count, total > 0.0, scatter, boxes)
    full = np.where(seen[..., None, None], tracks.jacobian[rows], 0.0)
    jacobian[where] = np.add.reduceat(full, starts, axis=0) / count[..., None, None]
    # ∂r/∂δ also holds the track's own motion
    jacobian[where, ..., OFFSET] += velocity
    return box, jacobian, place


def _straight_lines(t: FloatArray, p: FloatArray, seen: BoolArray, starts: IntArray) -> tuple[FloatArray, FloatArray]:
    """Least-squares velocity of each track in each block (K, T, 2), and the sum of squares about that line (K, T).

    The velocity is 0 where it cannot be fitted.
    """
    k = np.add.reduceat(seen.astype(np.float64), starts, axis=0)
    w = np.where(seen, (t - t[0])[:, None], 0.0)
    begin = np.argmax(seen, axis=0)
    q = np.where(seen[..., None], p - np.nan_to_num(p[begin, np.arange(p.shape[1])]), 0.0)
    sw, sww = np.add.reduceat(w, starts, axis=0), np.add.reduceat(w * w, starts, axis=0)
    sq, swq = np.add.reduceat(q, starts, axis=0), np.add.reduceat(w[..., None] * q, starts, axis=0)
    sqq = np.add.reduceat(np.sum(q * q, axis=2), starts, axis=0)
    # v = (k Σtp − Σt Σp) / (k Σt² − (Σt)²)
    spread = k * sww - sw * sw
    safe = np.where(spread > _MIN_SPREAD_S2, spread, np.inf)
    v = (k[..., None] * swq - sw[..., None] * sq) / safe[..., None]
    # Σ|p − p̄ − v (t − t̄)|² = Σ|p|² − |Σp|²/k − |v|² (Σt² − (Σt)²/k)
    about = sqq - np.sum(sq * sq, axis=2) / np.maximum(k, 1.0) - np.sum(v * v, axis=2) * spread / np.maximum(k, 1.0)
    return np.asarray(v), np.maximum(about, 0.0)


def _box_variance(assumed: FloatArray, seen: BoolArray, scatter: FloatArray, count: FloatArray) -> FloatArray:
    """(K, T) variance per axis of boxes about their tracks' motion, m².

    A track's boxes show it by how they scatter about straight lines; those of all tracks, and what is assumed of a
    detector, count as a few more.

    Args:
        assumed: (K, T) by the size of a pixel on the ground, m².
        seen: (K, T) whether the track has boxes in the block.
        scatter: (L, T) sum of squares about a straight line, m².
        count: (L, T) boxes of which that is.
    """
    # two numbers of each axis are fitted
    dof = 2.0 * np.maximum(count - 2.0, 0.0)
    scatter = np.minimum(scatter, _MAX_BOX_VAR * dof)
    everywhere = np.sum(assumed, where=seen) / max(int(np.count_nonzero(seen)), 1)
    usual = (_BOX_DOF * everywhere + np.sum(scatter)) / (_BOX_DOF + np.sum(dof))
    own = (_BOX_DOF * usual + np.sum(scatter, axis=0)) / (_BOX_DOF + np.sum(dof, axis=0))
    return np.asarray(np.where(seen, own, 0.0))


def make_blocks(
    tracks: GroundTracks,
    samples: Samples,
    n_vehicles: int,
    *,
    first: int,
    last: int,
    block_s: float,
    gap_max_s: float,
    heading_std: float,
    white_var: float,
    pixel_var: float,
) -> Blocks:
    """Summarise the residuals of blocks first..last.

    Args:
        tracks: T tracks on the ground under some θ.
        samples: Reports sorted by vehicle and time.
        n_vehicles: n.
        first: Number of the first block.
        last: Number of the last one.
        block_s: Length of a block, seconds.
        gap_max_s: Longest hole in a track that is bridged.
        heading_std: 1σ of image heading against reported heading, radians.
        white_var: Variance per axis of a sample about its vehicle's motion, m².
        pixel_var: Variance that is assumed of a box's centre, px².

    Returns:
        The blocks, linearised at the tracks' θ.
    """
    n_blocks, n_tracks = max(last - first + 1, 0), tracks.p.shape[1]
    shape = (n_blocks, n_tracks, n_vehicles)
    block = np.floor(samples.t / block_s).astype(np.int64) - first
    box_var, jacobian, place = _by_block(tracks, first, n_blocks, block_s, pixel_var)
    jump = np.zeros((n_blocks, n_vehicles))
    np.maximum.at(jump, (block, samples.vehicle), samples.jump_var)
    # one row for each report and each track that it is compared with
    row, column = np.nonzero(_near(place, samples, block, n_vehicles).T[samples.vehicle])
    p, image_heading, valid = interpolated(tracks, samples.t[row] + tracks.theta[OFFSET], column, gap_max_s)
    row, column, r = row[valid], column[valid], (p - samples.p[row])[valid]
    pair = column * n_vehicles + samples.vehicle[row]
    key, size = block[row] * (n_tracks * n_vehicles) + pair, n_blocks * n_tracks * n_vehicles
    count = np.bincount(key, minlength=size).astype(np.float64)
    mean = np.stack([np.bincount(key, x, size) for x in r.T], axis=1) / np.maximum(count, 1.0)[:, None]
    scatter = np.maximum(np.bincount(key, np.sum(r * r, axis=1), size) - count * np.sum(mean * mean, axis=1), 0.0)
    log_null = _null_of(samples, row, white_var + box_var[block[row], column])
    log_null = np.asarray(np.bincount(key, log_null, size), np.float64)
    error = image_heading[valid] - samples.heading[row]
    heading = _mean_heading(error, samples.t[row], pair, n_tracks * n_vehicles, heading_std)
    return Blocks(
        first=first,
        count=count.reshape(shape),
        mean=mean.reshape(*shape, 2),
        # a jump widens the bias: it is not noise as well
        scatter=np.maximum(scatter.reshape(shape) - jump[:, None], 0.0),
        log_null=log_null.reshape(shape),
        extra_var=np.zeros(shape),
        jump_var=jump,
        box_var=box_var,
        jacobian=jacobian,
        heading=heading.reshape(shape[1:]),
        theta=tracks.theta,
    )


def _null_of(samples: Samples, row: IntArray, variance: FloatArray) -> FloatArray:
    """(N,) ln density of samples under their vehicles' own past, for noise of some variance (N,), m².

    Interpolated in the logarithm of the variance.
    """
    at = np.interp(np.log(variance), _LOG_VAR, np.arange(len(_LOG_VAR)))
    k = np.minimum(at.astype(np.int64), len(_LOG_VAR) - 2)
    w = at - k
    return np.asarray((1.0 - w) * samples.log_null[row, k] + w * samples.log_null[row, k + 1])


def _mean_heading(error: FloatArray, t: FloatArray, pair: IntArray, n_pairs: int, std: float) -> FloatArray:
    """(n_pairs,) heading evidence: mean ratio of the last seconds, times the samples but at most four (errors last).

    Agreement counts once: vehicles on one road face the same way.
    """
    known = np.isfinite(error) & (t > np.max(t, initial=-np.inf) - _HEADING_REACH_S)
    error, t, pair = error[known], t[known], pair[known]
    weight = np.exp((t - np.max(t, initial=-np.inf)) / _HEADING_MEMORY_S)
    k = np.bincount(pair, weight, n_pairs)
    mean = np.bincount(pair, weight * _heading_ratio(error, std), n_pairs) / np.maximum(k, 1e-9)
    return np.asarray(mean * np.minimum(k, np.where(mean > 0.0, 1.0, _MAX_DISAGREEMENTS)))


def with_extrapolated_block(
    blocks: Blocks, tracks: GroundTracks, seen: BoolArray, p: FloatArray, age_s: FloatArray, longest_s: float
) -> Blocks:
    """Append a block for pairs not compared yet: the newest frame against extrapolated reports.

    Args:
        blocks: The blocks so far.
        tracks: Their tracks.
        seen: (T, n) pairs compared before the first block.
        p: (n, 2) reports extrapolated to the newest frame.
        age_s: (n,) time over which each was extrapolated, seconds.
        longest_s: Older reports are not used.

    Returns:
        Blocks with one more at the end.
    """
    wanted = ~(seen | np.any(blocks.count > 0, axis=0))
    wanted &= np.isfinite(tracks.p[-1, :, 0])[:, None] & (np.isfinite(p[:, 0]) & (np.abs(age_s) <= longest_s))[None, :]
    age = np.where(np.abs(age_s) <= longest_s, age_s, 0.0)
    # σ² = (σ_v t)² + (σ_a t²/2)²
    extra = (_SPEED_STD_MPS * age) ** 2 + (0.5 * _ACCELERATION_STD_MPS2 * age**2) ** 2
    mean = np.where(wanted[..., None], tracks.p[-1][:, None, :] - p[None, :, :], 0.0)
    known = np.isfinite(tracks.p[-1, :, 0])
    zero = np.zeros((1, *wanted.shape))
    return Blocks(
        first=blocks.first,
        count=np.concatenate([blocks.count, wanted[None].astype(np.float64)]),
        mean=np.concatenate([blocks.mean, mean[None]]),
        scatter=np.concatenate([blocks.scatter, zero]),
        log_null=np.concatenate([blocks.log_null, zero]),
        extra_var=np.concatenate([blocks.extra_var, np.broadcast_to(extra, zero.shape)]),
        jump_var=np.concatenate([blocks.jump_var, zero[:, 0]]),
        box_var=np.concatenate([blocks.box_var, np.where(known, np.max(blocks.box_var, axis=0), 0.0)[None]]),
        jacobian=np.concatenate([blocks.jacobian, np.where(known[:, None, None], tracks.jacobian[-1], 0.0)[None]]),
        heading=blocks.heading,
        theta=blocks.theta,
    )
