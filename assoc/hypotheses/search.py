"""Joint hypotheses of camera pose and assignment.

A hypothesis is refined by coordinate ascent: scores at θ → best assignment → best θ for it, until the assignment no
longer changes. Against local optima it starts from several poses: the prior's mean, and turned, shifted or swapped
versions.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from assoc.evidence.blocks import Blocks, make_blocks, with_extrapolated_block
from assoc.evidence.likelihood import Noise, PairState, bound_variance, initial_state, moved_state, run_filter
from assoc.evidence.motion import ReportLog, Samples
from assoc.geometry.ground import EAST, NORTH, OFFSET, PITCH, THETA, YAW, bearing_and_depression, ground_tracks
from assoc.geometry.sway import Sway
from assoc.history import TrackHistory
from assoc.hypotheses.look_alikes import Discounts, discounts, unseen_evidence
from assoc.hypotheses.marginals import best_assignment
from assoc.hypotheses.pose import Fitted, PosePrior, fit, misfit, whiten

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

_ITERATIONS = 4
"""Most iterations of assignment and pose: two or three usually suffice, and the assignment may alternate for ever."""
_SWAP_LOSS = 40.0
"""Swaps that lose more than this at the present θ, nats, are not tried."""
_UNSEEN_SCORE_MAX, _UNSEEN_LOSS_PER_S = 8.0, 20.0
"""Upper limit of the score of an unseen track that another one replaced, nats, and what the score of any unseen track
loses per second, nats/s."""
_SHIFT_STD, _MIN_SHIFT_M, _DISTINCT_SHIFT_M = 4.0, 1.0, 1.5
"""Shifts are tried up to this many prior σ, from this many metres on, and at this distance from one another, metres."""
_TURN_DEG, _SIDE_DEG = 20.0, 12.0
"""Starting headings: all round in steps of the first where none is known, else the second to both sides."""
_WIDE_OFFSET_S, _OFFSET_START_S = 0.2, 0.35
"""Prior 1σ of the clock offset above which starting offsets of ± the second are tried too, seconds."""
_NEGLIGIBLE = 12.0
"""Hypotheses this far below the best, nats, carry no weight."""
_RELINEARISE = np.array([0.03, 1e-3, 0.015, 0.015, np.inf, np.inf, 2.0, 0.1, 0.15])
"""Residuals are linearised again when θ moved further than this (as θ); they are linear in east and north."""
_FAR_M = 20.0
"""1σ of places along the line of sight by the pitch's, metres, from which on the fit does not find the way."""
_AIM_STD_M, _AIM_STD_RAD = 3.0, 0.002
"""1σ of a pair's directions: metres across the line of sight or along the ground, and radians."""
_AIM_GAIN = 50.0
"""A: a track in the direction of a vehicle counts 4 nats, one that is not nothing."""
_AIM_STDS = 3.0
"""Corrections of more prior σ than this, both together, are not tried."""
_DISTINCT_AIM = 2.0
"""Starts differ by more than this many σ of a pair."""
_AIMS, _MAX_TRACKS, _MAX_TRIED = 3, 16, 400
"""Number of poses, and most tracks and corrections that are compared for them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class UpdateContext:
    """The inputs of one update. T tracks: the m live ones first, then confident ones that ended."""

    history: TrackHistory
    columns: IntArray
    """(T,) columns of the history."""
    live: int
    """m."""
    gap_s: FloatArray
    """(m,) seconds since each live track was seen."""
    replaced: BoolArray
    """(m,) whether another track began since, near enough to be the same vehicle."""
    anchors: IntArray
    """(T − m,) vehicle of each track that ended."""
    log: ReportLog
    samples: Samples
    """Reports of the window, see :func:`samples_of_window`."""
    first_block: int
    """Number of the first block of the window."""
    last_block: int
    """Number of the last block of the window."""
    block_s: float
    """Length of a block, seconds."""
    gap_max_s: float
    """Longest hole in a track that is bridged, seconds."""
    extrapolated_max_s: float
    """Oldest report that is extrapolated to a pair's first comparison, seconds."""
    heading_std: float
    """1σ of an image heading against a reported heading, radians."""
    state: PairState
    """Evidence of the T tracks before the first block."""
    noise: Noise
    prior: PosePrior
    log_switch: FloatArray
    """(B + 1, T) ln chance of a change of owner in each block."""
    log_odds: float
    """Prior ln odds that a track close enough to a vehicle's report is that vehicle."""
    handover: FloatArray
    """(m, n) addition to ``log_odds`` for tracks that continue another one: the evidence of that one, nats."""
    view: FloatArray
    """(n,) probability of each vehicle to be in view."""
    in_view: FloatArray
    """(n,) addition to ``log_odds`` because the vehicle should be in view, nats."""
    clutter: float
    """Prior chance that a track is a look-alike that moves like one of ours."""
    age_s: FloatArray
    """(m,) age of each live track, seconds."""
    fold: int
    """Blocks that leave the window with this update."""
    sway: Sway | None = None
    """Sway of the camera about the pose that is reported; None: not known to."""

    def rows_under(self, theta: FloatArray) -> tuple[int, FloatArray | None]:
        """The history's first row in the window under θ, and (F, 9) the sway from there on."""
        since = self.first_block * self.block_s + theta[OFFSET] - self.gap_max_s
        start = min(self.history.first_row_since(since), self.history.n - 1)
        return start, None if self.sway is None else self.sway.at(self.history.t[start : self.history.n])

    def with_reports(self, log: ReportLog) -> UpdateContext:
        """Return the context with other reports."""
        samples = samples_of_window(log, self.first_block, self.last_block, self.block_s)
        return replace(self, log=log, samples=samples)

    def without_memory(self) -> UpdateContext:
        """Return the context of the window alone: no ended tracks, nothing remembered from before it, no sway."""
        return replace(
            self,
            columns=self.columns[: self.live],
            anchors=np.empty(0, np.int64),
            state=bound_variance(initial_state(self.live, self.log.n_vehicles), self.noise.bias_std),
            log_switch=self.log_switch[:, : self.live],
            fold=0,
            sway=None,
        )

    def moved(self, theta: FloatArray, origin: FloatArray) -> UpdateContext:
        """Return the context as if the pose had always been another: what is remembered of residuals is a shift
        further.

        Else a fleet that was matched one place off would stay there, however much its window speaks for the other.

        Args:
            theta: (9,) that pose.
            origin: (9,) the pose that it was remembered with.
        """
        shift = (theta - origin)[[EAST, NORTH]]
        return replace(self, state=moved_state(self.state, shift, self.noise.bias_std))


