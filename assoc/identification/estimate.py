"""The estimator: each update searches joint hypotheses of pose and assignment and learns noise and biases from them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from assoc.evidence.likelihood import (
    Noise,
    bound_variance,
    initial_state,
    replace_tracks,
    reset_tracks,
    select_tracks,
    widen_tracks,
)
from assoc.evidence.motion import ReportLog
from assoc.geometry.expected_view import chance_in_view
from assoc.geometry.ground import EAST, HEIGHT, LAG, OFFSET, THETA, camera_at_frame, rays_to_ground
from assoc.geometry.sway import FAST_MPS, FREE_TURNS, TURNS, Sway, wander_in_flight, wander_of
from assoc.history import TrackHistory
from assoc.hypotheses.bias_memory import BiasMemory, learn_bias_noise
from assoc.hypotheses.labels import mixed_marginals, posterior_weights
from assoc.hypotheses.place_alone import StrangerLimit, limit_by_place, log_odds_among_strangers
from assoc.hypotheses.pose import is_gross
from assoc.hypotheses.priors import OffsetPrior, noise_of, prior_of
from assoc.hypotheses.search import (
    Hypothesis,
    UpdateContext,
    aimed,
    is_shifted,
    keep_best,
    refine,
    samples_of_window,
    shifts,
    swaps,
    turns,
)
from assoc.hypotheses.sway_fit import fit_sway
from assoc.identification.clutter import Clutter
from assoc.identification.conflicts import ConflictMonitor
from assoc.identification.doubts import AnswerDoubt, Doubted
from assoc.identification.fleet_fit import FleetFit
from assoc.identification.found_share import FoundShare, own_boxes
from assoc.identification.gross_errors import GrossErrors
from assoc.identification.other_errors import OtherErrors
from assoc.identification.search_lock import SearchLock, SearchState
from assoc.identification.stated_tracks import StatedTracks
from assoc.identification.steady import SteadyAnswers
from assoc.identification.unaccounted import Whereabouts, shared_with_missing
from assoc.params import MANY_PAIRS, IdentifierParams
from assoc.records import CameraState, Observation
from assoc.tracks.co_visibility import CoVisibility
from assoc.tracks.swap_risk import SwapRisk
from assoc.tracks.track_handover import exchangeable, replaced_tracks

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

_UNKNOWN_VIEW, _UNLOOKED_S = 0.5, 0.5
"""Chance of being in view of a vehicle whose reports are too uncertain to tell: even odds; and for how long, seconds,
nobody need look where it reports to be until the same goes for it."""
_LONGEST_AGE_S = 1e3
"""Upper limit of a report's age, seconds, so that a report never received gives a finite variance."""
_FAST_TAU_S = 2.5
"""Correlation time of errors that wander too fast for their course to tell anything, seconds."""
_SMOOTHED_S = 3.0
"""Time without a fit after which reports are taken for smoother than they are precise, seconds."""
_OTHER_EVERY = 3
"""Updates from one look at the course to the next, while vehicles are compared by place alone."""


@dataclass(frozen=True, slots=True)
class UpdateResult:
    """The results of one update for the tracks that are seen or were ``recent_s`` ago."""

    columns: IntArray
    """(m,) columns of the history."""
    p: FloatArray
    """(m, n + 1) marginals, the last column "none of ours"."""
    doubt: IntArray
    """(m,) :class:`AnswerDoubt` of each answer."""
    conflict: tuple[int, ...]
    """Indices of vehicles whose reports contradict the video or one another."""


