"""Vehicles hidden at turns: how often their track changes, with and without Algorithm 1's re-association.

The same detections go through ByteTrack and through our tracker, each with and without something that decides which
lost track a box continues.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Collection
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from assoc.errors import DegenerateError
from assoc.identification.identifier import Identifier
from assoc.methods.reattach import reattach
from assoc.records import CameraState
from bench.paper.films import FPS, film, paper_road
from bench.paper.methods import LENS, START_US, camera_state, vehicle_reports
from bench.paper.projection import associate_by_projection
from gcs.fold.evidence import observation_of
from sim.telemetry.detections import DetectorModel
from sim.world.scenario import Scenario
from sim.world.world import World
from vision.camera.camera import CameraPose, image_warp
from vision.detect.detections import Detections
from vision.track.matching import assign
from vision.track.tracker import Tracker
from vision.track.tracks import Stitch, Tracks

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

HIGH, LOW, NEW = 0.5, 0.1, 0.6
FIRST, SECOND, UNCONFIRMED = 0.8, 0.5, 0.7
BUFFER = 30
_PLACE, _SPEED = 1.0 / 20.0, 1.0 / 160.0
DETECTED = ("cx", "cy", "w", "h", "angle", "score", "heading")
"""Columns that detections and tracks have in common, in the order of the detector's model."""
_F = np.eye(8) + np.eye(8, k=4)


@dataclass(slots=True, eq=False)
class _KalmanTrack:
    """One vehicle: x = centre u, v, aspect, height and their change per frame."""

    track_id: int
    x: FloatArray
    P: FloatArray
    confirmed: bool
    lost: int = 0
    """Frames since it was seen."""
    detection: int = -1


class ByteTrack:
    """Follows boxes from frame to frame by overlap, as published: the tracker that the paper starts from.

    Reference: Y. Zhang et al., "ByteTrack: Multi-Object Tracking by Associating Every Detection Box", ECCV 2022,
    arXiv:2110.06864. Axis-aligned boxes of the oriented ones, a Kalman filter on centre, aspect and height, overlap
    times score in the first round, overlap in the second, tracks kept for thirty frames. Time is counted in frames.
    """

    def __init__(self) -> None:
        self._tracks: list[_KalmanTrack] = []
        self._next_id = 1
        self._frame = 0

    def update(self, detections: Detections, stitch: Stitch | None = None) -> Tracks:
        """Take in one frame.

        Args:
            detections: Its boxes.
            stitch: Asked, as Algorithm 1 does, which unmatched tracks the boxes left over continue.

        Returns:
            The tracks that were seen in it.
        """
        self._frame += 1
        boxes = _aligned(detections)
        for track in self._tracks:
            _predict(track)
        free = self._match(boxes, detections.score)
        if stitch is not None:
            self._continue(detections, boxes, free, stitch)
        self._begin(boxes, detections.score, free)
        self._tracks = [track for track in self._tracks if track.lost <= (BUFFER if track.confirmed else 0)]
        return self._seen(detections)

    def _match(self, boxes: FloatArray, score: FloatArray) -> NDArray[np.bool_]:
        """Three rounds; True for boxes that are left and sure enough to begin a track."""
        free = score >= LOW
        high = score >= HIGH
        sure = [track for track in self._tracks if track.confirmed]
        self._round(sure, boxes, free & high, FIRST, free, score)
        seen_before = [track for track in sure if track.detection < 0 and track.lost == 1]
        self._round(seen_before, boxes, free & ~high, SECOND, free, None)
        self._round([t for t in self._tracks if not t.confirmed], boxes, free & high, UNCONFIRMED, free, score)
        return free & high

    def _round(
        self,
        tracks: list[_KalmanTrack],
        boxes: FloatArray,
        chosen: NDArray[np.bool_],
        limit: float,
        free: NDArray[np.bool_],
        score: FloatArray | None,
    ) -> None:
        columns = np.flatnonzero(chosen)
        if not tracks or not len(columns):
            return
        # cost = 1 − IoU · score
        alike = _iou(np.stack([track.x[:4] for track in tracks]), boxes[columns])
        cost = 1.0 - (alike if score is None else alike * score[columns])
        i, j = np.nonzero(cost <= limit)
        rows, taken = assign(i, j, cost[i, j], limit)
        for row, column in zip(rows.tolist(), columns[taken].tolist(), strict=True):
            _correct(tracks[row], boxes[column], column)
            free[column] = False

    def _continue(self, detections: Detections, boxes: FloatArray, free: NDArray[np.bool_], stitch: Stitch) -> None:
        unmatched = [track for track in self._tracks if track.detection < 0 and track.confirmed]
        columns = np.flatnonzero(free)
        if not unmatched or not len(columns):
            return
        names = np.array([track.track_id for track in unmatched], np.int64)
        for row, column in stitch(names, detections.centre[columns]).tolist():
            track, k = unmatched[row], int(columns[column])
            track.x, track.P = _born(boxes[k])
            track.lost, track.detection = 0, k
            free[k] = False

    def _begin(self, boxes: FloatArray, score: FloatArray, free: NDArray[np.bool_]) -> None:
        for k in np.flatnonzero(free & (score >= NEW)).tolist():
            x, P = _born(boxes[k])
            first = self._frame == 1
            self._tracks.append(_KalmanTrack(track_id=self._next_id, x=x, P=P, confirmed=first, detection=k))
            self._next_id += 1

    def _seen(self, detections: Detections) -> Tracks:
        seen = sorted((t for t in self._tracks if t.detection >= 0 and t.confirmed), key=lambda t: t.track_id)
        rows = np.array([track.detection for track in seen], np.intp)
        return Tracks(
            track_id=np.array([track.track_id for track in seen], np.int64),
            detection=rows,
            hits=np.ones(len(seen), np.int64),
            expected=np.full((len(seen), 2), np.nan),
            **{name: getattr(detections, name)[rows] for name in DETECTED},
            **{name: np.zeros(len(seen)) for name in ("age_s", "gap_s", "missed_s", "vx", "vy")},
        )