@dataclass(frozen=True, slots=True, kw_only=True)
class Hypothesis:
    """A joint estimate of the assignment of tracks to vehicles and of the pose correction."""

    theta: FloatArray
    """(9,)."""
    theta_std: FloatArray
    """(9,) 1σ of θ if the assignment is right."""
    vehicle: IntArray
    """(m,) −1 none."""
    value: float
    """ln evidence, up to a constant."""
    unseen: float
    """Σ ln D, its part that look-alikes beside vehicles without a track explain."""
    score: FloatArray
    """(m, n) ln ratios at θ."""
    final: PairState
    """State after the last block, T tracks."""
    folded: PairState
    """State after the blocks that leave the window."""
    blocks: Blocks


def samples_of_window(log: ReportLog, first_block: int, last_block: int, block_s: float) -> Samples:
    """Samples of the blocks from a first one to a last one, ``block_s`` seconds each."""
    return log.samples(first_block * block_s, (last_block + 1) * block_s)


def residual_blocks(context: UpdateContext, theta: FloatArray) -> Blocks:
    """The residuals linearised at θ."""
    start, sway = context.rows_under(theta)
    tracks = ground_tracks(context.history, start, theta, context.columns, sway)
    blocks = make_blocks(
        tracks,
        context.samples,
        context.log.n_vehicles,
        first=context.first_block,
        last=context.last_block,
        block_s=context.block_s,
        gap_max_s=context.gap_max_s,
        heading_std=context.heading_std,
        white_var=context.noise.white_var,
        pixel_var=context.noise.pixel_var,
    )
    p, age = context.log.extrapolated(float(tracks.t[-1] - theta[OFFSET]))
    return with_extrapolated_block(blocks, tracks, context.state.seen, p, age, context.extrapolated_max_s)