class Estimator:
    """Evidence of all tracks and the best joint hypotheses.

    Args:
        history: Frames of the window.
        log: Reports of the window.
        params: Priors and limits.
        stated: What the operator stated.
        by_place: Compare by place alone: errors wander too fast for their course to tell anything.
    """

    def __init__(
        self,
        history: TrackHistory,
        log: ReportLog,
        params: IdentifierParams,
        stated: StatedTracks,
        *,
        by_place: bool = False,
    ) -> None:
        self.by_place, self._other_errors = by_place, OtherErrors(by_place=not by_place)
        self._history, self._log, self._params, self._stated = history, log, params, stated
        self._state = initial_state(0, log.n_vehicles)
        self.unlooked_s = np.zeros(log.n_vehicles)
        """(n,) for how long nobody looked where each vehicle reports to be, seconds."""
        self._first_block: int | None = None
        self._updates = 0
        self._thetas: list[FloatArray] = []
        """The best corrections of the last update: where the next one starts."""
        self._sway: Sway | None = None
        """Sway of the camera beyond them and beyond the pose that is reported."""
        self.theta_std: FloatArray = np.full(THETA, np.nan)
        """(9,) 1σ of ``theta``, NaN before the first update."""
        self._other_height = False
        """True: the best hypothesis has the height that another source gives."""
        self._lock = SearchLock(params.lock)
        self.fit, self.gross = FleetFit(proves=not by_place), GrossErrors()
        self._unfit_since_s = np.inf
        self._strangers, self._steady = StrangerLimit(), SteadyAnswers(params.threshold)
        # vehicle of each certainly named track, by column: live tracks, and ended ones that still constrain the pose
        self._confident: dict[int, int] = {}
        self._anchors: dict[int, int] = {}
        # which tracks the tracker may have exchanged, were in view together, or continue a track that ended at a gap
        self._swaps = SwapRisk(params)
        self._placed_s = -np.inf
        self._co_visibility = CoVisibility(log.n_vehicles)
        self._handover = np.zeros((0, log.n_vehicles))
        """(T, n) ln odds of a track's vehicles, taken over from the track it continues."""
        # learnt from certain names
        self._bias_memory = BiasMemory(log.n_vehicles)
        self._bias_std, self._tau_s = self._usual_errors(by_place=by_place)
        self._bias_learnt_s = -np.inf
        self._clutter, self._found = Clutter(params), FoundShare(log.n_vehicles)
        self._offset_prior = OffsetPrior(params)
        self._conflicts = ConflictMonitor()

    def restarted(self, log: ReportLog, *, by_place: bool) -> Estimator:
        """An estimator of the same window that has learnt nothing yet.

        Args:
            log: Reports that count from now on.
            by_place: Compare by place alone.
        """
        anew = Estimator(self._history, log, self._params, self._stated, by_place=by_place)
        anew._first_block = self._first_block
        return anew

    @property
    def theta(self) -> FloatArray:
        """(9,) pose correction of the best hypothesis, for the newest frame: also by how far its position is behind."""
        theta = self._thetas[0] if self._thetas else np.zeros(THETA)
        newest = self._history.n - 1
        if newest < 0:
            return theta
        theta = theta.copy()
        theta[EAST : HEIGHT + 1] += theta[LAG] * self._history.v[newest]
        return theta if self._sway is None else np.asarray(theta + self._sway.at(self._history.t[[newest]])[0])

    @property
    def fit_probability(self) -> float:
        """Probability that film and telemetry belong together; NaN unknown: before the first update, and while they fit
        only by the comparison that names are not given by."""
        return float("nan") if not self.fit.fits and self._other_errors.may_fit else self.fit.probability

    @property
    def fits_otherwise(self) -> bool:
        """True if names are to be given by the other comparison: by place instead of course, or the other way round."""
        return self._other_errors.found

    @property
    def height_error(self) -> tuple[float, float] | None:
        """Amount by which the camera is higher above the ground, and 1σ, metres, where another source's height fits."""
        if not (self._other_height and self.fit.fits):
            return None
        return float(self._thetas[0][HEIGHT]), float(self.theta_std[HEIGHT])

    @property
    def time_offset_s(self) -> float:
        """Estimated video time minus telemetry time, seconds."""
        return float(self._thetas[0][OFFSET]) if self._thetas else 0.0

    @property
    def locked(self) -> bool:
        """True if the search is locked: enough tracks have had certain answers for seconds."""
        return self._lock.state is SearchState.LOCKED

    def begin_tracks(self, t: float, columns: IntArray) -> None:
        """Reset the evidence of columns in which a new track begins; their bias filters start from the bias memory."""
        self._lock.start(t)
        self._state = widen_tracks(self._state, len(self._history.track_id))
        if len(columns):
            beside = np.setdiff1d(np.flatnonzero(self._history.last_s >= t), columns)
            seen = self._history.track_id[beside]
            mean, var = self._bias_memory.recall(t, self._bias_std, self._tau_s, seen)
            self._state = reset_tracks(self._state, columns, mean, var)
            width = len(self._history.track_id)
            self._co_visibility.begin(columns, width)
            self._handover = np.pad(self._handover, ((0, width - len(self._handover)), (0, 0)))
            before = self._history.before[columns]
            # two that are exchanged change both: each bears half
            near = exchangeable(t, self._history, before, self.theta)
            change = self._params.switch_rate_leap ** np.where(near, 0.5, 1.0)
            self._handover[columns] = self._co_visibility.log_handover(before, change)
            self._state = self._stated.with_statements(self._state, columns, self._history, after_gap=before >= 0)
            for column in columns.tolist():
                self._swaps.reset(column)
                self._anchors.pop(column, None)
                self._confident.pop(column, None)

    def restate(self, t: float, track_id: int, *, anew: bool) -> None:
        """Note that what is stated of a track has changed.

        Args:
            t: Time, seconds.
            track_id: The track.
            anew: What was seen of it before is given up, as it led to another answer.
        """
        self._lock.unlock(t)
        column = self._history.column_of(track_id)
        if column >= 0 and anew:
            self._history.end(track_id)
            self._confident.pop(column, None)
            self._co_visibility.forget(column)
        elif column >= 0:
            now = np.array([column]), self._history
            self._state = self._stated.with_statements(self._state, *now, after_gap=np.zeros(1, np.bool_))

    def update(self, t: float, camera: CameraState) -> UpdateResult:
        """Estimate pose and assignment from all frames and reports up to the newest frame.

        Args:
            t: Time of the newest frame, seconds.
            camera: Its camera.
        """
        n, history = self._log.n_vehicles, self._history
        live = np.flatnonzero((history.track_id > 0) & (history.last_s > t - self._params.search.recent_s))
        if not len(live) or not n:
            nothing = np.concatenate([np.zeros((len(live), n)), np.ones((len(live), 1))], axis=1)
            return UpdateResult(live, nothing, np.zeros(len(live), np.int64), ())
        self._updates += 1
        self._update_swap_risk(t, live, camera)
        context = self._context(t, live, camera)
        found = self._search(context, camera)
        best, share = found[0], posterior_weights(found)
        self._thetas = [h.theta for h in found[: self._params.search.start_hypotheses]]
        self.theta_std = best.theta_std
        self._other_height = bool(context.prior.part_at(best.theta).mean[HEIGHT])
        self._follow_sway(context, best, camera)
        seen = context.gap_s <= 0.0
        free = self._co_visibility.log_not_lost(live, seen)
        elsewhere = self._co_visibility.elsewhere(live)
        told = Doubted.of(mixed_marginals(found, share, context, free, elsewhere))
        self.fit.update(t, context, best, steady=camera.attitude_known and camera.stabilized)
        self._unfit_since_s = np.inf if self.fit.fits else min(self._unfit_since_s, t)
        if t - self._unfit_since_s > _SMOOTHED_S:
            self._log.take_for_smoothed()
        stated = self._stated.among(history.track_id[live])
        told = told.after(AnswerDoubt.FIT, self.fit.limited(told.p, stated))
        places = self._places(live, camera)
        if not self.fit.fits or (self.by_place and self._updates % _OTHER_EVERY == 0):
            other = not self.by_place
            noise = self._noise(camera, context.view, *self._usual_errors(by_place=other), by_place=other)
            self._other_errors.look(t, replace(context, noise=noise), camera)
        if not self.fit.fits:
            self.gross.look_mirrored(context, self.fit, camera)
            return self._without_names(t, context, best, self._told(t, context, best, told, elsewhere, places))
        p = told.p
        self._co_visibility.update(t, live[seen], places[seen], p[seen, :n], self._params.close_m)
        self._learn(t, context, best, p)
        strangers = context.clutter > self._params.clutter
        own = seen & own_boxes(best.vehicle, best.final.mean, self._bias_std, strangers=strangers)
        self._found.update(t, np.where(self.unlooked_s > 0.0, 0.0, context.view), best.vehicle[own])
        self._offset_prior.update(t, self.time_offset_s, locked=self.locked)
        score = np.max(best.score, axis=1)
        best_score = {int(c): float(s) for c, s, now in zip(live, score, seen, strict=True) if now}
        self._lock.update(t, np.max(p, axis=1), float(share[0]), best_score)
        review = self._conflicts.review(t, context, best, p, elsewhere)
        self._log.rejected_since = review.rejected_since
        self._fold(context, best)
        told = told.after(AnswerDoubt.DOUBLE, review.p)
        away = np.linalg.norm(places[:, None] - places, axis=2)
        by_place = limit_by_place(review.p, best.score, away, self._bias_std)
        bias = best.final.mean[: len(live)]
        odds = log_odds_among_strangers(
            *(by_place, best.score, bias, self._bias_std, context.view, context.noise.log_area_at(best.theta)),
            found=self._found.share,
        )
        told = told.after(AnswerDoubt.PLACE, self._strangers.limit(t, history.track_id[live], by_place, odds, stated))
        unsure = AnswerDoubt.WANDERING if self.by_place else AnswerDoubt.UNPROVEN
        told = told.after(unsure, self.fit.shown(told.p, stated))
        told = self._told(t, context, best, told, elsewhere, places)
        return UpdateResult(live, told.p, told.doubt, review.vehicles)

    def _told(
        self,
        t: float,
        context: UpdateContext,
        best: Hypothesis,
        told: Doubted,
        elsewhere: BoolArray,
        places: FloatArray,
    ) -> Doubted:
        """Marginals as they are reported: no stranger is sure while one of ours is missing, and no answer at once."""
        log, live = self._log, context.columns[: context.live]
        _, age = log.extrapolated(t - self.time_offset_s)
        fleet = Whereabouts(place=log.last_p, age_s=age, view=context.view, last_t=log.believed_t)
        ids, first_s = self._history.track_id[live], self._history.first_s[live]
        stated, former = self._stated.among(ids), self._conflicts.former(ids)
        shared = shared_with_missing(told.p, places, first_s, best.score, elsewhere, former, fleet)
        tracks = list(zip(ids.tolist(), first_s.tolist(), strict=True))
        # who is stated to be a vehicle is no sure stranger either, while that one is nowhere else
        strangers = self._stated.strangers_among(ids)
        told = told.after(AnswerDoubt.MISSING, np.where(strangers[:, None], told.p, shared))
        return told.after(AnswerDoubt.UNSTEADY, self._steady.limited(t, tracks, told.p, stated))

    def _follow_sway(self, context: UpdateContext, best: Hypothesis, camera: CameraState) -> None:
        """Fit the sway of a camera that is fixed to the body, or how one wanders whose places are coarse."""
        fitted = None
        if not camera.stabilized:
            fitted = fit_sway(context, best, TURNS if camera.attitude_known else FREE_TURNS)
        elif np.isfinite(camera.position_std_m):
            fitted = fit_sway(context, best, wander_of(camera.position_std_m))
        elif self._history.speed_mps > FAST_MPS:
            fitted = fit_sway(context, best, wander_in_flight(self._history.speed_mps))
        if fitted is None:
            self._sway = None
        else:
            self._thetas[0], self._sway = fitted

    def _without_names(self, t: float, context: UpdateContext, best: Hypothesis, told: Doubted) -> UpdateResult:
        """The result while film and telemetry do not fit: nothing is learnt from it, and no vehicle is accused."""
        self._confident.clear()
        self._anchors.clear()
        self._lock.unlock(t)
        self._fold(context, best)
        return UpdateResult(context.columns[: context.live], told.p, told.doubt, ())

    def predicted(self, t: float) -> tuple[FloatArray, FloatArray]:
        """Return the places where the vehicles' tracks are expected under the correction: (n, 2) metres, (n,) variance
        per axis, m²."""
        q = self._params
        p, age = self._log.extrapolated(t - self.time_offset_s)
        mean, var = self._bias_memory.recall(t, self._bias_std, self._tau_s)
        moved = (q.predicted_speed_std_mps * np.minimum(age, _LONGEST_AGE_S)) ** 2
        return p + mean, var + self._log.white_std_m**2 + q.predicted_floor_m2 + moved

    def reported(self, t: float) -> tuple[FloatArray, FloatArray]:
        """Reported places of the vehicles at a time, (n, 2) metres, and ages of the reports, (n,) seconds."""
        now = t - self.time_offset_s
        return self._log.extrapolated(now)[0], now - self._log.last_t

    def camera_at_frame(self, t: float, camera: CameraState) -> CameraState:
        """The camera when the frame of a time was taken, by the offset of the clocks that was found."""
        return camera_at_frame(self._history, t, camera, self.time_offset_s)

    def places(self, observation: Observation, camera: CameraState) -> FloatArray:
        """Places of a frame's boxes under the correction, (m, 2) east and north, metres."""
        return rays_to_ground(observation.ray_cam, camera.R_enu_cam, camera.p_enu, camera.ground_z, self.theta)

    def deviations(self, t: float, places: FloatArray) -> FloatArray:
        """(m, n) how far places (m, 2) are from where each vehicle's track is expected, in standard deviations."""
        usual, var = self.predicted(t)
        return np.asarray(np.linalg.norm(places[:, None] - usual[None], axis=2) / np.sqrt(var))

    def _context(self, t: float, live: IntArray, camera: CameraState) -> UpdateContext:
        """The inputs of this update."""
        q = self._params
        last = int(np.floor(t / q.block_s)) + 1
        if self._first_block is None:
            self._first_block = int(np.floor(t / q.block_s)) - 1
        self._update_anchors(live)
        ended = sorted(self._anchors)
        columns = np.concatenate([live, np.array(ended, np.int64)])
        view = self._chance_in_view(t, camera)
        gap_s = t - self._history.last_s[live]
        window_s = q.locked_window_s if self.locked else q.window_s
        return UpdateContext(
            history=self._history,
            columns=columns,
            live=len(live),
            gap_s=gap_s,
            replaced=replaced_tracks(t, self._history, live, self.theta),
            anchors=np.array([self._anchors[c] for c in ended], np.int64),
            log=self._log,
            samples=samples_of_window(self._log, self._first_block, last, q.block_s),
            first_block=self._first_block,
            last_block=last,
            block_s=q.block_s,
            gap_max_s=q.gap_max_s,
            extrapolated_max_s=q.search.extrapolated_max_s,
            heading_std=q.search.heading_std,
            state=bound_variance(select_tracks(self._state, columns), self._bias_std),
            noise=self._noise(camera, view, self._bias_std, self._tau_s, by_place=self.by_place),
            prior=prior_of(q, camera, self._offset_prior.std_s, self._history.speed_mps),
            log_switch=self._swaps.log_chances(self._first_block, last - self._first_block + 1, columns),
            log_odds=q.prior_log_odds,
            handover=self._handover[live],
            view=view,
            in_view=q.in_view_log_odds * (2.0 * view - 1.0) - self._found.log_odds_lost * view,
            clutter=self._clutter.chance(t, int(np.sum(gap_s <= 0.0)), view[self.unlooked_s <= 0.0]),
            age_s=t - self._history.first_s[live],
            fold=max(last - self._first_block - round(window_s / q.block_s), 0),
            sway=self._sway,
        )

    def _usual_errors(self, *, by_place: bool) -> tuple[float, float]:
        """σ_b, metres, and τ, seconds, before anything was learnt of them."""
        return self._params.bias_m, _FAST_TAU_S if by_place else self._params.bias_tau_s

    def _noise(self, camera: CameraState, view: FloatArray, bias_std: float, tau_s: float, *, by_place: bool) -> Noise:
        """Noise levels of this update, with biases of a size, metres, and a correlation time, seconds."""
        return noise_of(
            self._params,
            camera,
            white_std_m=self._log.white_std_m,
            bias_std=bias_std,
            tau_s=tau_s,
            in_view_bonus=self._params.in_view_bonus * view * self._found.trust,
            by_place=by_place,
        )

    def _update_anchors(self, live: IntArray) -> None:
        """Update which confidently named tracks that ended go on constraining the pose while they are in the window."""
        assert self._first_block is not None
        start = self._first_block * self._params.block_s
        for column in self._history.release(start - 1.0).tolist():
            self._anchors.pop(column, None)
            self._confident.pop(column, None)
        present = set(live.tolist())
        for column in present:
            self._anchors.pop(column, None)
        for column, vehicle in self._confident.items():
            if column not in present and self._history.last_s[column] > start:
                self._anchors[column] = vehicle
        self._anchors = {c: v for c, v in self._anchors.items() if self._history.last_s[c] > start}

    def _update_swap_risk(self, t: float, live: IntArray, camera: CameraState) -> None:
        """Update from the tracks' places which of them the tracker may have exchanged."""
        since = self._history.first_row_since(self._placed_s + 1e-6)
        missed = np.any(np.isnan(self._history.ray[since : self._history.n, live, 0]), axis=0)
        risky = self._swaps.update(t, live, self._places(live, camera), missed, self._first_block)
        self._co_visibility.reset(live[risky])
        self._placed_s = t

    def _places(self, columns: IntArray, camera: CameraState) -> FloatArray:
        """(m, 2) ground positions of tracks in the newest frame, metres, NaN unseen."""
        rays = self._history.ray[self._history.n - 1, columns]
        return rays_to_ground(rays, camera.R_enu_cam, camera.p_enu, camera.ground_z, self.theta)

    def _chance_in_view(self, t: float, camera: CameraState) -> FloatArray:
        """(n,) probability of each vehicle to be in view."""
        p, age = self._log.extrapolated(t - self.time_offset_s)
        chance = chance_in_view(p, age, self._bias_std + self._log.white_std_m, camera, self.theta)
        return np.where(self._log.too_uncertain | (self.unlooked_s > _UNLOOKED_S), _UNKNOWN_VIEW, chance)

    def _search(self, context: UpdateContext, camera: CameraState) -> list[Hypothesis]:
        """Best joint hypotheses: from the last pose alone when locked, else from several starting poses."""
        q = self._params.search
        if self.locked:
            live = context.columns[: context.live].tolist()
            vehicle = np.array([self._confident.get(column, -1) for column in live], np.int64)
            found = [refine(context, self._thetas[0].copy(), vehicle)]
            if self._stands():
                found += self._shifted(context, found[0])
        else:
            starts = self._starts(context, not camera.attitude_known)
            starts += self.gross.starts(context.prior, self.fit, at_once=not self._is_large(context))
            if not self.fit.clear:
                starts += aimed(context, self.time_offset_s)[: 1 if self._is_large(context) else None]
            found = [refine(self._as_remembered(context, theta), theta) for theta in starts]
            found = self._expected(found, context)
            if shifted := self._shifted(context, found[0]):
                found = self._expected(found + shifted, context)
        found += swaps(context, found[0], q.swaps_locked if self.locked else q.swaps)
        return keep_best(found, q.hypotheses)

    def _shifted(self, context: UpdateContext, best: Hypothesis) -> list[Hypothesis]:
        """Hypotheses in which the whole fleet is at other vehicles' places, every few updates."""
        q = self._params.search
        if self._updates % q.shift_every != 1:
            return []
        stands, found = self._stands(), list[Hypothesis]()
        for theta in shifts(context, best, q.shifts_many if self._is_large(context) else q.shifts):
            inputs = context.moved(theta, best.theta) if stands else context
            found.append(refine(inputs, theta, blocks=best.blocks))
        return found

    def _as_remembered(self, context: UpdateContext, theta: FloatArray) -> UpdateContext:
        """The inputs for a start: moved, if it was another place of the fleet in the last update already."""
        others = self._thetas[1:]
        shifted = any(theta is other for other in others) and is_shifted(theta, self._thetas[0])
        return context.moved(theta, self._thetas[0]) if shifted and self._stands() else context

    def _stands(self) -> bool:
        """Tell whether no vehicle drives: a pose that was wrong has always been wrong by the same."""
        return not np.any(self._log.moves)

    def _expected(self, found: list[Hypothesis], context: UpdateContext) -> list[Hypothesis]:
        """The best hypotheses; none with a gross error while the fleet is explained without one.

        Others that drive in our formation would make up for any error that moves it by one place.
        """
        most = self._params.search.hypotheses
        best = keep_best(found, most)
        if not (self.fit.usual and is_gross(context.prior.part_at(best[0].theta).mean)):
            return best
        usual = [h for h in found if not is_gross(context.prior.part_at(h.theta).mean)]
        usual = keep_best(usual or [refine(context, np.zeros(THETA))], most)
        return usual if self.fit.explains(context, usual[0]) else best

    def _starts(self, context: UpdateContext, free: bool) -> list[FloatArray]:
        """Starting poses: those of the last update and of the prior; with many pairs mostly the last best alone."""
        q, count = self._params.search, self._updates
        everywhere = turns(context.prior, free)
        if not self._thetas or (count % q.spread_every == 1 and not self._is_large(context)):
            return [*self._thetas, *everywhere]
        others = [*self._thetas[1:], everywhere[0]]
        if not self._is_large(context):
            return [self._thetas[0], *others]
        others += everywhere
        alone, k = count % q.shift_every, count // q.shift_every
        return [self._thetas[0]] if alone else [self._thetas[0], others[k % len(others)]]

    def _is_large(self, context: UpdateContext) -> bool:
        """Tell whether there are so many pairs that an update must do less."""
        return context.live * self._log.n_vehicles > MANY_PAIRS

    def _learn(self, t: float, context: UpdateContext, best: Hypothesis, p: FloatArray) -> None:
        """Learn from certain answers: noise, biases, clutter, and which tracks may constrain the pose once ended."""
        q, n, live = self._params.learning, p.shape[1] - 1, context.columns[: context.live]
        age, top, certainty = t - self._history.first_s[live], np.argmax(p, axis=1), np.max(p, axis=1)
        # what is stated was not measured
        measured = ~self._stated.among(self._history.track_id[live])
        certain = (certainty > q.confidence) & (age > q.least_age_s) & measured
        self._learn_bias_noise(t, context, best, np.where((certainty > q.noise_confidence) & measured, top, n))
        rows = np.flatnonzero(certain & (top < n))
        tracks = self._history.track_id[live[rows]]
        self._bias_memory.store(t, top[rows], tracks, best.final.mean[rows, top[rows]], best.final.var[rows, top[rows]])
        self._clutter.note(t, context, certain & (top == n) & (age > q.clutter_age_s))
        for column in live.tolist():
            self._confident.pop(column, None)
        self._confident.update(zip(live[rows].tolist(), top[rows].tolist(), strict=True))

    def _learn_bias_noise(self, t: float, context: UpdateContext, best: Hypothesis, vehicle: IntArray) -> None:
        """Learn how large the position biases are and how fast they wander, from (m,) named tracks; n unnamed."""
        if self.by_place or t - self._bias_learnt_s < self._params.learning.noise_every_s:
            return
        self._bias_learnt_s = t
        rows, now = np.flatnonzero(vehicle < self._log.n_vehicles), (self._bias_std, self._tau_s)
        self._bias_std, self._tau_s = learn_bias_noise(context, best, rows, vehicle[rows], self._state, now)

    def _fold(self, context: UpdateContext, best: Hypothesis) -> None:
        """Absorb the evidence of blocks that leave the window into the state."""
        assert self._first_block is not None
        if context.fold:
            self._state = replace_tracks(self._state, context.columns, best.folded)
            self._first_block += context.fold
