"""One update of the estimator: state carried over, scene built, hypotheses searched, evidence folded."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from assoc.evidence.likelihood import bounded, fresh_state, put, restarted, taken, with_columns
from assoc.evidence.motion import ReportLog
from assoc.geometry.expected_view import chance_in_view
from assoc.geometry.ground import OFFSET, THETA, ground_now
from assoc.history import TrackHistory
from assoc.hypotheses.bias_memory import BiasMemory
from assoc.hypotheses.bias_noise import learnt_bias
from assoc.hypotheses.labels import mixed_marginals, weights
from assoc.hypotheses.priors import noise_of, prior_of
from assoc.hypotheses.search import Hypothesis, UpdateContext, keep_best, refine, shifts, swaps, turns
from assoc.identification.conflicts import ConflictWatch
from assoc.params import IdentifierParams
from assoc.records import CameraState, Sighting
from assoc.tracks.co_visibility import Company
from assoc.tracks.swap_risk import SwapRisk
from assoc.tracks.track_handover import replaced

__all__ = ["Estimator"]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_SURE = 0.9
_LOCK = 0.97
_SETTLED_S = 1.5
_RECENT_S = 1.5
_LARGE = 400
_SHAKEN = 12.0
"""A fall of a seen track's best score by this much from one update to the next, nats, opens the search again."""
_STRAINED, _STRAINED_S = 1.5, 3.0
"""Standard deviations of its prior that the clocks' offset may be off, while all is sure, and for how long."""
_STRANGE_S, _STRANGER_S = 2.5, 30.0
_SPARE = 0.5
"""So many tracks more than the vehicles expected in view are no strangers yet."""
_NOISE_EVERY_S = 3.0
_ANYWHERE = 0.5
"""How likely a vehicle is in view whose reports do not tell."""
_HEADING_STD = np.deg2rad(9.0)