def scores(context: UpdateContext, blocks: Blocks, theta: FloatArray) -> tuple[FloatArray, tuple[PairState, PairState]]:
    """(m, n) ln ratios of the live tracks at θ, and the states behind them: after the last block, and folded."""
    final, folded = run_filter(blocks, theta, context.state, context.noise, context.log_switch, context.fold)
    odds = context.log_odds + context.handover + context.in_view
    score = final.score[: context.live] + blocks.heading[: context.live] + odds
    gap = context.gap_s[:, None]
    # an unseen track loses its vehicle to the track that replaced it
    most = np.where(context.replaced[:, None], _UNSEEN_SCORE_MAX, np.inf)
    return np.where(gap > 0.0, np.minimum(score, most) - _UNSEEN_LOSS_PER_S * gap, score), (final, folded)


def posing_pairs(context: UpdateContext, vehicle: IntArray) -> tuple[IntArray, IntArray]:
    """Rows and vehicles of the pairs that constrain the pose: the assigned live tracks and the anchors."""
    rows = np.flatnonzero(vehicle >= 0)
    ended = np.arange(context.live, len(context.columns))
    return np.concatenate([rows, ended]), np.concatenate([vehicle[rows], context.anchors])


def refine(
    context: UpdateContext, theta: FloatArray, vehicle: IntArray | None = None, blocks: Blocks | None = None
) -> Hypothesis:
    """Alternate assignment and pose from a starting point to a joint optimum.

    Args:
        context: What the update works on.
        theta: (9,) to start from; the part of the prior that it belongs to holds.
        vehicle: (m,) assignment to start from, if there is one already.
        blocks: Residuals that hold at ``theta``, if there are any already.
    """
    context = replace(context, prior=context.prior.part_at(theta)) if context.prior.others else context
    blocks = blocks or residual_blocks(context, theta)
    if vehicle is None:
        vehicle = best_assignment(scores(context, blocks, theta)[0])
    for iteration in range(_ITERATIONS):
        fitted = fit(whiten(blocks, *posing_pairs(context, vehicle), context.state, context.noise), context.prior)
        theta = fitted.theta
        if np.any(np.abs(theta - blocks.theta) > _RELINEARISE) and iteration < _ITERATIONS - 1:
            blocks = residual_blocks(context, theta)
        score, states = scores(context, blocks, theta)
        before, vehicle = vehicle, best_assignment(score)
        if np.array_equal(before, vehicle):
            break
    return _evaluated(context, fitted, vehicle, score, states, blocks)


def _evaluated(
    context: UpdateContext,
    fitted: Fitted,
    vehicle: IntArray,
    score: FloatArray,
    states: tuple[PairState, PairState],
    blocks: Blocks,
) -> Hypothesis:
    """Hypothesis with its value Σ L + Σ ln D − ½ θᵀΛθ + ½ ln|Λ| − ½ ln|Λ + JᵀJ|; D as in :func:`unseen_evidence`."""
    rows = np.flatnonzero(vehicle >= 0)
    unseen = unseen_evidence(discounts_of(context, score, states[0], vehicle), vehicle)
    value = float(np.sum(score[rows, vehicle[rows]])) + unseen - context.prior.cost(fitted.theta) + fitted.cost
    return Hypothesis(
        theta=fitted.theta,
        theta_std=fitted.std,
        vehicle=vehicle,
        value=value,
        unseen=unseen,
        score=score,
        final=states[0],
        folded=states[1],
        blocks=blocks,
    )


def discounts_of(context: UpdateContext, score: FloatArray, final: PairState, vehicle: IntArray) -> Discounts:
    """Discounts for what look-alikes explain, of (m, n) scores and the state behind them under an assignment (m,)."""
    return discounts(
        score,
        final.inherited[: context.live],
        final.mean[: context.live],
        context.noise.bias_std,
        context.clutter,
        context.in_view,
        context.age_s,
        vehicle,
    )


