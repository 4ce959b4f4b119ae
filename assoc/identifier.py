"""The stateful identifier: frames and reports in, names with probabilities out.

Per update: rays → ground under several pose corrections, residuals against reports, evidence per pair, joint
hypotheses of pose and assignment, matching marginals. See ``docs/identity.md``.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from assoc.answers import compose, no_beliefs
from assoc.estimate import Estimator
from assoc.history import TrackHistory
from assoc.motion import ReportLog
from assoc.params import IdentifierParams
from assoc.records import CameraState, Identities, Sighting, VehicleReports

__all__ = ["CameraState", "Identifier", "IdentifierParams", "Identities", "Sighting", "VehicleReports"]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_BACKWARD_S = 1.0


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

    @property
    def time_offset_s(self) -> float:
        """Estimated video time minus telemetry time, seconds."""
        return float(self._estimator.theta[7])

    @property
    def pose_correction(self) -> FloatArray:
        """(8,) θ = yaw, yaw rate, pitch, roll (radians, /s), E, N, H (metres), δ (seconds)."""
        return self._estimator.theta.copy()

    def update(self, sighting: Sighting, camera: CameraState, reports: VehicleReports) -> Identities:
        """Take one frame.

        Args:
            sighting: Its tracks.
            camera: Where the camera was.
            reports: What the vehicles said since the last call.

        Returns:
            The names, in the order of the sighting.
        """
        if self._origin_us is None:
            self._origin_us = sighting.t_us
        t = (sighting.t_us - self._origin_us) / 1e6
        if t < self._t - _BACKWARD_S:
            self._reset()
        self._log.add((reports.t_us - self._origin_us) / 1e6, reports)
        if t > self._t:
            self._see(t, sighting, camera)
        beliefs = self._beliefs.of(sighting.track_id)
        return compose(self._ids, beliefs, sighting, camera, self._log, self._estimator, t, self._params.threshold)

    def _see(self, t: float, sighting: Sighting, camera: CameraState) -> None:
        """Store the frame and, when it is time, think."""
        usable = _usable(camera)
        if usable is None:
            return
        fresh = self._history.append(t, sighting, usable)
        self._t = t
        self._estimator.began(t, fresh)
        waited = t - self._thought_s
        if waited >= self._params.every_s or (len(fresh) and waited > 0.0):
            self._thought_s = t
            columns, p = self._estimator.update(t, usable)
            self._beliefs = self._beliefs.renewed(self._history.track_id[columns], p, self._estimator.conflict)

    def _reset(self) -> None:
        """Forget everything: time ran backwards."""
        self._t = self._thought_s = -np.inf
        self._history, self._log, self._estimator = _parts(len(self._ids), self._params)
        self._beliefs = no_beliefs(len(self._ids))


def _parts(n: int, params: IdentifierParams) -> tuple[TrackHistory, ReportLog, Estimator]:
    """Empty memory for n vehicles."""
    history = TrackHistory(params.window_s + 2.0, params.frame_step_s)
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
        R_enu_cam=down, p_enu=camera.p_enu, ground_z=camera.ground_z, px_rad=camera.px_rad, attitude_known=False,
        position_known=camera.position_known, stabilized=camera.stabilized,
    )  # fmt: skip
