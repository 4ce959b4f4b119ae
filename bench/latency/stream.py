"""The identifier and the tracker on whole flights, frame by frame."""

from __future__ import annotations

import time

from bench.latency.measure import MethodTiming
from bench.latency.scenes import crowd
from bench.paper.streams import Ours, camera_motion, frame_us, walk
from vision.track.tracker import Tracker

__all__ = ["measure_streams"]


def measure_streams(quick: bool) -> list[MethodTiming]:
    """Time of each part on every frame, with 7, 20 and 50 vehicles."""
    result = []
    for n in (7,) if quick else (7, 20, 50):
        result += _flight(n, 3.0 if quick else 15.0)
    return result


def _flight(n: int, seconds: float) -> list[MethodTiming]:
    what = walk(crowd(n, seconds))
    tracker, keeper = Tracker(), Ours(what)
    times: dict[str, tuple[list[float], list[float]]] = {"tracker": ([], []), "identifier": ([], []), "both": ([], [])}
    for frame, boxes in enumerate(what.detections):
        warp, stitch, known = camera_motion(what, frame), keeper.stitch(frame), keeper.known()
        began = time.thread_time(), time.perf_counter()
        tracks = tracker.update(boxes, frame_us(frame), warp=warp, stitch=stitch, known=known)
        tracked = time.thread_time(), time.perf_counter()
        keeper.observe(frame, tracks)
        named = time.thread_time(), time.perf_counter()
        for name, start, stop in (("tracker", began, tracked), ("identifier", tracked, named), ("both", began, named)):
            for kind in (0, 1):
                times[name][kind].append(stop[kind] - start[kind])
    return [MethodTiming.of(name, "per frame", (n, n), cpu, wall) for name, (cpu, wall) in times.items()]