def swaps(context: UpdateContext, best: Hypothesis, most: int) -> list[Hypothesis]:
    """Variants of a hypothesis in which two tracks exchange their vehicles and θ is fitted again."""
    rows = np.flatnonzero(best.vehicle >= 0)
    if len(rows) < 2:
        return []
    at = best.score[np.ix_(rows, best.vehicle[rows])]
    own = np.diagonal(at)
    loss = own[:, None] + own[None, :] - at - at.T
    loss[np.tril_indices(len(rows))] = np.inf
    found = []
    for k in np.argsort(loss, axis=None, kind="stable")[:most]:
        a, b = np.unravel_index(int(k), loss.shape)
        if not loss[a, b] < _SWAP_LOSS:
            break
        vehicle = best.vehicle.copy()
        vehicle[rows[[a, b]]] = vehicle[rows[[b, a]]]
        hypothesis = _with_assignment(context, best, vehicle)
        if hypothesis is not None:
            found.append(hypothesis)
    return found


def _with_assignment(context: UpdateContext, best: Hypothesis, vehicle: IntArray) -> Hypothesis | None:
    """The hypothesis with a given assignment and its best θ; None when its value is negligible against the best."""
    context = replace(context, prior=context.prior.part_at(best.theta))
    white = whiten(best.blocks, *posing_pairs(context, vehicle), context.state, context.noise)
    fitted = fit(white, context.prior)
    theta = fitted.theta
    rows = np.flatnonzero(vehicle >= 0)
    gain = float(np.sum(misfit(white, best.theta)) - np.sum(misfit(white, theta)))
    # Σ L at the best θ, plus what the misfit gains by the move, less the prior's cost of it
    value = float(np.sum(best.score[rows, vehicle[rows]])) + gain - context.prior.cost(theta) + fitted.cost
    if value < best.value - _NEGLIGIBLE:
        return None
    score, states = scores(context, best.blocks, theta)
    return _evaluated(context, fitted, vehicle, score, states, best.blocks)


def is_shifted(theta: FloatArray, origin: FloatArray) -> bool:
    """Tell whether two poses (9,) differ by more than an estimate wanders: by the place of a neighbour."""
    return bool(np.hypot(*(theta - origin)[[EAST, NORTH]]) >= _MIN_SHIFT_M)


def shifts(context: UpdateContext, best: Hypothesis, most: int) -> list[FloatArray]:
    """Starting poses shifted so that one track falls on another vehicle, against formations matched one place off."""
    residual = (
        best.blocks.mean[:, : context.live].sum(axis=0)
        / np.maximum((best.blocks.count[:, : context.live] > 0).sum(axis=0), 1)[..., None]
    )
    residual = residual[(best.blocks.count[:, : context.live] > 0).any(axis=0)]
    far = np.hypot(residual[:, 0], residual[:, 1])
    limit = _SHIFT_STD * np.hypot(context.prior.std[EAST], context.noise.bias_std)
    starts: list[FloatArray] = []
    taken: list[FloatArray] = []
    for k in np.argsort(far, kind="stable"):
        if far[k] > limit or len(starts) >= most:
            break
        if far[k] < _MIN_SHIFT_M or any(np.hypot(*(residual[k] - other)) < _DISTINCT_SHIFT_M for other in taken):
            continue
        taken.append(residual[k])
        theta = best.theta.copy()
        theta[[EAST, NORTH]] -= residual[k]
        starts.append(theta)
    return starts


def turns(prior: PosePrior, pose_free: bool) -> list[FloatArray]:
    """Starts from the prior: its mean, turned to both sides (all round without attitude), earlier and later."""
    found = [np.zeros(THETA)]
    yaws = np.deg2rad(np.arange(_TURN_DEG, 360.0, _TURN_DEG) if pose_free else np.array([_SIDE_DEG, -_SIDE_DEG]))
    for yaw in yaws:
        start = np.zeros(THETA)
        start[YAW] = (yaw + np.pi) % (2 * np.pi) - np.pi
        found.append(start)
    if prior.std[OFFSET] > _WIDE_OFFSET_S:
        for delta in (-_OFFSET_START_S, _OFFSET_START_S):
            start = np.zeros(THETA)
            start[OFFSET] = delta
            found.append(start)
    return found