def _aligned(detections: Detections) -> FloatArray:
    """(m, 4) centre u, v, aspect w / h and height of the upright box around each oriented one."""
    corners = detections.corners()
    low, high = corners.min(axis=1), corners.max(axis=1)
    size = np.maximum(high - low, 1.0)
    return np.column_stack([0.5 * (low + high), size[:, 0] / size[:, 1], size[:, 1]])


def _born(z: FloatArray) -> tuple[FloatArray, FloatArray]:
    h = float(z[3])
    place, speed = 2 * _PLACE * h, 10 * _SPEED * h
    std = [place, place, 1e-2, place, speed, speed, 1e-5, speed]
    return np.concatenate([z, np.zeros(4)]), np.diag(np.square(std))


def _predict(track: _KalmanTrack) -> None:
    h = float(track.x[3])
    place, speed = _PLACE * h, _SPEED * h
    std = [place, place, 1e-2, place, speed, speed, 1e-5, speed]
    if track.lost:
        track.x[7] = 0.0
    # x ← F x,  P ← F P Fᵀ + Q
    track.x, track.P = _F @ track.x, _F @ track.P @ _F.T + np.diag(np.square(std))
    track.lost, track.detection = track.lost + 1, -1


def _correct(track: _KalmanTrack, z: FloatArray, detection: int) -> None:
    h = float(track.x[3])
    R = np.diag(np.square([_PLACE * h, _PLACE * h, 1e-1, _PLACE * h]))
    # K = P Hᵀ (H P Hᵀ + R)⁻¹
    K = np.linalg.solve(track.P[:4, :4] + R, track.P[:4]).T
    track.x, track.P = track.x + K @ (z - track.x[:4]), track.P - K @ track.P[:4]
    track.lost, track.detection, track.confirmed = 0, detection, True


def _iou(a: FloatArray, b: FloatArray) -> FloatArray:
    """(p, q) overlap of upright boxes given as centre, aspect, height."""
    half_a, half_b = (0.5 * np.column_stack([x[:, 2] * x[:, 3], x[:, 3]]) for x in (a, b))
    low = np.maximum((a[:, :2] - half_a)[:, None], (b[:, :2] - half_b)[None])
    high = np.minimum((a[:, :2] + half_a)[:, None], (b[:, :2] + half_b)[None])
    common = np.prod(np.maximum(high - low, 0.0), axis=2)
    area_a, area_b = 4.0 * np.prod(half_a, axis=1), 4.0 * np.prod(half_b, axis=1)
    return np.asarray(common / (area_a[:, None] + area_b[None] - common))


SIGMA_M, SIGMA_DEG = 0.5, 2.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Walk:
    """Input of trackers: frames of detections, the truth, the vehicles' and the UAV's telemetry."""

    seed: int
    detections: tuple[Detections, ...]
    truth: tuple[IntArray, ...]
    """Per frame (m,) index of the vehicle, −1 none."""
    p_enu: FloatArray
    """(F, n, 3) reported."""
    heading: FloatArray
    """(F, n) reported."""
    cameras: tuple[CameraState, ...]


