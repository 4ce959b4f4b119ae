"""The stateful identifier: frames and reports in, names with probabilities out.

Per update: rays → ground under several pose corrections, residuals against reports, evidence per pair, joint
hypotheses of pose and assignment, matching marginals. See ``docs/identity.md``.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from assoc.evidence.motion import ReportLog
from assoc.geometry.ground import ground_now
from assoc.history import TrackHistory
from assoc.identification.estimate import Estimator
from assoc.identification.output import HeldMasses, compose, no_beliefs
from assoc.methods.reattach import reattach_gated
from assoc.params import IdentifierParams
from assoc.records import CameraState, Identities, Sighting, VehicleReports

__all__ = ["CameraState", "Identifier", "IdentifierParams", "Identities", "Sighting", "VehicleReports"]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_BACKWARD_S = 1.0
_EASY = 400
_STITCH_SURE = 0.8
_YOUNG_S = 0.5
_REST = 3.0
_STARTLING_M = 1.5
_AWAKE_S = 3.0


class Identifier:
    """Names the tracks of a video by the vehicles' reports, frame by frame and causally.

    Args:
        system_ids: System ids of the vehicles; reports refer to them by index.
        params: Priors and limits.
    """

    def __init__(self, system_ids: Sequence[int], params: IdentifierParams | None = None) -> None:
        self._params = params or IdentifierParams()
        self._ids = np.array(system_ids, np.int64)
        self._origin_us: int | None = None
        self._t = self._thought_s = -np.inf
        self._history, self._log, self._estimator = _parts(len(self._ids), self._params)
        self._beliefs = no_beliefs(len(self._ids))
        self._residual_m: dict[int, float] = {}
        self._startled_s = -np.inf
        self._held = HeldMasses()

    @property
    def pose_correction(self) -> FloatArray:
        """(8,) θ = yaw, yaw rate, pitch, roll (radians, /s), E, N, H (metres), δ (seconds)."""
        return self._estimator.theta.copy()

    @property
    def pose_correction_std(self) -> FloatArray:
        """(8,) its 1σ if the names are right, NaN before the first update."""
        return self._estimator.theta_std.copy()

    @property
    def sure(self) -> bool:
        """Whether nothing is in doubt: as good as all tracks have names, and have had them for seconds."""
        return self._estimator.locked

    def hear(self, reports: VehicleReports) -> None:
        """Take what the vehicles said since the last call; before :meth:`stitch`, which goes by the newest reports."""
        if len(reports.t_us):
            self._log.add(self._seconds(reports.t_us), reports)

    def update(self, sighting: Sighting, camera: CameraState, reports: VehicleReports | None = None) -> Identities:
        """Take one frame.

        Args:
            sighting: Its tracks.
            camera: Where the camera was.
            reports: What the vehicles said since the last call, unless it was heard already.

        Returns:
            The names, in the order of the sighting.
        """
        t = float(self._seconds(np.array(sighting.t_us)))
        if t < self._t - _BACKWARD_S:
            self._reset()
        if reports is not None:
            self.hear(reports)
        if t > self._t:
            self._see(t, sighting, camera)
        beliefs = self._beliefs.of(sighting.track_id)
        threshold, held = self._params.threshold, self._held
        answer = compose(self._ids, beliefs, sighting, camera, self._log, self._estimator, t, threshold, held)
        self._note_startled(t, answer)
        return answer

    def stitch(self, t_us: int, track_id: IntArray, ray_cam: FloatArray, camera: CameraState) -> IntArray:
        """Lost tracks that leftover detections continue, by where their vehicles report to be.

        Args:
            t_us: Time of the frame, Unix µs.
            track_id: (a,) lost tracks.
            ray_cam: (b, 3) rays of the detections that no track took, camera frame.
            camera: The camera at that time.

        Returns:
            (p, 2) rows of ``track_id`` and of ``ray_cam`` that belong together.
        """
        usable = _usable(camera)
        if self._origin_us is None or usable is None or not len(track_id) or not len(ray_cam):
            return np.empty((0, 2), np.int64)
        p = self._beliefs.of(track_id).p[:, :-1]
        sure = np.max(p, axis=1, initial=0.0) > _STITCH_SURE
        vehicle = np.where(sure, np.argmax(p, axis=1) if p.shape[1] else -1, -1)
        place, variance = self._estimator.predicted((t_us - self._origin_us) / 1e6)
        ground = ground_now(ray_cam, usable.R_enu_cam, usable.p_enu, usable.ground_z, self._estimator.theta)
        return reattach_gated(place, variance, vehicle, ground)

    def _seconds(self, t_us: IntArray) -> FloatArray:
        """Seconds since the first thing that was seen or heard."""
        if self._origin_us is None:
            self._origin_us = int(np.min(t_us))
        return (t_us - self._origin_us) / 1e6

    def _see(self, t: float, sighting: Sighting, camera: CameraState) -> None:
        """Store the frame and, when it is time, think."""
        usable = _usable(camera)
        if usable is None:
            return
        fresh = self._history.append(t, sighting, usable)
        self._t = t
        self._estimator.began(t, fresh)
        waited, every = t - self._thought_s, self._interval()
        young = np.any((self._history.track_id != 0) & (self._history.first_s > t - _YOUNG_S))
        rest = 0.25 if len(fresh) else 0.5 if young else self._rest()
        if waited >= every * rest - 1e-6:
            self._thought_s = t
            columns, p = self._estimator.update(t, usable)
            # what is believed of a track is not worse for its box being missed
            seen = np.flatnonzero(self._history.last_s[columns] >= t)
            ids = self._history.track_id[columns[seen]]
            self._beliefs = self._beliefs.renewed(ids, p[seen], self._estimator.conflict)

    def _note_startled(self, t: float, answer: Identities) -> None:
        """A named track that is suddenly elsewhere than its vehicle ends the rest."""
        named = np.flatnonzero(np.isfinite(answer.residual_m))
        tracks, away_m = answer.track_id[named].tolist(), answer.residual_m[named].tolist()
        now: dict[int, float] = dict(zip(tracks, away_m, strict=True))
        if any(away > self._residual_m.get(track, away) + _STARTLING_M for track, away in now.items()):
            self._startled_s, self._thought_s = t, -np.inf
        self._residual_m = now

    def _interval(self) -> float:
        """Seconds between full updates: longer for many tracks and vehicles, so that frames keep their pace."""
        return self._params.every_s * float(np.clip(self._work(), 1.0, 4.0))

    def _rest(self) -> float:
        """How much longer an update may wait while nothing is in doubt; hard work has its longer interval already."""
        calm = self._estimator.locked and self._t > self._startled_s + _AWAKE_S
        return max(_REST / max(self._work(), 1.0), 1.0) if calm else 1.0

    def _work(self) -> float:
        """Pairs to be weighed, in units of what is done easily."""
        return int(np.sum(self._history.track_id != 0)) * len(self._ids) / _EASY

    def _reset(self) -> None:
        """Forget everything: time ran backwards."""
        self._t = self._thought_s = self._startled_s = -np.inf
        self._history, self._log, self._estimator = _parts(len(self._ids), self._params)
        self._beliefs = no_beliefs(len(self._ids))
        self._residual_m = {}
        self._held = HeldMasses()


def _parts(n: int, params: IdentifierParams) -> tuple[TrackHistory, ReportLog, Estimator]:
    """Empty memory for n vehicles."""
    history = TrackHistory(params.window_s + 2.0, params.frame_step_s, params.gap_max_s)
    log = ReportLog(n, params.window_s + 2.0)
    return history, log, Estimator(history, log, params)


def _usable(camera: CameraState) -> CameraState | None:
    """The camera state, straight down where the attitude is missing; None without a position."""
    if not (np.isfinite(camera.p_enu).all() and np.isfinite(camera.ground_z)):
        return None
    if np.isfinite(camera.R_enu_cam).all():
        return camera
    down = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]])
    return CameraState(
        R_enu_cam=down,
        p_enu=camera.p_enu,
        ground_z=camera.ground_z,
        px_rad=camera.px_rad,
        attitude_known=False,
        position_known=camera.position_known,
        stabilized=camera.stabilized,
        half_view=camera.half_view,
    )