def aimed(context: UpdateContext, offset_s: float) -> list[FloatArray]:
    """Starts from a camera that looks far, whose heading and pitch are aimed so that boxes fall on vehicles.

    A camera at the height h that looks down by ε moves a place by h/sin²ε · Δpitch along the line of sight: at 6° and
    50 m up by 80 m a degree. From the pose that is reported no pair is near then, and nothing leads to the right one.
    So each pair of a track of the newest frame and a vehicle tells a heading and a pitch, and those under which most
    tracks are in the direction of a vehicle are starts:

        Σ_k ln(1 + A exp(−½ min_j (Δβ²/σ_β² + Δε²/σ_ε²)_kj)) − ½ (yaw²/σ_yaw² + pitch²/σ_pitch²).

    Args:
        context: Tracks, reports and the prior.
        offset_s: δ by which they are compared.

    Returns:
        (9,) each, best first; none where the camera looks so steeply that every start leads there.
    """
    history, row = context.history, context.history.n - 1
    rays = history.ray[row, context.columns[: context.live]]
    d = rays[np.isfinite(rays[:, 0])] @ history.R[row].T
    d = d[:: 1 + len(d) // _MAX_TRACKS]
    place, _ = context.log.extrapolated(float(history.t[row]) - offset_s)
    place = place[np.isfinite(place[:, 0])]
    to = np.column_stack([place, np.full(len(place), history.z[row])]) - history.p[row]
    if len(d) < 2 or len(to) < 2:
        return []
    seen, wanted = bearing_and_depression(d), bearing_and_depression(to)
    height, away = -float(to[0, 2]), np.linalg.norm(to, axis=1)
    std = context.prior.std[[YAW, PITCH]]
    if std[1] * height <= _FAR_M * np.sin(np.median(wanted[:, 1])) ** 2:
        return []
    sides = np.stack([_AIM_STD_M / away, _AIM_STD_M * height / away**2], axis=1) + _AIM_STD_RAD
    # (m, n, 2) yaw and pitch of each pair: a camera that is pitched up sees everything lower
    aim = (wanted[None] - seen[:, None]) * (1.0, -1.0)
    aim[..., 0] = (aim[..., 0] + np.pi) % (2.0 * np.pi) - np.pi
    tried = aim.reshape(-1, 2)
    cost = np.sum((tried / std) ** 2, axis=1)
    likely = np.argsort(cost, kind="stable")[:_MAX_TRIED]
    likely = likely[cost[likely] < _AIM_STDS**2]
    tried, cost = tried[likely], cost[likely]
    # (c, m, n, 2) what is left of each pair under each aim
    left = (aim[None] - tried[:, None, None]) / sides
    near = np.min(np.sum(left**2, axis=3), axis=2)
    score = np.sum(np.log1p(_AIM_GAIN * np.exp(-0.5 * near)), axis=1) - 0.5 * cost
    found: list[FloatArray] = []
    apart = _DISTINCT_AIM * np.median(sides, axis=0)
    for k in np.argsort(-score, kind="stable").tolist():
        if all(np.any(np.abs(tried[k] - other[[YAW, PITCH]]) > apart) for other in found):
            start = np.zeros(THETA)
            start[OFFSET], start[[YAW, PITCH]] = offset_s, tried[k]
            found.append(start)
            if len(found) == _AIMS:
                break
    return found


def keep_best(found: list[Hypothesis], most: int) -> list[Hypothesis]:
    """The best hypothesis of each distinct assignment, highest value first."""
    kept: dict[bytes, Hypothesis] = {}
    for hypothesis in sorted(found, key=lambda h: -h.value):
        kept.setdefault(hypothesis.vehicle.tobytes(), hypothesis)
    return list(kept.values())[:most]
