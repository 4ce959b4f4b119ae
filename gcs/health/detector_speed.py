"""Speed at which a detector looks at frames of a flight, by the height that they are taken from.

Measured with so many reports that no box explains that a frame has no room for more: what a flight takes at the most.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable

import numpy as np

from vision.detect.detector import Detector
from vision.detect.turns import LookInTurns

USUAL_M = 60.0
HEIGHTS_M = (30.0, USUAL_M, 120.0)
"""Heights above the ground that tell how the time grows with it."""
FRAME_SIZE = (1920, 1080)
MEASURED_S = 0.6
HALF_VIEW = math.tan(math.radians(32.5))
"""Half a frame's width over the height, of a usual lens that looks straight down."""
STEP_US = 400_000
"""Time from one frame to the next by the video's clock: no vehicle that reports is to be unseen for longer."""
REPORTS = 48


def ground_sampling(height_m: float, width: int = FRAME_SIZE[0]) -> float:
    """Ground metres a pixel straight below a usual lens."""
    return 2.0 * HALF_VIEW * height_m / width


def seconds_a_frame(
    detector: Detector,
    gsd_m: float,
    size: tuple[int, int] = FRAME_SIZE,
    *,
    whole: bool = False,
    clock: Callable[[], float] = time.perf_counter,
) -> float:
    """Time of one look.

    Args:
        detector: what looks.
        gsd_m: ground metres a pixel.
        size: width and height of the frames, px.
        whole: look at the whole picture; else as a flight does.
        clock: what the time is told by, seconds.
    """
    image, turns = np.full((size[1], size[0], 3), 96, dtype=np.uint8), LookInTurns(detector, 1.0)
    spread = np.random.default_rng(0).uniform(0.0, size, (REPORTS, 2)).tolist()
    reports = {k: (x, y, 0.0) for k, (x, y) in enumerate(spread)}

    def look(k: int) -> None:
        if whole:
            detector.detect(image, gsd_m=gsd_m)
        else:
            turns.look(image, (k + 1) * STEP_US, gsd_m, reported=lambda: reports)

    look(0)  # also sets the network up
    began_s, frames = clock(), 0
    while not frames or clock() - began_s < MEASURED_S:
        frames += 1
        look(frames)
    return (clock() - began_s) / frames
