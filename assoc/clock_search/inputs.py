"""Inputs of the search for a clock's offset: a film's tracks, the camera's path, the fleet's log; plain arrays.

Times are seconds: of the film since its first frame, of a log on its own clock since that same number.
"""

from __future__ import annotations

from collections.abc import Iterable
from copy import copy
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from assoc.errors import ShapeError
from assoc.history import TrackHistory
from assoc.records import CameraState, Observation, VehicleReports

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_STEP_S = 0.19
"""Least time between two frames, seconds; others are thinned: a vehicle moves by little more than its own error."""
_REPORT_STEP_S = 0.4
"""Least time between two reports of one vehicle, seconds; others are thinned."""
_GAP_MAX_S = 0.8
"""Longest hole in a track that is bridged, seconds."""
_NOWHERE = CameraState(
    R_enu_cam=np.eye(3),
    p_enu=np.zeros(3),
    ground_z=0.0,
    px_rad=1e-3,
    attitude_known=False,
    position_known=False,
    stabilized=True,
)
"""State of a frame's camera until a path gives it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraPath:
    """Position and attitude of the camera over time. P samples."""

    t: FloatArray
    """(P,) seconds, increasing."""
    R_enu_cam: FloatArray
    """(P, 3, 3) rotation camera → ENU; where the heading is unknown, of a camera whose image's up is north."""
    p_enu: FloatArray
    """(P, 3) metres."""
    ground_z: float
    """Height of the ground plane, metres."""
    px_rad: float
    """Radians per pixel near the image centre."""
    heading_known: bool
    """False: the heading of the image is not known at all, but did not change against ``R_enu_cam``."""
    half_view: tuple[float, float]
    """Tangents of half the angle of view, across and along the image; NaN unknown."""
    position_std_m: float = 1.3
    """1σ per axis of the position, metres."""
    height_std_m: float = 1.0
    """1σ of the height above the ground, metres."""
    tilt_std: float = float(np.deg2rad(1.5))
    """1σ of pitch and roll, radians."""

    def __post_init__(self) -> None:
        count = len(self.t)
        for name, shape in (("R_enu_cam", (count, 3, 3)), ("p_enu", (count, 3))):
            if (found := getattr(self, name).shape) != shape:
                raise ShapeError(f"{name}: expected shape {shape}, got {found}")
        if not count or np.any(np.diff(self.t) <= 0.0):
            raise ShapeError("t: expected increasing times, at least one")

    def at(self, t: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Rotations (k, 3, 3) and positions (k, 3) at times (k,); the first and last hold beyond the ends.

        Rotations are blended linearly: between neighbouring samples they differ by a few degrees at most.
        """
        if len(self.t) == 1:
            return np.repeat(self.R_enu_cam, len(t), axis=0), np.repeat(self.p_enu, len(t), axis=0)
        k = np.clip(np.searchsorted(self.t, t, side="right") - 1, 0, len(self.t) - 2)
        w = np.clip((t - self.t[k]) / (self.t[k + 1] - self.t[k]), 0.0, 1.0)
        R = self.R_enu_cam[k] * (1.0 - w)[:, None, None] + self.R_enu_cam[k + 1] * w[:, None, None]
        return R, self.p_enu[k] * (1.0 - w)[:, None] + self.p_enu[k + 1] * w[:, None]


@dataclass(frozen=True, slots=True, kw_only=True)
class FleetLog:
    """Position reports of n vehicles, each with gaps of its own. S reports."""

    n: int
    t: FloatArray
    """(S,) seconds on the fleet's clock."""
    vehicle: IntArray
    """(S,) index, 0 to n − 1."""
    p_enu: FloatArray
    """(S, 2) east and north, metres."""

    def __post_init__(self) -> None:
        count = len(self.t)
        for name, shape in (("vehicle", (count,)), ("p_enu", (count, 2))):
            if (found := getattr(self, name).shape) != shape:
                raise ShapeError(f"{name}: expected shape {shape}, got {found}")
        if count and not 0 <= np.min(self.vehicle) <= np.max(self.vehicle) < self.n:
            raise ShapeError(f"vehicle: expected 0 to {self.n - 1}")

    def between(self, start: float, stop: float) -> VehicleReports:
        """Reports with start ≤ t < stop, seconds, in order of time, thinned; times are µs of those seconds."""
        rows = np.flatnonzero((self.t >= start) & (self.t < stop))
        # the first of each vehicle in each step
        step = np.floor(self.t[rows] / _REPORT_STEP_S).astype(np.int64)
        rows = rows[np.lexsort((self.t[rows], step, self.vehicle[rows]))]
        step = np.floor(self.t[rows] / _REPORT_STEP_S).astype(np.int64)
        fresh = (np.diff(step, prepend=-1) != 0) | (np.diff(self.vehicle[rows], prepend=-1) != 0)
        rows = rows[fresh]
        rows = rows[np.argsort(self.t[rows], kind="stable")]
        unknown = np.full(len(rows), np.nan)
        flat = np.concatenate([self.p_enu[rows], np.zeros((len(rows), 1))], axis=1)
        return VehicleReports(
            t_us=np.rint(self.t[rows] * 1e6).astype(np.int64),
            vehicle=self.vehicle[rows],
            p_enu=flat,
            v_enu=np.full((len(rows), 3), np.nan),
            heading=unknown,
            std_m=unknown,
        )


def film_tracks(frames: Iterable[tuple[float, Observation]], length_s: float) -> TrackHistory:
    """A film's tracks, thinned, each broken where it was out of sight.

    Args:
        frames: Time of each, seconds, increasing, and its tracks.
        length_s: From the first to the last.
    """
    tracks = TrackHistory(length_s + 1.0, _STEP_S, _GAP_MAX_S)
    for t, observation in frames:
        tracks.append(t, observation, _NOWHERE)
    return tracks


def under_path(tracks: TrackHistory, path: CameraPath, ahead_s: float) -> TrackHistory:
    """The film as taken by a camera on a path whose clock is ahead of the film's by this many seconds."""
    seen = copy(tracks)
    seen.R, seen.p = path.at(tracks.t + ahead_s)
    seen.z = np.full(len(tracks.t), path.ground_z)
    seen.px_rad = np.full(len(tracks.t), path.px_rad)
    return seen
