"""Rays and camera poses of the last seconds, kept unprojected so that any pose correction can be applied to them.

Rows are frames (thinned), columns are tracks. Times are float seconds since the identifier's first frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from statistics import median

import numpy as np
from numpy.typing import NDArray

from assoc.records import CameraState, Observation

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_SPARE_COLUMNS = 8
"""Columns added when all are in use."""
_VELOCITY_S, _MIN_SPREAD_S2 = 0.8, 0.01
"""Time over which a velocity is found, seconds, and the least Σ (t − t̄)² from which it can be."""
_HOVERS_MPS = 1.0
"""Speed that a camera seems to have which hovers, by what its positions err, m/s."""
_FLIGHT_S = 2.0
"""Time over which the speed of a flight is measured, seconds."""
INTERVALS = 5
"""Number of frame intervals whose median is the usual one: single frames are dropped."""
_MISSED_FRAMES, _LONGEST_GAP_S = 1.5, 2.0
"""Longest gap in a track, in usual frame intervals, and its bound in seconds: over a missed look at few frames a second
the tracker may have gone on with a neighbour."""


def longest_gap_s(gap_max_s: float, t: Sequence[float] | FloatArray) -> float:
    """Return the time out of sight after which a track may have gone on with another vehicle, seconds.

    Args:
        gap_max_s: What interpolation bridges, seconds.
        t: Times of the last ``INTERVALS`` + 1 frames, or fewer, seconds.
    """
    if len(t) < 2:
        return np.inf
    return max(gap_max_s, min(_MISSED_FRAMES * float(median(np.diff(t).tolist())), _LONGEST_GAP_S))


class TrackHistory:
    """Ring of frames: camera states, and the rays of every track.

    Buffers have twice the wanted length; when full, the newest half moves to the front, so views stay contiguous.
    """

    def __init__(self, window_s: float, step_s: float, gap_max_s: float) -> None:
        self._keep = max(int(window_s / step_s) + 4, 8)
        self._step_s = step_s
        self._gap_max_s = gap_max_s
        rows = 2 * self._keep
        self.n = 0
        """Rows in use."""
        self.t = np.zeros(rows)
        """(R,) time of each row, seconds."""
        self.R = np.zeros((rows, 3, 3))
        """(R, 3, 3) rotation from the camera frame to ENU."""
        self.R_reported = np.zeros((rows, 3, 3))
        """(R, 3, 3) the same as telemetry has it, where ``R`` was found by the image."""
        self.p = np.zeros((rows, 3))
        """(R, 3) camera position, ENU, metres."""
        self.v = np.zeros((rows, 3))
        """(R, 3) camera velocity, ENU, m/s, by how its positions went on: some report none, or zeros."""
        self._speed_mps: float | None = None
        """Speed of the flight, None until it is asked for after a frame."""
        self.z = np.zeros(rows)
        """(R,) height of the ground, metres."""
        self.px_rad = np.zeros(rows)
        """(R,) angle of one pixel, radians."""
        self.of_image_time = False
        """True if ``R`` is that of each frame's own moment, also where telemetry's clock is off."""
        self.ray = np.full((rows, 0, 3), np.nan)
        """(R, T, 3) ray through each box's centre, camera frame, NaN unseen."""
        self.front = np.full((rows, 0, 3), np.nan)
        """(R, T, 3) ray through a point ahead of the centre on each box's axis, camera frame, NaN unseen or unknown."""
        self.track_id = np.zeros(0, np.int64)
        """(T,) track id of each column, 0 free, −id where the track ended at a gap and may go on in another column."""
        self.before = np.zeros(0, np.int64)
        """(T,) column that held the same track id before a gap, −1 none."""
        self.first_s = np.zeros(0)
        self.last_s = np.zeros(0)
        """(T,) when each track was seen first and last, seconds."""
        self._column: dict[int, int] = {}

    def append(self, t: float, observation: Observation, camera: CameraState) -> IntArray:
        """Store one frame.

        Args:
            t: Its time, seconds; larger than any before.
            observation: The tracks.
            camera: The camera's state.

        Returns:
            Columns of the tracks that are new in this frame.
        """
        self._make_row()
        row = self.n - 1
        self.t[row], self.z[row], self.px_rad[row] = t, camera.ground_z, camera.px_rad
        self.R[row], self.p[row] = camera.R_enu_cam, camera.p_enu
        self.R_reported[row] = camera.R_enu_cam if camera.R_reported is None else camera.R_reported
        self._follow_flight()
        self.of_image_time = camera.of_image_time
        seen = observation.gap_s <= 0.0
        broken = self._end_at_gaps(observation.track_id[seen], t)
        columns, fresh = self._columns_of(observation.track_id, t)
        self.before[fresh] = [broken.get(key, -1) for key in self.track_id[fresh].tolist()]
        self.ray[row, columns[seen]] = observation.ray_cam[seen]
        self.front[row, columns[seen]] = observation.front_cam[seen]
        self.last_s[columns[seen]] = t
        return fresh

    def _follow_flight(self) -> None:
        """Find the velocity of the last moments, v = Σ (t − t̄) p / Σ (t − t̄)², which is that of their middle.

        What a camera that hovers seems to fly is noise: v is reduced by max(0, 1 − (1 m/s / |v|)²).
        """
        since = self.first_row_since(self.t[self.n - 1] - _VELOCITY_S)
        t = self.t[since : self.n] - np.mean(self.t[since : self.n])
        spread = float(t @ t)
        v = t @ self.p[since : self.n] / spread if spread > _MIN_SPREAD_S2 else np.zeros(3)
        self.v[(since + self.n) // 2 : self.n] = v * max(0.0, 1.0 - _HOVERS_MPS**2 / max(float(v @ v), 1e-9))
        self._speed_mps = None

    @property
    def speed_mps(self) -> float:
        """Largest speed of the camera, m/s, measured over seconds, for which errors of its positions hardly count."""
        if self._speed_mps is None:
            self._speed_mps = self._most_flown()
        return self._speed_mps

    def _most_flown(self) -> float:
        rows = slice(0, self.n)
        before = np.searchsorted(self.t[rows], self.t[rows] - _FLIGHT_S)
        passed_s = self.t[rows] - self.t[before]
        far = np.linalg.norm(self.p[rows] - self.p[before], axis=1)
        # across a hole in the film or in telemetry nothing is known of its flight
        usual = (passed_s > 0.5 * _FLIGHT_S) & (passed_s < 1.5 * _FLIGHT_S)
        return float(np.max(far[usual] / passed_s[usual], initial=0.0))

    def column_of(self, track_id: int) -> int:
        """Column in which a track goes on, −1 none."""
        return self._column.get(track_id, -1)

    def end(self, track_id: int) -> None:
        """End a track's column, so that it goes on in another one without what was seen before."""
        column = self._column.pop(track_id, -1)
        if column >= 0:
            self.track_id[column] = -track_id

    def release(self, before_s: float) -> IntArray:
        """Free the columns of tracks last seen before ``before_s``, seconds, and return them."""
        old = np.flatnonzero((self.track_id != 0) & (self.last_s < before_s))
        for column in old:
            self._column.pop(int(self.track_id[column]), None)
        self.track_id[old] = 0
        self.ray[:, old] = np.nan
        self.front[:, old] = np.nan
        return old

    def first_row_since(self, t: float) -> int:
        """First row that is not older than t."""
        return int(np.searchsorted(self.t[: self.n], t))

    def last_rows(self, columns: IntArray) -> IntArray:
        """(m,) the row in which each track was seen last; the newest row for a track seen in none."""
        unseen = np.isnan(self.ray[: self.n, columns, 0])[::-1]
        return np.asarray(self.n - 1 - np.argmin(unseen, axis=0))

    def _make_row(self) -> None:
        """Open this frame's row; a newest row less than ``step_s`` after the one before is overwritten (thinning)."""
        if self.n >= 2 and self.t[self.n - 1] - self.t[self.n - 2] < self._step_s:
            self.ray[self.n - 1] = np.nan
            self.front[self.n - 1] = np.nan
            return
        if self.n == len(self.t):
            self._compact()
        self.n += 1
        self.ray[self.n - 1] = np.nan
        self.front[self.n - 1] = np.nan

    def _compact(self) -> None:
        """Move the newest rows to the front of the buffers."""
        source = slice(self.n - self._keep, self.n)
        for name in ("t", "R", "R_reported", "p", "v", "z", "px_rad", "ray", "front"):
            array = getattr(self, name)
            array[: self._keep] = array[source].copy()
        self.n = self._keep

    def _end_at_gaps(self, track_id: IntArray, t: float) -> dict[int, int]:
        """End the columns of tracks that reappear after a gap: the tracker may have continued with another vehicle.

        Only gaps longer than interpolation bridges count.

        Returns:
            Ended column by track id.
        """
        broken: dict[int, int] = {}
        longest_s = longest_gap_s(self._gap_max_s, self.t[max(self.n - 2 - INTERVALS, 0) : self.n - 1])
        for key in track_id.tolist():
            column = self._column.get(key, -1)
            if column >= 0 and t - self.last_s[column] > longest_s:
                broken[key] = self._column.pop(key)
                self.track_id[column] = -key
        return broken

    def _columns_of(self, track_id: IntArray, t: float) -> tuple[IntArray, IntArray]:
        """Column of each track; new tracks take free columns."""
        columns = np.zeros(len(track_id), np.int64)
        fresh: list[int] = []
        for k, key in enumerate(track_id.tolist()):
            if key not in self._column:
                self._column[key] = self._free_column()
                column = self._column[key]
                self.track_id[column], self.first_s[column], self.last_s[column] = key, t, t
                fresh.append(column)
            columns[k] = self._column[key]
        return columns, np.array(fresh, np.int64)

    def _free_column(self) -> int:
        """A free column; widens the buffers when there is none."""
        free = np.flatnonzero(self.track_id == 0)
        if len(free):
            return int(free[0])
        rows, width = len(self.t), len(self.track_id)
        extra = np.full((rows, _SPARE_COLUMNS, 3), np.nan)
        self.ray = np.concatenate([self.ray, extra], axis=1)
        self.front = np.concatenate([self.front, extra], axis=1)
        self.track_id = np.concatenate([self.track_id, np.zeros(_SPARE_COLUMNS, np.int64)])
        self.before = np.concatenate([self.before, np.full(_SPARE_COLUMNS, -1)])
        self.first_s = np.concatenate([self.first_s, np.zeros(_SPARE_COLUMNS)])
        self.last_s = np.concatenate([self.last_s, np.zeros(_SPARE_COLUMNS)])
        return width