def walk(scenario: Scenario, hidden: BoolArray | None = None) -> Walk:
    """Fly it once.

    Args:
        scenario: The flight.
        hidden: (F, n) True while a vehicle is not to be detected.
    """
    seen, model = film(scenario), DetectorModel(World(scenario))
    index = {system_id: i for i, system_id in enumerate(scenario.ugv_ids)}
    detections, truth = [], []
    for k in range(scenario.frame_count):
        rows = model.detect(k / scenario.fps)
        who = np.array([index.get(int(i), -1) for i in rows.system_id], np.int64)
        left = np.ones(len(who), np.bool_) if hidden is None else (who < 0) | ~hidden[k, who]
        detections.append(_detections(rows.values[left]))
        truth.append(who[left])
    noise = np.random.default_rng([scenario.seed, 14]).normal(0.0, 1.0, (*seen.heading.shape, 4))
    return Walk(
        seed=scenario.seed,
        detections=tuple(detections),
        truth=tuple(truth),
        p_enu=seen.p_enu + SIGMA_M * noise[..., :3],
        heading=seen.heading + np.radians(SIGMA_DEG) * noise[..., 3],
        cameras=tuple(camera_state(p, float(yaw)) for p, yaw in zip(seen.uav_enu, seen.uav_yaw, strict=True)),
    )


def frame_us(frame: int) -> int:
    """Unix µs of a frame."""
    return START_US + round(frame * 1e6 / FPS)


def camera_motion(walk: Walk, frame: int) -> FloatArray | None:
    """(3, 3) homography from the frame before to this one, as telemetry has it; None for the first."""
    if frame == 0:
        return None
    before, now = (CameraPose(R_enu_cam=c.R_enu_cam, p_enu=c.p_enu) for c in walk.cameras[frame - 1 : frame + 1])
    return image_warp(LENS, before, now, 0.0)


def _detections(rows: FloatArray) -> Detections:
    return Detections(**dict(zip(DETECTED, np.ascontiguousarray(rows.T), strict=True)))


class Plain:
    """Nothing continues a lost track but the tracker's own prediction."""

    def __init__(self, walk: Walk) -> None:
        self._walk = walk

    def stitch(self, frame: int) -> Stitch | None:
        """Answers to what the tracker may ask in a frame."""
        return None

    def known(self) -> Collection[int]:
        """Tracks with a name: once out of sight they are continued by ``stitch`` only."""
        return ()

    def observe(self, frame: int, tracks: Tracks) -> None:
        """Use the tracks of a frame as evidence."""


class Ours(Plain):
    """The identifier names tracks and decides which lost track a box continues."""

    def __init__(self, walk: Walk) -> None:
        super().__init__(walk)
        self._who = Identifier(range(1, walk.p_enu.shape[1] + 1))
        self._named: list[int] = []

    def stitch(self, frame: int) -> Stitch | None:
        camera = self._walk.cameras[frame]

        def continued(track_id: NDArray[np.int64], centres: FloatArray) -> NDArray[np.intp]:
            return self._who.stitch(frame_us(frame), track_id, LENS.rays(centres), camera).astype(np.intp)

        return continued

    def known(self) -> Collection[int]:
        return self._named

    def observe(self, frame: int, tracks: Tracks) -> None:
        walk = self._walk
        observation = observation_of(frame_us(frame), walk.detections[frame], tracks, LENS)
        reports = vehicle_reports(frame_us(frame), walk.p_enu[frame], walk.heading[frame])
        answer = self._who.update(observation, walk.cameras[frame], reports)
        self._named = answer.track_id[answer.system_id > 0].tolist()


WINDOW, HISTORY, EVERY, LOST = 12, 10, 5, 5
EDGE_S, APART_S = 4.0, 5.0
HIDDEN_S, TIMES = (1.2, 2.2), 3


@dataclass(frozen=True, slots=True, kw_only=True)
class Kept:
    """One flight through one tracker."""

    keeper: str
    seed: int
    frames: int
    hidden: int
    """Times a vehicle was lost for half a second or more and came back."""
    switches: int
    """Times a vehicle's track was another than its last."""
    taken: int
    """Times a track went over to another vehicle."""


def occluded_walk(seed: int) -> Walk:
    """A road with sharp bends, flown once; each vehicle is hidden a few times where it turns most."""
    base = paper_road("curved", 0.0, 100 + seed)
    scenario = replace(base, name="occluded", ground=replace(base.ground, bend_deg=75.0, bend_length_m=70.0))
    seen = film(scenario)
    return walk(scenario, hidden_at_turns(seen.heading, seen.fps, np.random.default_rng([seed, 13])))


def hidden_at_turns(heading: FloatArray, fps: float, rng: np.random.Generator) -> NDArray[np.bool_]:
    """(F, n) True while a vehicle is behind something: around its sharpest turns, well apart."""
    frames, n = heading.shape
    turn = np.abs(np.gradient(heading, 1.0 / fps, axis=0))
    turn[: round(EDGE_S * fps)] = turn[-round(EDGE_S * fps) :] = 0.0
    hidden = np.zeros((frames, n), np.bool_)
    for i in range(n):
        for _ in range(TIMES):
            middle = int(np.argmax(turn[:, i]))
            if turn[middle, i] == 0.0:
                break
            half = round(0.5 * fps * rng.uniform(*HIDDEN_S))
            hidden[max(middle - half, 0) : middle + half, i] = True
            apart = round(APART_S * fps)
            turn[max(middle - apart, 0) : middle + apart, i] = 0.0
    return hidden


