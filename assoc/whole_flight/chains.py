"""Scores of segments as vehicles, given each vehicle's other segments, and the pose and errors that go with them.

A vehicle's segments are one chain: they share the course of its errors (``assoc.whole_flight.residuals``). So a segment
is weighed by what the rest of the chain, before it and after it, leaves open, N(r | rest), against N₀(r), with which it
is anywhere:

    S = ln N(r | rest)/N₀(r) + M − ln[(1 − c) + c eᴹ] − ln λ + ln q/(1 − q) + 0.25 T

M says how much better the segment drives like the vehicle's reports than their own past foretells them, wherever it is;
no more of it counts than look-alikes leave, c of all others. λ is the density of strangers, q the share of vehicles
that have a box, T the time for which the segment was seen.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag, cho_factor, cho_solve, solve_triangular

from assoc.geometry.ground import THETA
from assoc.hypotheses.pose import PosePrior
from assoc.whole_flight.evidence import Segments
from assoc.whole_flight.residuals import Errors, Residuals, thinned

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

NEVER = -60.0
"""Score of a pair that is out of the question."""
_ALIKE = 0.05
"""c: share of the others that drive like a vehicle."""
_FOUND = 0.8
"""q."""
_MIN_STRANGERS = 0.5
"""Least mean number of strangers in view."""
_PER_S = 0.25
"""Score of each second for which a segment was seen, nats: who is in view has a box, not now and then."""
_ANYWHERE_M = 30.0
"""1σ of the place of a segment of which only the course counts, metres."""
_REACH_STDS, _REACH_M = 5.0, 4.0
"""A pair further apart than this many σ_b and metres is out of the question."""
_MAX_PARTS = 60
"""Blocks of a segment at which it is parted, at most."""
_MAX_ROWS, _MAX_REST = 40, 30
"""Blocks of a segment that are weighed, and those of the rest of its chain."""
_ASIDE_STDS, _ASIDE_M = 3.0, 0.5
"""A block this many σ_b and metres from the segment's median is aside."""
_ASIDE_NATS = 1.0
"""Cost of each block that is aside, nats."""
_SEGMENT_STD_M = 0.4
"""1σ per axis of where the boxes of a segment are on the vehicle, against those of its other segments, metres."""
_OUTLIER_Z2, _BLOCKS_TO_OUTLIER = 9.0, 4
"""Mean squared deviation per axis, in variances, from which a block is an outlier; blocks to each that may be one."""
_MAX_LEARNT = 60
"""Blocks of a chain from which the size of the errors is learnt."""
_COMMON_STD_M, _COMMON_TAU_S, _KNOT_S = 0.5, 30.0, 4.0
"""σ_c, metres, τ_c, and how far apart the knots are between which c is linear, seconds."""
_BIAS_STDS_M, _TAUS_S = (0.3, 0.5, 0.8, 1.2, 1.7, 2.4, 3.4), (6.0, 12.0, 25.0, 50.0, 100.0)
"""Candidates of σ_b, metres, and τ, seconds."""
_OUTLYING_M, _OUTLYING_STDS, _MIN_OTHERS = 4.0, 6.0, 2
"""A chain is outlying from this many metres and σ_b of at least this many others on."""
_USUAL_BIAS_M, _BIAS_SPREAD, _USUAL_TAU_S = 1.5, 0.8, 40.0
"""Log-normal priors: median and 1σ of the logarithm of σ_b; median of τ, whose logarithm has 1σ of 1."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CommonPose:
    """Errors that all vehicles have in common."""

    theta: FloatArray
    """(9,)."""
    common: FloatArray
    """(B, 2) c, metres."""
    cost: float
    """Cost of both by their priors, nats."""


def pair_scores(
    segments: Segments, residuals: Residuals, pose: CommonPose, errors: Errors, owner: IntArray
) -> FloatArray:
    """(S, n) ln odds that each segment is each vehicle, ``NEVER`` for nothing compared.

    Args:
        segments: The pieces of tracks.
        residuals: Of all pairs, ``without_outliers``.
        pose: The camera's, and what is common.
        errors: Of the vehicles' positions.
        owner: (S,) vehicle of each segment, −1 none: the chains.
    """
    r = residuals.at(pose.theta, pose.common)
    near = _near(residuals, r, errors)
    usual = _usual_score(segments, residuals, owner) + _PER_S * segments.seen_s
    score = np.full(near.shape, NEVER)
    for segment, vehicle in np.argwhere(near).tolist():
        rows = residuals.rows(segment, vehicle, _MAX_ROWS)
        rest = np.flatnonzero((owner == vehicle) & ~segments.apart[segment])
        rest = rest[rest != segment]
        score[segment, vehicle] = usual[segment] - _ASIDE_NATS * residuals.aside[segment, vehicle]
        score[segment, vehicle] += _compared(residuals, r, errors, vehicle, (rows, np.full_like(rows, segment)), rest)
    return np.asarray(np.maximum(score, NEVER))


def _usual_score(segments: Segments, residuals: Residuals, owner: IntArray) -> float:
    """ln q/(1 − q) − ln λ, with the strangers that owners (S,) leave."""
    strangers = max(float(np.mean(np.sum(segments.seen[:, owner < 0], axis=1))), _MIN_STRANGERS)
    return float(np.log(_FOUND / (1.0 - _FOUND)) - np.log(strangers / residuals.area_m2))


def with_whole_chains(
    score: FloatArray, residuals: Residuals, pose: CommonPose, errors: Errors, owner: IntArray
) -> FloatArray:
    """(S, n) the scores, where it is more of another vehicle as which its whole chain is likelier than it alone.

    Two vehicles side by side may be taken for one another for a whole flight, which the rest of a chain hides.

    Args:
        score: (S, n) of ``pair_scores``.
        residuals: Of all pairs, ``without_outliers``.
        pose: The camera's, and what is common.
        errors: Of the vehicles' positions.
        owner: (S,) vehicle of each segment, −1 none: the chains.
    """
    r = residuals.at(pose.theta, pose.common)
    near = _near(residuals, r, errors)
    together = score.copy()

    def value_as(chain: IntArray, vehicle: int) -> float:
        rows, of = (thinned(every, _MAX_ROWS) for every in residuals.chain_rows(chain, vehicle))
        return _compared(residuals, r, errors, vehicle, (rows, of), np.zeros(0, np.int64))

    for own, *_ in residuals.chains(owner):
        chain = np.flatnonzero(owner == own)
        chain = chain[near[chain, own]]
        if len(chain) < 2:
            continue  # its score says it all
        others = np.flatnonzero(near[chain].all(axis=0))
        whole = np.array([value_as(chain, vehicle) for vehicle in others.tolist()])
        exchanged = score[chain, own][:, None] + whole - whole[others == own]
        pairs = np.ix_(chain, others)
        together[pairs] = np.maximum(score[pairs], exchanged)
    return together


def scores_as_parts(
    segments: Segments, residuals: Residuals, r: FloatArray, errors: Errors, owner: IntArray, segment: int
) -> tuple[IntArray, FloatArray, FloatArray] | None:
    """Scores of a segment's parts: before each of its blocks, and from there on.

    Args:
        segments: The pieces of tracks.
        residuals: Of all pairs.
        r: (B, S, n, 2) the same at the pose.
        errors: Of the vehicles' positions.
        owner: (S,) vehicle of each segment, −1 none: the chains.
        segment: The segment.

    Returns:
        (a,) blocks, (a, n + 1) scores of the part before each as each vehicle, 0 in the last column for none of ours,
        and (a, n + 1) of the part from it on; None where no two blocks were compared.
    """
    has = residuals.blocks.count[:, segment] > 0
    reach_m = _REACH_STDS * errors.bias_std + _REACH_M
    near = has & (np.linalg.norm(r[:, segment], axis=2) < reach_m)
    every = np.flatnonzero(has.any(axis=1))
    if len(every) < 2:
        return None
    # what the whole gains by being one of ours, each part gains by its share
    usual = _usual_score(segments, residuals, owner) + _PER_S * segments.seen_s[segment]
    passed = np.linspace(0.0, 1.0, len(every) + 1)
    n = has.shape[1]
    before, after = (np.full((len(every), n + 1), NEVER) for _ in range(2))
    before[:, n] = after[:, n] = 0.0
    for vehicle in np.flatnonzero(np.sum(near, axis=0) > 1).tolist():
        rows = residuals.rows(segment, vehicle, _MAX_PARTS)
        rest = np.flatnonzero((owner == vehicle) & ~segments.apart[segment] & (np.arange(len(owner)) != segment))
        until = _growing(residuals, r, errors, vehicle, segment, rows, rest)
        since = _growing(residuals, r, errors, vehicle, segment, rows[::-1], rest)[::-1]
        # how many of the vehicle's blocks are before each block
        k = np.searchsorted(rows, every)
        before[:, vehicle] = usual * passed[:-1] + np.concatenate([[NEVER], until])[k]
        after[:, vehicle] = usual * (1.0 - passed[:-1]) + np.concatenate([since, [NEVER]])[k]
    return every, before, after


def _growing(
    residuals: Residuals,
    r: FloatArray,
    errors: Errors,
    vehicle: int,
    segment: int,
    rows: IntArray,
    rest: IntArray,
) -> FloatArray:
    """Scores (a,) of the first, the first two … of the blocks (a,) of a segment as one vehicle (``_compared``)."""
    own, cov, given, given_cov = given_rest(residuals, r, errors, vehicle, (rows, np.full_like(rows, segment)), rest)
    wide = _shared(np.zeros_like(rows), _ANYWHERE_M)
    anywhere = _log_normals(own, cov + wide) + np.log(2.0 * np.pi * _ANYWHERE_M**2)
    motion = anywhere + np.cumsum(residuals.motion[rows, segment, vehicle])
    alike = np.logaddexp(np.log(1.0 - _ALIKE), np.log(_ALIKE) + motion)
    return np.asarray(_log_normals(given, given_cov) - anywhere + motion - alike)


def _log_normals(x: FloatArray, cov: FloatArray) -> FloatArray:
    """(a,) ln N of the first, the first two … places of x (2a,), east of all, then north of all."""
    order = np.arange(len(x)).reshape(2, -1).T.ravel()
    lower = np.linalg.cholesky(cov[np.ix_(order, order)])
    z = solve_triangular(lower, x[order], lower=True)
    steps = -0.5 * z**2 - np.log(np.diag(lower)) - 0.5 * np.log(2.0 * np.pi)
    return np.cumsum(steps)[1::2]


def _near(residuals: Residuals, r: FloatArray, errors: Errors) -> BoolArray:
    """(S, n) pairs that are compared, and not out of the question, of residuals (B, S, n, 2)."""
    has = residuals.blocks.count > 0
    mean = np.sum(r * has[..., None], axis=0) / np.maximum(np.sum(has, axis=0), 1)[..., None]
    reach_m = _REACH_STDS * errors.bias_std + _REACH_M
    return np.asarray(has.any(axis=0) & (np.linalg.norm(mean, axis=2) < reach_m))


def without_outliers(residuals: Residuals, pose: CommonPose, errors: Errors) -> Residuals:
    """The residuals with larger noise where a block is far from all others of its pair, as when a track strays.

    z² = (C⁻¹r)²/diag C⁻¹ is what the others do not explain; the worst block is weighed down, and again. A track that
    comes from another object, or goes on to one, is aside for a while: what is so at its ends does not count.

    Args:
        residuals: Of all pairs.
        pose: The camera's, and what is common.
        errors: Of the vehicles' positions.
    """
    r, var, count = residuals.at(pose.theta, pose.common), residuals.var.copy(), residuals.blocks.count.copy()
    for segment, vehicle in np.argwhere(_near(residuals, r, errors)).tolist():
        every = np.flatnonzero(residuals.blocks.count[:, segment, vehicle] > 0)
        reach_m = _ASIDE_STDS * np.sqrt(errors.bias_std**2 + var[every, segment, vehicle]) + _ASIDE_M
        aside = _at_the_ends(r[every, segment, vehicle], reach_m)
        count[every[aside], segment, vehicle] = 0.0
        rows = thinned(every[~aside], _MAX_ROWS)
        y = _stacked(r[rows, segment, vehicle])
        cov = residuals.covariance(vehicle, rows, rows, errors) + _shared(np.zeros_like(rows), _ANYWHERE_M)
        for _ in range(len(rows) // _BLOCKS_TO_OUTLIER):
            inverse = np.linalg.inv(cov + np.diag(np.tile(var[rows, segment, vehicle], 2)))
            z2 = ((inverse @ y) ** 2 / np.diag(inverse)).reshape(2, -1).mean(axis=0)
            worst = int(np.argmax(z2))
            if z2[worst] < _OUTLIER_Z2:
                break
            var[rows[worst], segment, vehicle] *= z2[worst]
    aside = np.count_nonzero(count != residuals.blocks.count, axis=0)
    return replace(residuals, var=var, blocks=replace(residuals.blocks, count=count), aside=aside)


def _at_the_ends(r: FloatArray, reach_m: FloatArray) -> BoolArray:
    """(a,) which of a segment's residuals (a, 2) are before the first, or after the last, that is near their median."""
    away = np.linalg.norm(r - np.median(r, axis=0), axis=1) > reach_m
    near = np.flatnonzero(~away)
    aside = np.zeros(len(r), np.bool_)
    if away.any() and len(near):
        # the next one is on its way
        aside[: near[0] + (near[0] > 0)] = True
        aside[near[-1] + (near[-1] == len(r) - 1) :] = True
    return away if aside.all() else aside


