"""What perception costs, stage by stage, on a recorded video.

    python -m bench.video.perception [VIDEO] [--model M.onnx]

First one frame after the other on one thread, each stage timed; then decoding and looking ahead on as many threads as
``gcs identify`` uses, frames a second and the share of the cores. The default video is the bundled one, 1920 × 1080.
"""

from __future__ import annotations

import argparse
import os
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from types import ModuleType
from typing import Any
from unittest.mock import patch

import numpy as np

from vision.detect import decode_heatmap, heatmap_detector, yolo_detector
from vision.detect.detector import Detector, open_detector
from vision.video.prefetch import look_ahead
from vision.video.video import VideoFile

BUNDLED = Path("sitl_logs/curved-road/video.mp4")
RESULTS = Path("bench-results/perception.md")
STAGES: tuple[tuple[ModuleType, str, str], ...] = (
    (heatmap_detector, "letterbox", "scale"),
    (heatmap_detector, "undo", "boxes"),
    (decode_heatmap, "decode", "boxes"),
    (yolo_detector, "draw", "scale"),
    (yolo_detector, "undo", "boxes"),
)
WARM_UP = 5
GSD_M = 0.033
"""Ground metres per pixel when the bundled session was filmed, 40 m up."""


class _Stopwatch:
    """Seconds spent in each stage."""

    def __init__(self) -> None:
        self.s: dict[str, float] = defaultdict(float)

    def timed(self, stage: str, call: Callable[..., Any]) -> Callable[..., Any]:
        def measured(*args: Any, **named: Any) -> Any:  # noqa: ANN401 - any stage
            start = time.perf_counter()
            try:
                return call(*args, **named)
            finally:
                self.s[stage] += time.perf_counter() - start

        return measured


class _TimedSession:
    """A network whose runs are timed."""

    def __init__(self, session: Any, watch: _Stopwatch) -> None:  # noqa: ANN401 - onnxruntime is not typed
        self.run = watch.timed("network", session.run)


@contextmanager
def _stages(detector: Detector, watch: _Stopwatch) -> Iterator[None]:
    """Time the stages of a detector while inside."""
    patches = [patch.object(module, name, watch.timed(stage, getattr(module, name))) for module, name, stage in STAGES]
    session: Any = _TimedSession(vars(detector)["_session"], watch)
    patches.append(patch.object(detector, "_session", session))
    for each in patches:
        each.start()
    try:
        yield
    finally:
        for each in patches:
            each.stop()


def one_by_one(video: VideoFile, detector: Detector, n: int, gsd_m: float) -> dict[str, float]:
    """Milliseconds per frame of each stage, decoding first, on one thread."""
    watch = _Stopwatch()
    frames = islice(video.frames(), n)
    pull = watch.timed("decode", lambda: next(frames, None))
    detector.detect(np.zeros((video.height, video.width, 3), np.uint8), gsd_m=gsd_m)
    looked = 0
    with _stages(detector, watch):
        look = watch.timed("detect", detector.detect)
        while (frame := pull()) is not None:
            look(frame.image, gsd_m=gsd_m)
            looked += 1
    ms = {stage: 1e3 * spent / max(looked, 1) for stage, spent in watch.s.items()}
    ms["rest"] = ms["detect"] - sum(ms.get(stage, 0.0) for stage in ("scale", "network", "boxes"))
    return ms


def ahead(video: VideoFile, detector: Detector, n: int, gsd_m: float, workers: int) -> tuple[float, float]:
    """Frames a second from file to boxes, and processor seconds per second of all cores, 0 to 1."""
    frames = islice(video.frames(), n + WARM_UP)
    looked = look_ahead(frames, detector, lambda _: gsd_m, workers=workers)
    for _ in range(WARM_UP):
        next(looked)
    wall, busy = time.perf_counter(), time.process_time()
    seen = sum(1 for _ in looked)
    wall, busy = time.perf_counter() - wall, time.process_time() - busy
    return seen / wall, busy / wall / (os.cpu_count() or 1)


def report(video: VideoFile, model: Path | None, providers: list[str] | None, n: int, gsd_m: float) -> str:
    """Both tables."""
    detector = open_detector(model, providers=providers)
    ms = one_by_one(video, detector, n, gsd_m)
    rows = [f"| {stage} | {ms.get(stage, 0.0):.1f} |" for stage in ("decode", "scale", "network", "boxes", "rest")]
    name = model.name if model else "the bundled model"
    lines = [f"{video.width} × {video.height}, {name}, {n} frames, {os.cpu_count()} cores", ""]
    lines += ["| stage, one thread | ms a frame |", "| --- | --- |", *rows, ""]
    lines += ["| looking ahead, workers | frames a second | share of the cores |", "| --- | --- | --- |"]
    for workers in (1, 2):
        rate, share = ahead(video, detector, n, gsd_m, workers)
        lines.append(f"| {workers} | {rate:.1f} | {share:.0%} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Print the tables and keep them."""
    parser = argparse.ArgumentParser(description="Stage times, frames a second and processor share of perception.")
    parser.add_argument("video", type=Path, nargs="?", default=BUNDLED)
    parser.add_argument("--model", type=Path, help="an ONNX detector instead of the bundled one")
    parser.add_argument("--provider", action="append", help="onnxruntime execution provider, best first")
    parser.add_argument("--frames", type=int, default=200)
    parser.add_argument("--gsd", type=float, default=GSD_M, help="ground metres per pixel")
    parser.add_argument("--out", type=Path, default=RESULTS)
    options = parser.parse_args()
    with VideoFile.open(options.video) as video:
        text = report(video, options.model, options.provider, min(options.frames, video.n - WARM_UP), options.gsd)
    options.out.parent.mkdir(parents=True, exist_ok=True)
    options.out.write_text(text)
    print(text)


if __name__ == "__main__":
    main()
