"""Frames and reports that the identifier took in, kept for a second look at the recording as a whole."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from assoc.evidence.motion import ReportLog
from assoc.geometry.ground import rays_to_ground
from assoc.history import TrackHistory
from assoc.params import IdentifierParams
from assoc.records import CameraState, Observation, VehicleReports
from assoc.whole_flight.exchanges import names_since_exchanges
from assoc.whole_flight.linking import linked

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

_MARGIN_S = 20.0
"""Time before the first frame and after the last from which reports count, seconds."""
_TOGETHER_FRAMES, _TOGETHER_SHARE = 2.0, 0.2
"""Segments are two objects that are seen together in more frames than this, and that share of the shorter one's: where
one track takes over from another, both have the vehicle for a moment.
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class _FrameTaken:
    t_us: int
    observation: Observation
    camera: CameraState
    theta: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Segments:
    """Pieces of tracks that are one object each, with all reports of their time. S segments, F frames."""

    history: TrackHistory
    """Rays of the segments, a column for each."""
    log: ReportLog
    camera: CameraState
    """Camera of the last frame."""
    origin_us: int
    """Time of the first frame on the video's clock, Unix µs."""
    of: dict[tuple[int, int], int]
    """Segment of a box, by the frame's time, Unix µs, and track id."""
    length_m: dict[tuple[int, int], float]
    """Length of each of these boxes on the ground, metres; those that are not known are not in it."""
    seen: BoolArray
    """(F, S) frames in which each was seen."""
    apart: BoolArray
    """(S, S) pairs that cannot be one vehicle: they were seen together."""
    theta: FloatArray
    """(9,) median pose correction of the identifier in the later half."""

    @property
    def seen_s(self) -> FloatArray:
        """(S,) for how long each was seen, seconds."""
        frames = np.diff(self.history.t[: self.history.n])
        return np.asarray(np.sum(self.seen, axis=0) * np.median(frames))

    def cut(self, at: Sequence[tuple[int, float]]) -> Segments:
        """The same with some segments in two.

        Args:
            at: Segments, each once, and from when on each is another one, seconds from the first frame. The parts
                behind are numbered on from S.
        """
        t, history = self.history.t, copy(self.history)
        ray, front = self.history.ray.copy(), self.history.front.copy()
        new = np.full((len(t), len(at), 3), np.nan)
        rays, fronts = [ray, new], [front, new.copy()]
        behind = dict[int, tuple[int, float]]()
        for k, (segment, at_s) in enumerate(at):
            since = t >= at_s
            for own, other in (rays, fronts):
                other[since, k] = own[since, segment]
                own[since, segment] = np.nan
            behind[segment] = self.seen.shape[1] + k, at_s
        history.ray, history.front = np.concatenate(rays, axis=1), np.concatenate(fronts, axis=1)
        of = dict(self.of)
        for (t_us, track), segment in self.of.items():
            if segment in behind and 1e-6 * (t_us - self.origin_us) >= behind[segment][1]:
                of[t_us, track] = behind[segment][0]
        seen = np.isfinite(history.ray[: history.n, :, 0])
        return replace(self, history=history, of=of, seen=seen, apart=_apart(seen))