class Paper(Plain):
    """Algorithm 1: names and θ by projection over the last twelve frames, then the nearest projected vehicle."""

    def __init__(self, walk: Walk) -> None:
        super().__init__(walk)
        self._buffer: deque[tuple[FloatArray, dict[int, FloatArray]]] = deque(maxlen=WINDOW)
        self._theta: FloatArray | None = None
        self._name: dict[int, int] = {}

    def stitch(self, frame: int) -> Stitch | None:
        theta = self._theta
        if theta is None:
            return None
        predicted = self._relative(frame) @ theta

        def continued(track_id: NDArray[np.int64], centres: FloatArray) -> NDArray[np.intp]:
            lost = np.array([self._name.get(int(i), -1) for i in track_id], np.int64)
            return reattach(predicted, lost, centres).astype(np.intp)

        return continued

    def known(self) -> Collection[int]:
        return list(self._name)

    def observe(self, frame: int, tracks: Tracks) -> None:
        boxes = self._walk.detections[frame]
        seen = np.flatnonzero(tracks.detection >= 0)
        centre = boxes.centre[tracks.detection[seen]]
        self._buffer.append((self._relative(frame), dict(zip(tracks.track_id[seen].tolist(), centre, strict=True))))
        if len(self._buffer) == WINDOW and frame % EVERY == 0:
            self._associate()

    def _relative(self, frame: int) -> FloatArray:
        return np.asarray(self._walk.p_enu[frame] - self._walk.cameras[frame].p_enu)

    def _associate(self) -> None:
        whole = set.intersection(*(set(seen) for _, seen in self._buffer))
        # fewer than three tracks leave θ free
        if len(whole) < 3:
            return
        tracks = sorted(whole)
        x = np.stack([relative for relative, _ in self._buffer])
        y = np.stack([[seen[i] for i in tracks] for _, seen in self._buffer])
        try:
            found = associate_by_projection(x, y, history=HISTORY)
        except DegenerateError:
            return
        self._theta = found.theta
        self._name |= dict(zip(tracks, found.vehicle.tolist(), strict=True))


Step = Callable[[int], Tracks]
"""Frame → its tracks."""


def _bytetrack(walk: Walk, keeper: Plain) -> Step:
    tracker = ByteTrack()
    return lambda frame: tracker.update(walk.detections[frame], keeper.stitch(frame))


def _ours(walk: Walk, keeper: Plain) -> Step:
    tracker = Tracker()

    def step(frame: int) -> Tracks:
        boxes, warp = walk.detections[frame], camera_motion(walk, frame)
        stitch, known = keeper.stitch(frame), keeper.known()
        return tracker.update(boxes, frame_us(frame), warp=warp, stitch=stitch, known=known)

    return step


KEEPERS: dict[str, tuple[Callable[[Walk, Plain], Step], Callable[[Walk], Plain]]] = {
    "ByteTrack": (_bytetrack, Plain),
    "ByteTrack with Algorithm 1": (_bytetrack, Paper),
    "our tracker": (_ours, Plain),
    "our tracker with Algorithm 1": (_ours, Paper),
    "our tracker and identifier": (_ours, Ours),
}


def play(seed: int) -> list[Kept]:
    """One flight through every tracker."""
    what = occluded_walk(seed)
    return [_follow(what, name, *made) for name, made in KEEPERS.items()]


def _follow(walk: Walk, name: str, track: Callable[[Walk, Plain], Step], make: Callable[[Walk], Plain]) -> Kept:
    keeper = make(walk)
    step = track(walk, keeper)
    switches = taken = hidden = 0
    track_of, vehicle_of, last = dict[int, int](), dict[int, int](), dict[int, int]()
    for frame, truth in enumerate(walk.truth):
        tracks = step(frame)
        keeper.observe(frame, tracks)
        for track_id, detection in zip(tracks.track_id.tolist(), tracks.detection.tolist(), strict=True):
            vehicle = int(truth[detection]) if detection >= 0 else -1
            if vehicle >= 0:
                switches += track_of.get(vehicle, track_id) != track_id
                taken += vehicle_of.get(track_id, vehicle) != vehicle
                hidden += frame - last.get(vehicle, frame) >= LOST
                track_of[vehicle], vehicle_of[track_id], last[vehicle] = track_id, vehicle, frame
    frames = len(walk.truth)
    return Kept(keeper=name, seed=walk.seed, frames=frames, hidden=hidden, switches=switches, taken=taken)
