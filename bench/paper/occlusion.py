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
from assoc.methods.reattach import reattach
from bench.paper.bytetrack import ByteTrack
from bench.paper.films import film, paper_road
from bench.paper.projection import associate_by_projection
from bench.paper.streams import Ours, Plain, Walk, camera_motion, frame_us, walk
from sim.world.scenario import Scenario
from vision.track.tracker import Tracker
from vision.track.tracks import Stitch, Tracks

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

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


def occluded_road(seed: int) -> Scenario:
    """A road with sharp bends."""
    base = paper_road("curved", 0.0, 100 + seed)
    return replace(base, name="occluded", ground=replace(base.ground, bend_deg=75.0, bend_length_m=70.0))


def occluded_walk(seed: int) -> Walk:
    """Fly it once; each vehicle is hidden a few times where it turns most."""
    scenario = occluded_road(seed)
    seen = film(scenario)
    rng = np.random.default_rng([seed, 13])
    return walk(scenario, hidden_at_turns(seen.heading, seen.fps, rng))


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