class FlightEvidence:
    """Frames and reports in the order of the recording.

    Args:
        params: Of the identifier.
    """

    def __init__(self, params: IdentifierParams) -> None:
        self.params = params
        self.system_ids: tuple[int, ...] = ()
        """System ids of those whose reports they are, in the order of their indices."""
        self._frames: list[_FrameTaken] = []
        self._reports: list[VehicleReports] = []

    def add_frame(self, t_us: int, observation: Observation, camera: CameraState, theta: FloatArray) -> None:
        """Take in a frame.

        Args:
            t_us: Its time on the video's clock, Unix µs.
            observation: Its tracks, at its time on telemetry's clock.
            camera: Where the camera was.
            theta: (9,) pose correction that the identifier has for it.
        """
        known = np.isfinite(camera.p_enu).all() and np.isfinite(camera.R_enu_cam).all() and camera.attitude_known
        if self._frames and observation.t_us <= self._frames[-1].observation.t_us:
            self.begin_anew(self.system_ids)
        if known and np.isfinite(camera.ground_z):
            self._frames.append(_FrameTaken(t_us=t_us, observation=observation, camera=camera, theta=theta))

    def add_reports(self, reports: VehicleReports) -> None:
        """Take in reports that arrived before the next frame."""
        if len(reports.t_us):
            self._reports.append(reports)

    def begin_anew(self, system_ids: Sequence[int]) -> None:
        """Forget everything: what comes, of these vehicles, is not comparable with what was."""
        self.system_ids = tuple(system_ids)
        self._frames.clear()
        self._reports.clear()

    def forget(self, before_us: int) -> None:
        """Drop frames and reports before a time on the video's clock, Unix µs."""
        passed = bisect_left(self._frames, before_us, key=lambda frame: frame.t_us)
        if passed:
            early_us = self._frames[passed - 1].observation.t_us
            del self._frames[:passed]
            self._reports = [each for each in self._reports if np.max(each.t_us) >= early_us]

    def segments(self, start_us: int, stop_us: int, name: Callable[[int, int], int]) -> Segments | None:
        """The tracks between two times, each cut where its name changes; None where nothing was seen.

        Args:
            start_us: First time on the video's clock, Unix µs.
            stop_us: Last one.
            name: Index of the vehicle of a box by the frame's time and track id, as it is known so far, −1 nobody.
        """
        first = bisect_left(self._frames, start_us, key=lambda frame: frame.t_us)
        frames = self._frames[first : bisect_right(self._frames, stop_us, key=lambda frame: frame.t_us)]
        if len(frames) < 2:
            return None
        q, origin_us = self.params, frames[0].observation.t_us
        span_s, margin_us = 1e-6 * (frames[-1].observation.t_us - origin_us) + _MARGIN_S, round(1e6 * _MARGIN_S)
        history, cuts, of = TrackHistory(span_s, q.frame_step_s, q.gap_max_s), _Cuts(), dict[tuple[int, int], int]()
        length_m = dict[tuple[int, int], float]()
        for frame, names in zip(frames, _names(frames, name, q.close_m), strict=True):
            seen = frame.observation
            ids = np.array(list(map(cuts.piece, seen.track_id.tolist(), names)), np.int64)
            history.append(1e-6 * (seen.t_us - origin_us), replace(seen, track_id=ids), frame.camera)
            for track, piece in zip(seen.track_id.tolist(), ids.tolist(), strict=True):
                of[frame.t_us, track] = history.column_of(piece)
            length_m |= _lengths(frame)
        log = ReportLog(len(self.system_ids), span_s)
        for each in self._reports:
            # a log forgets what is long before its newest report
            if np.min(each.t_us) <= frames[-1].observation.t_us + margin_us:
                log.add(np.asarray((each.t_us - origin_us) / 1e6), each)
        theta = np.median([frame.theta for frame in frames[len(frames) // 2 :]], axis=0)
        known = np.full(int(np.count_nonzero(history.track_id)), -1)
        for piece, vehicle in cuts.names.items():
            known[history.column_of(piece)] = vehicle
        column = _join(history, linked(history, theta, known))
        of = {box: int(column[piece]) for box, piece in of.items()}
        seen_in = np.isfinite(history.ray[: history.n, :, 0])
        return Segments(
            history=history,
            log=log,
            camera=frames[-1].camera,
            origin_us=frames[0].t_us,
            of=of,
            length_m=length_m,
            seen=seen_in,
            apart=_apart(seen_in),
            theta=theta,
        )


def _names(frames: Sequence[_FrameTaken], name: Callable[[int, int], int], close_m: float) -> list[list[int]]:
    """The vehicles of the boxes of frames as they are known so far, −1 nobody, from each track's exchange on."""
    tracks = [frame.observation.track_id.tolist() for frame in frames]
    return names_since_exchanges(
        [1e-6 * (frame.observation.t_us - frames[0].observation.t_us) for frame in frames],
        tracks,
        [_places(frame) for frame in frames],
        [[name(frame.t_us, track) for track in ids] for frame, ids in zip(frames, tracks, strict=True)],
        close_m,
    )


def _places(frame: _FrameTaken) -> FloatArray:
    """(m, 2) where the boxes of a frame are on the ground, metres."""
    camera = frame.camera
    return rays_to_ground(frame.observation.ray_cam, camera.R_enu_cam, camera.p_enu, camera.ground_z, frame.theta)


def _lengths(frame: _FrameTaken) -> dict[tuple[int, int], float]:
    """Lengths of the boxes of a frame that were seen, metres, by its time, Unix µs, and track id."""
    seen = frame.observation
    if seen.length_m is None:
        return {}
    known = np.isfinite(seen.length_m) & (seen.gap_s <= 0.0)
    rows = zip(seen.track_id[known].tolist(), seen.length_m[known].tolist(), strict=True)
    return {(frame.t_us, track): length_m for track, length_m in rows}


def _apart(seen: BoolArray) -> BoolArray:
    """(S, S) pairs that were seen together, in (F, S) frames, for too long to be one object."""
    together = seen.astype(np.float64).T @ seen.astype(np.float64)
    frames = np.diagonal(together)
    apart = together > _TOGETHER_FRAMES + _TOGETHER_SHARE * np.minimum(frames[:, None], frames)
    np.fill_diagonal(apart, False)
    return np.asarray(apart)


def _join(history: TrackHistory, group: IntArray) -> IntArray:
    """Make one column of each group of a history's columns (T,); returns (T,) the column that each is in now."""
    firsts, column = np.unique(group, return_inverse=True)
    for name in ("ray", "front"):
        before = getattr(history, name)
        joined = before[:, firsts].copy()
        for k in np.flatnonzero(firsts[column] != np.arange(len(group))).tolist():
            seen = np.isfinite(before[:, k, 0])
            joined[seen, column[k]] = before[seen, k]
        setattr(history, name, joined)
    return np.asarray(column, np.int64)


class _Cuts:
    """Numbers the pieces of tracks: a track goes on as another piece where it gets another name."""

    def __init__(self) -> None:
        self.names: dict[int, int] = {}
        """Name of each piece that has one."""
        self._piece: dict[int, int] = {}
        self._name: dict[int, int] = {}
        self._pieces = 0

    def piece(self, track: int, name: int) -> int:
        """Number of the piece that a track is in, from 1 on; one without a name, −1, goes on."""
        changed = name >= 0 and self._name.get(track, name) != name
        if name >= 0:
            self._name[track] = name
        if changed or track not in self._piece:
            self._pieces += 1
            self._piece[track] = self._pieces
        if name >= 0:
            self.names[self._piece[track]] = name
        return self._piece[track]
