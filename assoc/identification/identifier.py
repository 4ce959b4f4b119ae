"""The stateful identifier: camera frames and position reports in, vehicle ids with probabilities out.

Per update: rays are projected to the ground under several pose corrections and compared with the reports; the
residuals give the evidence of each pair, joint hypotheses of pose and assignment, and from these marginals.
See ``docs/identity.md``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from assoc.evidence.motion import ReportLog
from assoc.geometry.ground import PITCH, ROLL, YAW, ground_to_rays, place_covariance, rays_to_ground
from assoc.history import TrackHistory
from assoc.identification.common_boxes import CommonBoxes
from assoc.identification.doubts import AnswerDoubt, lowered
from assoc.identification.estimate import Estimator
from assoc.identification.gross_errors import MIRROR
from assoc.identification.near_horizon import NearHorizon
from assoc.identification.output import Beliefs, CandidateCache, MassCache, compose_identities, empty_beliefs
from assoc.identification.stated_tracks import NONE_OF_OURS, StatedTracks
from assoc.methods.reattach import reattach_gated
from assoc.params import MANY_PAIRS, IdentifierParams
from assoc.records import CameraState, Identities, Observation, Sighting, VehicleReports

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_MARGIN_S = 2.0
"""Frames and reports are kept this much longer than the window, seconds: clocks differ, and only whole blocks count."""
_HEADING_KNOWN = 0.35
"""1σ of the estimated heading, radians, below which it stands for one that is not reported."""
_BY_PLACES_EVERY_S = 5.0
"""Time between two looks at places on the ground, seconds, while vehicles are named by their directions."""
_COMMON_STD_M, _UNFIT_STD_M = 1.5, 5.0
"""1σ of what the places of a frame share, metres, with the pose found, and before."""
_ROUNDING_S = 1e-6
"""Tolerance of due times, seconds: time stamps are whole microseconds."""


class Identifier:
    """Identifies the tracks of a video with the reporting vehicles, frame by frame, from past data only.

    Args:
        system_ids: System ids of the vehicles; reports refer to them by index.
        params: Priors and limits.
    """

    def __init__(self, system_ids: Sequence[int], params: IdentifierParams | None = None) -> None:
        self._params = params or IdentifierParams()
        self._ids = np.array(system_ids, np.int64)
        self._origin_us: int | None = None
        self._history: TrackHistory
        self._log: ReportLog
        self._estimator: Estimator
        self._beliefs: Beliefs
        self._stated = StatedTracks(self._params.stated, -float(np.log(self._params.switch_rate_leap)))
        self._near_horizon: NearHorizon
        self._by_angles: bool
        self._common_boxes: CommonBoxes
        self._residual_m: dict[int, float]
        self._mirrored: bool
        self._last_update_s: float
        self._reset()

    @property
    def pose_correction(self) -> FloatArray:
        """(9,) θ = yaw, yaw rate, pitch, roll (radians, /s), E, N, H (metres), δ, λ (seconds)."""
        theta = self._estimator.theta.copy()
        if self._mirrored:
            # the level axes of R F point the other way
            theta[[PITCH, ROLL]] *= -1.0
        return theta

    @property
    def pose_correction_std(self) -> FloatArray:
        """(9,) its 1σ if the names are right, NaN before the first update."""
        return self._estimator.theta_std.copy()

    @property
    def height_error(self) -> tuple[float, float] | None:
        """Amount by which the camera is higher above the ground than reported, and 1σ, metres.

        None unless film and telemetry fit with a height that another source gives, not with that of ``ground_z``.
        """
        return self._estimator.height_error

    @property
    def fit_probability(self) -> float:
        """Probability that film and telemetry belong together, NaN while nothing was compared."""
        if self._by_angles:
            return self._near_horizon.probability
        return self._estimator.fit_probability

    @property
    def by_course(self) -> bool:
        """True while names rest on the course of places on the ground: not on their size alone, not on directions, and
        not on a mirrored picture.
        """
        return not (self._estimator.by_place or self._by_angles or self._mirrored)

    @property
    def mirrored(self) -> bool:
        """True if left and right of the picture were found to be exchanged."""
        return self._mirrored

    @property
    def locked(self) -> bool:
        """True if the search is locked: nearly all tracks have had certain answers for seconds."""
        return self._estimator.locked

    def add_reports(self, reports: VehicleReports) -> None:
        """Add the positions that arrived since the last call; to be called before :meth:`stitch`, which uses them."""
        if len(reports.t_us):
            self._log.add(self._seconds(reports.t_us), reports)

    def raise_ground(self, by_m: float) -> None:
        """Take in that the ground has been higher all along than the cameras so far had it, metres.

        Reports were moved to where those cameras see them, so that only the newest places are kept of them.
        """
        self._history.z[: self._history.n] += by_m
        self._log, self._common_boxes = self._log.begun_anew(), CommonBoxes(len(self._ids))
        self._begin_anew()

    def change_fleet(self, system_ids: Sequence[int]) -> None:
        """Name these vehicles from now on, by the same frames and reports: those who stay have their names back soon.

        What was stated of tracks is to be stated again.
        """
        before = {system_id: k for k, system_id in enumerate(self._ids.tolist())}
        rows = np.array([before.get(system_id, -1) for system_id in system_ids], np.int64)
        self._ids, n = np.array(system_ids, np.int64), len(rows)
        self._log = self._log.of_vehicles(rows)
        self._stated.clear()
        self._beliefs = empty_beliefs(n)
        self._near_horizon, self._common_boxes = NearHorizon(n, self._params), CommonBoxes(n)
        self._residual_m = {}
        self._masses, self._candidates = MassCache(), CandidateCache()
        self._begin_anew()

    def update(
        self,
        observation: Observation,
        camera: CameraState,
        reports: VehicleReports | None = None,
        *,
        unlooked_s: Mapping[int, float] = MappingProxyType({}),
        heard: Callable[[Sighting], FloatArray] | None = None,
    ) -> Identities:
        """Name the tracks of one frame.

        Args:
            observation: Its tracks.
            camera: Where the camera was.
            reports: Positions that arrived since the last call, unless they were added already.
            unlooked_s: For how long nobody looked where a vehicle reports to be, seconds, by system id: that it has no
                box says nothing. 0, or none, where somebody looked in this frame.
            heard: From what this view alone has of the tracks that it sees, their probabilities by what is known
                elsewhere, too; they change the names of this frame, and neither evidence nor pose.

        Returns:
            The names, in the order of the observation.
        """
        t = float(self._seconds(np.array(observation.t_us)))
        if t < self._t - self._params.schedule.rewind_s:
            self._reset()
        if reports is not None:
            self.add_reports(reports)
        camera = self._as_seen(camera)
        self._estimator.unlooked_s = np.array([unlooked_s.get(i, 0.0) for i in self._ids.tolist()])
        if t > self._t:
            self._add_frame(t, observation, camera)
        camera = self._estimator.camera_at_frame(t, camera)
        beliefs = self._beliefs.for_tracks(observation.track_id)
        stated = self._stated.among(observation.track_id)
        p = self._common_boxes.limited(t, observation, beliefs.p, stated)
        doubt = lowered(AnswerDoubt.COMMON_BOX, beliefs.p, p, beliefs.doubt)
        if heard is not None:
            own, free = p, np.flatnonzero(~stated)
            p = own.copy()
            p[free] = heard(self._sighting(observation, camera, free, own[free]))
            doubt = lowered(AnswerDoubt.ELSEWHERE, own, p, doubt)
        answer = compose_identities(
            self._ids,
            replace(beliefs, p=p, doubt=doubt),
            observation,
            camera,
            self._log,
            self._estimator,
            t,
            self._params.threshold,
            self._masses,
            self._candidates,
        )
        self._watch_residuals(t, answer)
        return answer

    def _sighting(self, observation: Observation, camera: CameraState, rows: IntArray, p: FloatArray) -> Sighting:
        """Some tracks of a frame by this view alone, as it is told to others; p: (k, n + 1)."""
        usable, estimator = _complete_state(camera), self._estimator
        place, cov_m2 = np.full((len(rows), 2), np.nan), np.zeros((len(rows), 2, 2))
        if usable is not None:
            at = usable.R_enu_cam, usable.p_enu, usable.ground_z
            place = rays_to_ground(observation.ray_cam[rows], *at, estimator.theta)
            place[observation.gap_s[rows] > 0.0] = np.nan
            cov_m2 = place_covariance(place - usable.p_enu[:2], usable.p_enu[2] - usable.ground_z)
        fit = np.nan_to_num(self.fit_probability)
        return Sighting(
            t_us=observation.t_us - round(estimator.time_offset_s * 1e6),
            track_id=observation.track_id[rows],
            place=place,
            cov_m2=cov_m2,
            common_std_m=_COMMON_STD_M if fit > 0.5 else _UNFIT_STD_M,
            p=p,
            fit=float(fit),
        )

    def state(self, track_id: int, system_id: int) -> None:
        """Take an operator's statement as evidence: strong, and overcome by reports that contradict it for seconds.

        Where the track was another vehicle until now, what was seen of it before is given up.

        Args:
            track_id: The track.
            system_id: Of the vehicle that it is; 0: none of ours.

        Raises:
            ValueError: no such vehicle.
        """
        vehicle = self._ids.tolist().index(system_id) if system_id else NONE_OF_OURS
        self._stated.set(track_id, vehicle)
        p = self._beliefs.for_tracks(np.array([track_id])).p[0]
        # the last column is "none of ours"
        self._restate(track_id, anew=int(np.argmax(p)) != vehicle % len(p))

    def unstate(self, track_id: int) -> None:
        """Give up what was stated of a track, and what was seen of it since; nothing where nothing was."""
        if self._stated.withdraw(track_id):
            self._restate(track_id, anew=True)

    def _restate(self, track_id: int, *, anew: bool) -> None:
        self._estimator.restate(self._t, track_id, anew=anew)
        self._last_update_s = -np.inf

    def expected_rays(self, p_enu: FloatArray, camera: CameraState) -> FloatArray | None:
        """Rays from the camera, its pose corrected, to places on the ground.

        Args:
            p_enu: (k, 3) metres.
            camera: The camera's state.

        Returns:
            (k, 3) camera frame; None while the camera's pose is unknown.
        """
        usable = _complete_state(self._as_seen(camera))
        turned = camera.attitude_known or self._estimator.theta_std[YAW] < _HEADING_KNOWN
        if usable is None or not turned:
            return None
        at = usable.R_enu_cam, usable.p_enu, usable.ground_z
        return ground_to_rays(p_enu[:, :2], *at, self._estimator.theta)

    def stitch(self, t_us: int, track_id: IntArray, ray_cam: FloatArray, camera: CameraState) -> IntArray:
        """Match lost tracks with unmatched detections by the reported positions of the tracks' vehicles.

        Args:
            t_us: Time of the frame, Unix µs.
            track_id: (a,) lost tracks.
            ray_cam: (b, 3) rays of the unmatched detections, camera frame.
            camera: The camera at that time.

        Returns:
            (p, 2) matched rows of ``track_id`` and ``ray_cam``.
        """
        usable = _complete_state(self._as_seen(camera))
        if self._origin_us is None or usable is None or not len(track_id) or not len(ray_cam):
            return np.empty((0, 2), np.int64)
        p = self._beliefs.for_tracks(track_id).p[:, :-1]
        sure = np.max(p, axis=1, initial=0.0) > self._params.stitch_confidence
        vehicle = np.where(sure, np.argmax(p, axis=1) if p.shape[1] else -1, -1)
        t = (t_us - self._origin_us) / 1e6
        place, variance = self._estimator.predicted(t)
        usable = self._estimator.camera_at_frame(t, usable)
        ground = rays_to_ground(ray_cam, usable.R_enu_cam, usable.p_enu, usable.ground_z, self._estimator.theta)
        return reattach_gated(place, variance, vehicle, ground)

    def _seconds(self, t_us: IntArray) -> FloatArray:
        """Seconds since the first frame or report."""
        if self._origin_us is None:
            self._origin_us = int(np.min(t_us))
        return (t_us - self._origin_us) / 1e6

    def _add_frame(self, t: float, observation: Observation, camera: CameraState) -> None:
        """Store the frame and, when one is due, update the estimate."""
        usable = _complete_state(camera)
        if usable is None:
            return
        begun = self._history.append(t, observation, usable)
        self._t = t
        self._estimator.begin_tracks(t, begun)
        flat = self._near_horizon.looks_there(t, observation, usable)
        if flat and self._by_angles and t - self._last_update_s < _BY_PLACES_EVERY_S:
            if self._near_horizon.is_due(t, observation):
                self._name_by_angles(t, observation, usable)
            return
        if t - self._last_update_s < self._interval_s(t, len(begun) > 0) - _ROUNDING_S:
            return
        self._last_update_s = t
        result = self._estimator.update(t, self._estimator.camera_at_frame(t, usable))
        if self._estimator.gross.mirror_found:
            self._exchange_sides()
        elif self._estimator.fits_otherwise:
            self._begin_anew(by_place=not self._estimator.by_place)
        # a missed box does not change the probabilities of its track
        seen = np.flatnonzero(self._history.last_s[result.columns] >= t)
        ids = self._history.track_id[result.columns[seen]]
        # without tracks no contradiction can appear or be resolved
        conflict = result.conflict if len(result.columns) else self._beliefs.conflict
        self._beliefs = self._beliefs.updated(ids, result.p[seen], result.doubt[seen], conflict)
        # where places on the ground tell who is who, boxes in the distance are no reason to look at directions alone
        self._by_angles = flat and not self._estimator.fit.fits
        if self._by_angles:
            self._name_by_angles(t, observation, usable)

    def _name_by_angles(self, t: float, observation: Observation, camera: CameraState) -> None:
        """Take the names that directions alone give."""
        stated = self._stated.scores(observation.track_id, len(self._ids))
        p = self._near_horizon.names(t, observation, camera, self._log, stated)
        self._beliefs = self._beliefs.updated(observation.track_id, p, np.zeros(len(p), np.int64), ())

    def _as_seen(self, camera: CameraState) -> CameraState:
        """The camera, mirrored where its picture is."""
        if not self._mirrored:
            return camera
        reported = None if camera.R_reported is None else camera.R_reported * MIRROR
        return replace(camera, R_enu_cam=camera.R_enu_cam * MIRROR, R_reported=reported)

    def _exchange_sides(self) -> None:
        """Begin again with the same frames and reports, left and right of the picture exchanged."""
        self._mirrored = not self._mirrored
        self._history.R *= MIRROR
        self._history.R_reported *= MIRROR
        self._begin_anew()

    def _begin_anew(self, *, by_place: bool = False) -> None:
        """Give up what was learnt of the camera and of the tracks in the history.

        Args:
            by_place: Compare by place alone from now on.
        """
        self._estimator = self._estimator.restarted(self._log, by_place=by_place)
        self._estimator.begin_tracks(self._t, np.flatnonzero(self._history.track_id > 0))
        self._last_update_s = -np.inf

    def _watch_residuals(self, t: float, answer: Identities) -> None:
        """Make an update due when the distance of a named track to its vehicle's report jumps."""
        named = np.flatnonzero(np.isfinite(answer.residual_m))
        tracks, away_m = answer.track_id[named].tolist(), answer.residual_m[named].tolist()
        now: dict[int, float] = dict(zip(tracks, away_m, strict=True))
        q = self._params.schedule
        noise_m = q.residual_jump_stds * self._log.white_std_m if self.locked else 0.0
        jump_m = max(q.residual_jump_m, noise_m)
        if any(away > self._residual_m.get(track, away) + jump_m for track, away in now.items()):
            self._residual_jump_s, self._last_update_s = t, -np.inf
        self._residual_m = now

    def _interval_s(self, t: float, begun: bool) -> float:
        """Seconds between two updates: longer for many pairs, so that the frame rate is kept.

        Args:
            t: Time of the frame, seconds.
            begun: Whether a track begins in it.
        """
        q, history = self._params.schedule, self._history
        load = int(np.sum(history.track_id != 0)) * len(self._ids) / MANY_PAIRS
        interval_s = q.every_s * float(np.clip(load, 1.0, q.slowest_factor))
        if begun:
            return interval_s * q.begun_factor
        if np.any((history.track_id != 0) & (history.first_s > t - q.young_s)):
            return interval_s * q.young_factor
        if self._estimator.locked and t > self._residual_jump_s + q.full_rate_s:
            # the interval is longer already where there are many pairs
            return interval_s * max(q.idle_factor / max(load, 1.0), 1.0)
        return interval_s

    def _reset(self) -> None:
        """Reset all state except the origin of time."""
        n, q = len(self._ids), self._params
        self._t = self._last_update_s = self._residual_jump_s = -np.inf
        self._history = TrackHistory(q.window_s + _MARGIN_S, q.frame_step_s, q.gap_max_s)
        self._log = ReportLog(n, q.window_s + _MARGIN_S)
        self._estimator = Estimator(self._history, self._log, q, self._stated)
        self._beliefs = empty_beliefs(n)
        self._mirrored = False
        self._near_horizon, self._by_angles = NearHorizon(n, q), False
        self._common_boxes = CommonBoxes(n)
        self._residual_m = {}
        self._masses, self._candidates = MassCache(), CandidateCache()


def _complete_state(camera: CameraState) -> CameraState | None:
    """The camera state, looking straight down where the attitude is unknown; None without a position."""
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
        height_std_m=camera.height_std_m,
        other_heights_m=camera.other_heights_m,
        position_std_m=camera.position_std_m,
    )