class Estimator:
    """Evidence of all tracks and the best joint hypotheses."""

    def __init__(self, history: TrackHistory, log: ReportLog, params: IdentifierParams) -> None:
        self._history, self._log, self._params = history, log, params
        self._state = fresh_state(0, log.n_vehicles)
        self._first_block: int | None = None
        self._memory = BiasMemory(log.n_vehicles)
        self._ended: dict[int, int] = {}
        self._sure: dict[int, int] = {}
        self._company = Company(log.n_vehicles)
        self._claim = np.zeros((0, log.n_vehicles))
        """(T, n) what speaks for a vehicle from before a track broke off."""
        self._thetas: list[FloatArray] = []
        self._bias_std, self._tau_s = params.bias_m, params.bias_tau_s
        self._stranger_s = self._noise_s = -np.inf
        self._swaps = SwapRisk(params)
        self._updates = 0
        self._noted_s = -np.inf
        self._locked = False
        self._standing: dict[int, float] = {}
        self._shaken_s = -np.inf
        self._started_s = np.inf
        self._offset_std_s = params.time_offset_std_s
        self._strained_s = np.inf
        self._watch = ConflictWatch()
        self.conflict: tuple[int, ...] = ()
        self.theta_std: FloatArray = np.full(THETA, np.nan)
        """(8,) 1σ of ``theta``, NaN before the first update."""

    @property
    def theta(self) -> FloatArray:
        """(8,) pose correction of the best hypothesis."""
        return self._thetas[0] if self._thetas else np.zeros(THETA)

    @property
    def time_offset_s(self) -> float:
        """Estimated video time minus telemetry time, seconds."""
        return float(self.theta[OFFSET])

    @property
    def locked(self) -> bool:
        """Whether all is sure, so that the search may rest."""
        return self._locked

    def began(self, t: float, fresh: IntArray) -> None:
        """Start the evidence of new tracks, with the biases that are remembered."""
        self._started_s = min(self._started_s, t)
        self._state = with_columns(self._state, len(self._history.track_id))
        if len(fresh):
            mean, var = self._memory.recall(t, self._bias_std, self._tau_s)
            self._state = restarted(self._state, fresh, mean, var)
            width = len(self._history.track_id)
            self._company.begin(fresh, width)
            self._claim = np.pad(self._claim, ((0, width - len(self._claim)), (0, 0)))
            self._claim[fresh] = self._company.log_claims(self._history.before[fresh], self._params.switch_rate_leap)
            for column in fresh.tolist():
                self._swaps.forget(column)
                self._ended.pop(column, None)
                self._sure.pop(column, None)

    def update(self, t: float, camera: CameraState) -> tuple[IntArray, FloatArray]:
        """Marginals of the tracks that are seen, or were a moment ago: a missed box must not free its name.

        Args:
            t: Time of the newest frame, seconds.
            camera: Its camera.

        Returns:
            (m,) columns of the history and (m, n + 1) marginals, the last column "none of ours".
        """
        n, history = self._log.n_vehicles, self._history
        live = np.flatnonzero((history.track_id > 0) & (history.last_s > t - _RECENT_S))
        if not len(live) or not n:
            return live, np.concatenate([np.zeros((len(live), n)), np.ones((len(live), 1))], axis=1)
        self._updates += 1
        self._note_places(t, live, camera)
        scene = self._scene(t, live, camera)
        found = self._search(scene, camera)
        share = weights(found)
        self._thetas, self.theta_std = [h.theta for h in found[:3]], found[0].theta_std
        seen = scene.gap_s <= 0.0
        free = self._company.log_free(live, seen)
        p = mixed_marginals(found, share, self._bias_std, self._stranger_chance(t, scene), scene.in_view, free)
        self._company.note(live[seen], self._places(live[seen], camera), p[seen, :n], self._params.close_m)
        self._learn(t, scene, found[0], p, float(share[0]))
        p, self.conflict = self._watch.review(t, scene, found[0], p)
        self._fold(scene, found[0])
        return live, p

    def predicted(self, t: float) -> tuple[FloatArray, FloatArray]:
        """Where the vehicles should be seen on the corrected ground: (n, 2) metres and (n,) variance per axis."""
        p, age = self._log.extrapolated(t - self.time_offset_s)
        mean, var = self._memory.recall(t, self._bias_std, self._tau_s)
        # speed uncertain by 0.7 m/s over the age of the report
        return p + mean, var + self._log.white_std_m**2 + 0.1 + (0.7 * np.minimum(age, 1e3)) ** 2

    def residuals(
        self, t: float, sighting: Sighting, camera: CameraState, vehicle: IntArray
    ) -> tuple[FloatArray, FloatArray]:
        """(m,) ground distance of each track to its vehicle's extrapolated report, and its age; NaN unnamed."""
        now = t - self.time_offset_s
        p, age = self._log.extrapolated(now)[0], now - self._log.last_t
        g = ground_now(sighting.ray_cam, camera.R_enu_cam, camera.p_enu, camera.ground_z, self.theta)
        named = vehicle >= 0
        away = np.linalg.norm(g - p[np.maximum(vehicle, 0)], axis=1) if len(p) else np.full(len(vehicle), np.nan)
        old = age[np.maximum(vehicle, 0)] if len(p) else np.full(len(vehicle), np.nan)
        return np.where(named, away, np.nan), np.where(named, old, np.nan)

    def _scene(self, t: float, live: IntArray, camera: CameraState) -> UpdateContext:
        """What this update works on."""
        q = self._params
        last = int(np.floor(t / q.block_s)) + 1
        if self._first_block is None:
            self._first_block = int(np.floor(t / q.block_s)) - 1
        self._retire(t, live)
        columns = np.concatenate([live, np.array(sorted(self._ended), np.int64)])
        anchors = np.array([self._ended[c] for c in sorted(self._ended)], np.int64)
        view = self._in_view(t, camera)
        noise = noise_of(
            q,
            camera,
            white_std_m=self._log.white_std_m,
            bias_std=self._bias_std,
            tau_s=self._tau_s,
            patience=q.patience * view,
        )
        window_s = q.calm_window_s if self._locked else q.window_s
        return UpdateContext(
            history=self._history,
            columns=columns,
            live=len(live),
            gap_s=t - self._history.last_s[live],
            replaced=replaced(t, self._history, live, self.theta),
            anchors=anchors,
            log=self._log,
            first_block=self._first_block,
            last_block=last,
            block_s=q.block_s,
            gap_max_s=q.gap_max_s,
            first_look_s=3.0,
            heading_std=float(_HEADING_STD),
            state=bounded(taken(self._state, columns), self._bias_std),
            noise=noise,
            prior=prior_of(q, camera, self._offset_std_s),
            log_switch=self._swaps.log_chances(self._first_block, last - self._first_block + 1, columns),
            log_odds=q.prior_log_odds,
            claim=self._claim[live],
            view=view,
            in_view=q.in_view_log_odds * (2.0 * view - 1.0),
            fold=max(last - self._first_block - round(window_s / q.block_s), 0),
        )

    def _retire(self, t: float, live: IntArray) -> None:
        """Confident tracks that ended keep carrying the pose while they are in the window."""
        assert self._first_block is not None
        start = self._first_block * self._params.block_s
        for column in self._history.release(start - 1.0).tolist():
            self._ended.pop(column, None)
            self._sure.pop(column, None)
        present = set(live.tolist())
        for column in present:
            self._ended.pop(column, None)
        for column, vehicle in self._sure.items():
            if column not in present and self._history.last_s[column] > start:
                self._ended[column] = vehicle
        self._ended = {c: v for c, v in self._ended.items() if self._history.last_s[c] > start}

    def _note_places(self, t: float, seen: IntArray, camera: CameraState) -> None:
        """Tell the watch over tracker's swaps where the tracks are now."""
        since = self._history.start(self._noted_s + 1e-6)
        missed = np.any(np.isnan(self._history.ray[since : self._history.n, seen, 0]), axis=0)
        risky = self._swaps.note(t, seen, self._places(seen, camera), missed, self._first_block)
        self._company.forget(seen[risky])
        self._noted_s = t

    def _places(self, columns: IntArray, camera: CameraState) -> FloatArray:
        """(m, 2) where tracks are now, NaN unseen."""
        rays = self._history.ray[self._history.n - 1, columns]
        return ground_now(rays, camera.R_enu_cam, camera.p_enu, camera.ground_z, self.theta)

    def _in_view(self, t: float, camera: CameraState) -> FloatArray:
        """(n,) how likely each vehicle is in view."""
        p, age = self._log.extrapolated(t - self.time_offset_s)
        chance = chance_in_view(p, age, self._bias_std + self._log.white_std_m, camera, self.theta)
        return np.where(self._log.useless, _ANYWHERE, chance)

    def _search(self, scene: UpdateContext, camera: CameraState) -> list[Hypothesis]:
        """Best joint hypotheses, from few starts when locked and from many when not."""
        free = not camera.attitude_known
        if self._locked:
            found = [refine(scene, self._thetas[0].copy(), self._believed(scene))]
        else:
            found = keep_best([refine(scene, theta) for theta in self._starts(scene, free)], self._params.hypotheses)
        if not self._locked and self._updates % 3 == 1:
            most = 2 if self._large(scene) else 8
            found += [refine(scene, theta, blocks=found[0].blocks) for theta in shifts(scene, found[0], most)]
            found = keep_best(found, self._params.hypotheses)
        found += swaps(scene, found[0], 2 if self._locked else 6)
        return keep_best(found, self._params.hypotheses)

    def _starts(self, scene: UpdateContext, free: bool) -> list[FloatArray]:
        """Corrections to start from: those of the last update and the prior's; of many tracks mostly the best alone."""
        everywhere, turn = turns(scene.prior, free), self._updates
        if not self._thetas or (turn % 6 == 1 and not self._large(scene)):
            return [*self._thetas, *everywhere]
        others = [*self._thetas[1:], everywhere[0]]
        if not self._large(scene):
            return [self._thetas[0], *others]
        others += everywhere
        return [self._thetas[0]] if turn % 3 else [self._thetas[0], others[turn // 3 % len(others)]]

    def _large(self, scene: UpdateContext) -> bool:
        """Whether there are so many pairs that an update must do less."""
        return scene.live * self._log.n_vehicles > _LARGE

    def _believed(self, scene: UpdateContext) -> IntArray:
        """(m,) vehicles that the live tracks surely were, −1 none."""
        return np.array([self._sure.get(column, -1) for column in scene.columns[: scene.live].tolist()], np.int64)

    def _stranger_chance(self, t: float, scene: UpdateContext) -> float:
        """Prior chance of a look-alike, larger while strangers are about or more is seen than is expected."""
        q, seen = self._params, max(int(np.sum(scene.gap_s <= 0.0)), 1)
        if t - self._stranger_s < _STRANGER_S:
            return q.interloper_seen
        # c = c₀ + (c₁ − c₀) max(seen − Σ v − ½, 0) / seen
        left_over = max(seen - float(np.sum(scene.view)) - _SPARE, 0.0) / seen
        return q.interloper + (q.interloper_seen - q.interloper) * left_over

    def _learn(self, t: float, scene: UpdateContext, best: Hypothesis, p: FloatArray, share: float) -> None:
        """Keep what is sure: biases, strangers, anchors, and whether the search may rest."""
        n = p.shape[1] - 1
        live = scene.columns[: scene.live]
        age = t - self._history.first_s[live]
        top = np.argmax(p, axis=1)
        sure = (np.max(p, axis=1) > _SURE) & (age > _SETTLED_S)
        rows = np.flatnonzero(sure & (top < n))
        if t - self._noise_s >= _NOISE_EVERY_S:
            self._noise_s = t
            carrying = np.flatnonzero((np.max(p, axis=1) > 0.8) & (top < n))
            now = (self._bias_std, self._tau_s)
            self._bias_std, self._tau_s = learnt_bias(scene, best, carrying, top[carrying], self._state, now)
        self._memory.store(t, top[rows], best.final.mean[rows, top[rows]], best.final.var[rows, top[rows]])
        more = np.sum(scene.gap_s <= 0.0) > np.sum(scene.view) + _SPARE
        nobody = sure & (top == n) & (age > _STRANGE_S)
        if more and np.any(nobody):
            self._stranger_s = t
        for row, column in enumerate(live.tolist()):
            self._sure.pop(column, None)
            if sure[row] and top[row] < n:
                self._sure[column] = int(top[row])
        good = np.max(p, axis=1) > _LOCK
        enough = good.all() or (good.sum() >= max(3.0, 0.7 * len(good)) and share > _SURE)
        self._note_shaken(t, scene, best)
        self._note_strain(t)
        self._locked = bool(min(t - self._started_s, t - self._shaken_s) > 4.0 and enough)

    def _note_strain(self, t: float) -> None:
        """Take the offset of the clocks for unknown once it has long been farther off than its prior likes."""
        strained = self._locked and abs(self.time_offset_s) > _STRAINED * self._params.time_offset_std_s
        self._strained_s = min(self._strained_s, t) if strained else np.inf
        if t - self._strained_s > _STRAINED_S:
            self._offset_std_s = max(self._offset_std_s, self._params.unknown_offset_std_s)

    def _note_shaken(self, t: float, scene: UpdateContext, best: Hypothesis) -> None:
        """Open the search again when what was believed of a track has suddenly become doubtful."""
        top = np.max(best.score, axis=1)
        now = {int(c): float(s) for c, s, gap in zip(scene.columns, top, scene.gap_s, strict=False) if gap <= 0.0}
        if any(now[column] < self._standing.get(column, -np.inf) - _SHAKEN for column in now):
            self._shaken_s = t
        self._standing = now

    def _fold(self, scene: UpdateContext, best: Hypothesis) -> None:
        """Move evidence that leaves the window into the state."""
        assert self._first_block is not None
        if scene.fold:
            self._state = put(self._state, scene.columns, best.folded)
            self._first_block += scene.fold
