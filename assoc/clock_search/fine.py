"""Fit of a fleet to a film at one offset of its clock: camera pose, assignment and offset are fitted together.

The evidence is that of the identifier's hypotheses, over the whole film at once: with L_ij the ln ratio of a pair that
belongs together to one that is unrelated, n vehicles, and the pose integrated out,

    V = Σ max(L_ij − ln n, 0) − ½ θᵀΛθ + ½ ln|Λ| − ½ ln|Λ + JᵀJ| − c u,

the ln ratio of two normalised densities: that the film shows this fleet then, to that it shows something else. So V is
comparable between offsets, and with 0. A vehicle may be several tracks one after the other; u are the seconds in which
vehicles should be well inside the picture and are no track's.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from assoc.clock_search.inputs import CameraPath, FleetLog, under_path
from assoc.evidence.blocks import Blocks
from assoc.evidence.likelihood import Noise, bound_variance, initial_state
from assoc.evidence.motion import ReportLog
from assoc.geometry.ground import OFFSET, THETA, YAW, ground_to_rays
from assoc.history import TrackHistory
from assoc.hypotheses.marginals import best_assignment
from assoc.hypotheses.pose import Fitted, PosePrior, fit, whiten
from assoc.hypotheses.priors import noise_of
from assoc.hypotheses.search import UpdateContext, residual_blocks, samples_of_window, scores
from assoc.params import IdentifierParams
from assoc.records import CameraState

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_OFFSET_STD_S = 0.6
"""Prior 1σ of what the offset is off the grid of the coarse search, seconds."""
_FIXED_STD_S = 0.01
"""Prior 1σ of an offset that is not to be moved, seconds."""
_LAG_STD_S = 1e-3
"""Prior 1σ of the age of the camera's positions, seconds: a path has none, or it is part of the offset."""
_RECENTRE_S = 0.08
"""An offset that is moved further is looked at again from there."""
_RECENTRES = 4
_ITERATIONS = 5
_BEFORE_S, _AFTER_S = 8.0, 3.0
"""Reports this long before the film teach the null model the vehicles' speed; and after it those that a late video
needs, seconds."""
_KNOWN_YAW_STD, _FREE_YAW_STD = np.deg2rad(7.0), np.deg2rad(30.0)
"""1σ of a heading that is known, and of one about the coarse search's where it is not."""
_YAW_RATE_STD = np.deg2rad(0.1)
_BIAS_TAU_S = 60.0
_BIAS_STD_M = 1.0
_MIN_SEEN_S = 2.0
"""Tracks that are seen for a shorter time are left out."""
_UNSEEN_PER_S = 0.4
"""c, nats per second: one vehicle in three is missed, for seconds on end, or is not of a kind that is looked for."""
_WELL_INSIDE = 0.85
"""Share of the picture, from its middle, in which a vehicle should be seen."""
_LOG_SWITCH = -25.0
"""ln chance that a track jumps to another vehicle in a block."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OffsetFit:
    """The best explanation near one offset."""

    offset_s: float
    """δ, seconds."""
    std_s: float
    """1σ of the offset, seconds, if the assignment is right."""
    evidence: float
    """V, nats."""
    pairs: int
    """Tracks that are matched."""
    vehicles: int
    """Vehicles that are matched."""
    yaw: float
    """Correction of the heading, radians clockwise."""
    matched_s: float
    """Seconds in which vehicles are compared with their tracks, of all vehicles together."""
    seen_share: float
    """Share of the time in which vehicles should be well inside the picture that they are matched; NaN none should."""


def _together(tracks: TrackHistory, columns: IntArray) -> NDArray[np.bool_]:
    """(T, T) tracks that are seen at the same time: they are not one vehicle."""
    first, last = tracks.first_s[columns], tracks.last_s[columns]
    return np.asarray((first[:, None] < last[None]) & (first[None] < last[:, None]))


def assignment(score: FloatArray, together: NDArray[np.bool_]) -> IntArray:
    """Vehicle of each track, −1 none: one to one, then tracks left over to vehicles that are not seen meanwhile."""
    answer = best_assignment(score)
    while True:
        taken = np.zeros(score.shape, np.bool_)
        for vehicle in np.unique(answer[answer >= 0]):
            taken[:, vehicle] = together[:, answer == vehicle].any(axis=1)
        left = np.where(taken | (answer >= 0)[:, None], -np.inf, score)
        if not np.any(left > 0.0):
            return answer
        more = best_assignment(np.where(left > 0.0, left, -1e9))
        answer = np.where(more >= 0, more, answer)


def _log_at(tracks: TrackHistory, log: FleetLog, offset_s: float) -> ReportLog:
    """The fleet's reports about the film's time, on its clock under an offset."""
    start, stop = float(tracks.t[0]), float(tracks.t[tracks.n - 1])
    reports = log.between(start - _BEFORE_S + offset_s, stop + _AFTER_S + offset_s)
    about = ReportLog(log.n, stop - start + 2.0 * (_BEFORE_S + _AFTER_S))
    about.add(np.asarray(reports.t_us * 1e-6 - offset_s, np.float64), reports)
    return about


def fit_at(
    tracks: TrackHistory,
    path: CameraPath,
    log: FleetLog,
    offset_s: float,
    yaw: float,
    *,
    camera_too: bool,
    free: bool = True,
) -> OffsetFit | None:
    """Fit pose, assignment and offset from a start; None where nothing can be compared.

    Args:
        tracks: The film.
        path: The camera's.
        log: The fleet's.
        offset_s: δ to start from, seconds.
        yaw: ψ to start from, radians clockwise.
        camera_too: The camera's path is on the fleet's clock; else on the film's.
        free: The offset is fitted too; else it stays where it is.
    """
    theta = np.zeros(THETA)
    theta[YAW] = yaw
    found: OffsetFit | None = None
    reports = _log_at(tracks, log, offset_s)
    if not np.isfinite(reports.first_t).any():
        return None
    for _ in range(_RECENTRES):
        ahead_s = offset_s if camera_too else 0.0
        context = _context(under_path(tracks, path, ahead_s), path, reports, yaw, free=free)
        if not context.live:
            return None
        theta, now = _fitted(context, theta, offset_s, path.half_view)
        # video minus telemetry: θ_δ late video is a fleet's clock that is behind
        moved = -float(theta[OFFSET])
        if found is not None and now.evidence < found.evidence - 1.0:
            return found
        found = now
        if abs(moved) < _RECENTRE_S or not free:
            break
        offset_s += moved
        reports = reports.later(-moved)
        theta[OFFSET] = 0.0
    return found


def _context(history: TrackHistory, path: CameraPath, reports: ReportLog, yaw: float, *, free: bool) -> UpdateContext:
    """Context of the fit, over the whole film at once."""
    q = IdentifierParams()
    start, stop = float(history.t[0]), float(history.t[history.n - 1])
    columns = np.flatnonzero(history.last_s - history.first_s >= _MIN_SEEN_S)
    first, last = int(np.floor(start / q.block_s)), int(np.floor(stop / q.block_s))
    n, count = reports.n_vehicles, len(columns)
    camera = CameraState(
        R_enu_cam=history.R[0],
        p_enu=history.p[0],
        ground_z=path.ground_z,
        px_rad=path.px_rad,
        attitude_known=path.heading_known,
        position_known=True,
        stabilized=True,
    )
    noise: Noise = noise_of(
        q,
        camera,
        white_std_m=reports.white_std_m,
        bias_std=_BIAS_STD_M,
        tau_s=_BIAS_TAU_S,
        in_view_bonus=np.zeros(n),
    )
    mean = np.zeros(THETA)
    mean[YAW] = 0.0 if path.heading_known else yaw
    yaw_std = _KNOWN_YAW_STD if path.heading_known else _FREE_YAW_STD
    level, late = path.position_std_m, _OFFSET_STD_S if free else _FIXED_STD_S
    std = np.array(
        [yaw_std, _YAW_RATE_STD, path.tilt_std, path.tilt_std, level, level, path.height_std_m, late, _LAG_STD_S]
    )
    return UpdateContext(
        history=history,
        columns=columns,
        live=count,
        gap_s=np.zeros(count),
        replaced=np.zeros(count, np.bool_),
        anchors=np.empty(0, np.int64),
        log=reports,
        samples=samples_of_window(reports, first, last, q.block_s),
        first_block=first,
        last_block=last,
        block_s=q.block_s,
        gap_max_s=q.gap_max_s,
        extrapolated_max_s=0.0,
        heading_std=q.search.heading_std,
        state=bound_variance(initial_state(count, n), _BIAS_STD_M),
        noise=noise,
        prior=PosePrior(std=std, mean=mean),
        log_switch=np.full((last - first + 2, count), _LOG_SWITCH),
        log_odds=-float(np.log(n)),
        handover=np.zeros((count, n)),
        view=np.ones(n),
        in_view=np.zeros(n),
        clutter=q.clutter,
        age_s=np.full(count, stop - start),
        fold=0,
    )


def _fitted(
    context: UpdateContext, theta: FloatArray, offset_s: float, half_view: tuple[float, float]
) -> tuple[FloatArray, OffsetFit]:
    """The joint optimum of pose and assignment from a starting pose."""
    together = _together(context.history, context.columns)
    blocks: Blocks = residual_blocks(context, theta)
    score = scores(context, blocks, theta)[0]
    vehicle = assignment(score, together)
    for _ in range(_ITERATIONS):
        rows = np.flatnonzero(vehicle >= 0)
        fitted: Fitted = fit(whiten(blocks, rows, vehicle[rows], context.state, context.noise), context.prior)
        theta = fitted.theta
        blocks = residual_blocks(context, theta)
        score = scores(context, blocks, theta)[0]
        before, vehicle = vehicle, assignment(score, together)
        if np.array_equal(before, vehicle):
            break
    rows = np.flatnonzero(vehicle >= 0)
    matched, expected = _seen_blocks(context, blocks, theta, vehicle, half_view)
    evidence = float(np.sum(score[rows, vehicle[rows]])) - context.prior.cost(theta) + fitted.cost
    evidence -= _UNSEEN_PER_S * context.block_s * (expected - matched)
    return theta, OffsetFit(
        offset_s=offset_s - float(theta[OFFSET]),
        std_s=float(fitted.std[OFFSET]),
        evidence=evidence,
        pairs=len(rows),
        vehicles=len(np.unique(vehicle[rows])),
        yaw=float(theta[YAW]),
        matched_s=context.block_s * float(np.count_nonzero(blocks.count[:, rows, vehicle[rows]] > 0.0)),
        seen_share=matched / expected if expected else float("nan"),
    )


def _seen_blocks(
    context: UpdateContext, blocks: Blocks, theta: FloatArray, vehicle: IntArray, half_view: tuple[float, float]
) -> tuple[int, int]:
    """Count the blocks in which vehicles are matched, and those in which they should be well inside the picture."""
    block_s, first = context.block_s, context.first_block
    count = context.last_block - first + 1
    samples = context.samples
    block = np.floor(samples.t / block_s).astype(np.int64) - first
    history, edge = context.history, _WELL_INSIDE * np.array(half_view)
    inside = np.zeros((count, context.log.n_vehicles), np.bool_)
    middles = (first + np.arange(count) + 0.5) * block_s
    frames = np.clip(np.searchsorted(history.t[: history.n], middles), 0, history.n - 1)
    for b, frame in enumerate(frames.tolist()):
        rows = np.flatnonzero(block == b)
        ray = ground_to_rays(samples.p[rows], history.R[frame], history.p[frame], float(history.z[frame]), theta)
        ahead = ray[:, 2] > 0.0
        within = np.all(np.abs(ray[:, :2]) < edge * np.where(ahead, ray[:, 2], 1.0)[:, None], axis=1)
        inside[b, samples.vehicle[rows[ahead & within]]] = True
    matched = np.zeros_like(inside)
    for track in np.flatnonzero(vehicle >= 0).tolist():
        matched[:, vehicle[track]] |= blocks.count[:count, track, vehicle[track]] > 0.0
    return int(np.count_nonzero(inside & matched)), int(np.count_nonzero(inside))