def _compared(
    residuals: Residuals,
    r: FloatArray,
    errors: Errors,
    vehicle: int,
    compared: tuple[IntArray, IntArray],
    rest: IntArray,
) -> float:
    """ln N(r | rest)/N₀(r) + M − ln[(1 − c) + c eᴹ] of one or more segments as one vehicle.

    Args:
        residuals: Of all pairs.
        r: (B, S, n, 2) the same at the pose.
        errors: Of the vehicles' positions.
        vehicle: The vehicle.
        compared: (a,) blocks and (a,) segments that are weighed.
        rest: (k,) other segments of that vehicle.
    """
    rows, segment = compared
    own, cov, given, given_cov = given_rest(residuals, r, errors, vehicle, compared, rest)
    # N₀: the mean of each axis has a wide prior, here about itself
    centred = own - np.repeat(np.mean(r[rows, segment, vehicle], axis=0), len(rows))
    wide = _shared(np.zeros_like(rows), _ANYWHERE_M)
    anywhere = _log_normal(centred, cov + wide) + np.log(2.0 * np.pi * _ANYWHERE_M**2)
    motion = anywhere + float(np.sum(residuals.motion[rows, segment, vehicle]))
    alike = np.logaddexp(np.log(1.0 - _ALIKE), np.log(_ALIKE) + motion)
    return float(_log_normal(given, given_cov) - anywhere + motion - alike)


def given_rest(
    residuals: Residuals,
    r: FloatArray,
    errors: Errors,
    vehicle: int,
    compared: tuple[IntArray, IntArray],
    rest: IntArray,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Residuals (2a,) of blocks and their covariance (2a, 2a), alone and then given the rest of the vehicle's chain.

    Args:
        residuals: Of all pairs.
        r: (B, S, n, 2) the same at the pose.
        errors: Of the vehicles' positions.
        vehicle: The vehicle.
        compared: (a,) blocks and (a,) segments.
        rest: (k,) other segments of that vehicle.
    """
    rows, segment = compared
    alone = np.zeros_like(rows)
    own = given = _stacked(r[rows, segment, vehicle])
    cov = given_cov = residuals.noisy_covariance(vehicle, rows, segment, errors)
    if len(rest):
        others, of = residuals.chain_rows(rest, vehicle)
        nearest = np.argsort(np.min(np.abs(others[:, None] - rows), axis=1), kind="stable")[:_MAX_REST]
        others, of = others[nearest], of[nearest]
        # boxes of one segment are round other points than those of another
        known = residuals.noisy_covariance(vehicle, others, of, errors) + _shared(of, _SEGMENT_STD_M)
        lower = np.linalg.cholesky(known)
        across = residuals.covariance(vehicle, others, rows, errors)
        half = solve_triangular(lower, np.column_stack([_stacked(r[others, of, vehicle]), across]), lower=True)
        given = own - half[:, 1:].T @ half[:, 0]
        given_cov = cov + _shared(alone, _SEGMENT_STD_M) - half[:, 1:].T @ half[:, 1:]
    elif np.ptp(segment):
        given_cov = cov + _shared(segment, _SEGMENT_STD_M)
    return own, cov, given, given_cov


def fit_pose(residuals: Residuals, prior: PosePrior, errors: Errors, owner: IntArray) -> CommonPose:
    """θ and c of least cost for given owners: generalised least squares, the vehicles' own errors marginalised.

    Args:
        residuals: Of all pairs, linearised nearby.
        prior: Of θ.
        errors: Of the vehicles' positions.
        owner: (S,) vehicle of each segment, −1 none.
    """
    n_blocks = len(residuals.blocks.count)
    knots = np.linspace(0.0, n_blocks - 1.0, max(int(np.ceil(n_blocks / _KNOT_S)) + 1, 2))
    # c is linear between knots
    hat = np.maximum(1.0 - np.abs(np.arange(n_blocks)[:, None] - knots) / (knots[1] - knots[0]), 0.0)
    wander = np.linalg.inv(_COMMON_STD_M**2 * np.exp(-np.abs(knots[:, None] - knots) / _COMMON_TAU_S))
    precision = block_diag(np.diag(1.0 / prior.std**2), wander, wander)
    mean = np.concatenate([prior.mean, np.zeros(2 * len(knots))])
    theta = residuals.blocks.theta
    r = residuals.at(theta, np.zeros((n_blocks, 2)))
    H, g = precision.copy(), precision @ mean
    for vehicle, rows, of in residuals.chains(owner):
        cov = residuals.noisy_covariance(vehicle, rows, of, errors)
        J, none = residuals.blocks.jacobian[rows, of], np.zeros((len(rows), len(knots)))
        J = np.concatenate([np.column_stack([J[:, 0], hat[rows], none]), np.column_stack([J[:, 1], none, hat[rows]])])
        weighed = cho_solve(cho_factor(cov), J)
        H += J.T @ weighed
        # (Λ + JᵀVJ) x = Λμ + JᵀV (J x₀ − r)
        g += weighed.T @ (J[:, :THETA] @ theta - _stacked(r[rows, of, vehicle]))
    x = np.linalg.solve(H, g)
    east, north = x[THETA : THETA + len(knots)], x[THETA + len(knots) :]
    return CommonPose(
        theta=x[:THETA],
        common=np.stack([hat @ east, hat @ north], axis=1),
        cost=float(0.5 * (x - mean) @ precision @ (x - mean)),
    )


def learn_errors(residuals: Residuals, pose: CommonPose, owner: IntArray) -> Errors:
    """The likeliest σ_b and τ of the chains, with their priors."""
    r = residuals.at(pose.theta, pose.common)
    chains = [
        (vehicle, thinned(rows, _MAX_LEARNT), thinned(of, _MAX_LEARNT)) for vehicle, rows, of in residuals.chains(owner)
    ]

    def log_likelihood(errors: Errors) -> float:
        spread = np.log(errors.bias_std / _USUAL_BIAS_M) / _BIAS_SPREAD, np.log(errors.tau_s / _USUAL_TAU_S)
        total = -0.5 * float(spread[0] ** 2 + spread[1] ** 2)
        for vehicle, rows, of in chains:
            cov = residuals.noisy_covariance(vehicle, rows, of, errors)
            total += _log_normal(_stacked(r[rows, of, vehicle]), cov)
        return total

    return max((Errors(std, tau) for std in _BIAS_STDS_M for tau in _TAUS_S), key=log_likelihood)


def outlying(residuals: Residuals, prior: PosePrior, pose: CommonPose, errors: Errors, owner: IntArray) -> list[int]:
    """Vehicles whose positions would be far more wrong than all others': a stranger that drives alike may be theirs.

    The pose and σ_b that a chain is held against are those of the other chains alone, since it shifts both.

    Args:
        residuals: Of all pairs, linearised nearby.
        prior: Of θ.
        pose: The camera's by all chains, and what is common.
        errors: Of the vehicles' positions by all chains.
        owner: (S,) vehicle of each segment, −1 none: the chains.
    """
    found, chains = list[int](), list(residuals.chains(owner))
    for vehicle, rows, of in chains if len(chains) > _MIN_OTHERS else []:
        # the pose gives way by a part of what a chain is off
        if _mean_m(residuals, pose, vehicle, rows, of) < 0.5 * _OUTLYING_M:
            continue
        others = np.where(owner == vehicle, -1, owner)
        alone = learn_errors(residuals, fit_pose(residuals, prior, errors, others), others)
        refit = fit_pose(residuals, prior, alone, others)
        alone = learn_errors(residuals, refit, others)
        far_m = max(_OUTLYING_M, _OUTLYING_STDS * alone.bias_std)
        if _mean_m(residuals, refit, vehicle, rows, of) > far_m:
            found.append(vehicle)
    return found


def _mean_m(residuals: Residuals, pose: CommonPose, vehicle: int, rows: IntArray, of: IntArray) -> float:
    """Length of the mean residual of a chain's blocks (a,) and their segments (a,), metres."""
    return float(np.linalg.norm(np.mean(residuals.at(pose.theta, pose.common)[rows, of, vehicle], axis=0)))


def _shared(of: IntArray, std_m: float) -> FloatArray:
    """(2a, 2a) covariance, m², of an error that blocks of one segment share and those of others do not.

    Args:
        of: (a,) segments.
        std_m: 1σ per axis.
    """
    cov = np.zeros((2, len(of), 2, len(of)))
    cov[0, :, 0] = cov[1, :, 1] = std_m**2 * (of[:, None] == of)
    return cov.reshape(2 * len(of), 2 * len(of))


def _stacked(r: FloatArray) -> FloatArray:
    """(2a,) east of all, then north of all, of places (a, 2)."""
    return r.T.reshape(-1)


def _log_normal(x: FloatArray, cov: FloatArray) -> float:
    """ln N(x; 0, cov)."""
    lower = np.linalg.cholesky(cov)
    z = solve_triangular(lower, x, lower=True)
    return float(-0.5 * z @ z - np.sum(np.log(np.diag(lower))) - 0.5 * len(x) * np.log(2.0 * np.pi))
