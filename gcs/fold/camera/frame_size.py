"""The frame size of a recording that does not have it: the size at which its boxes lie where vehicles report.

With W the width of a frame, in units of that of the image that the camera is described for, a box at pixel x is at
x / W. Its density is a mixture: near one of the n reported places u in the image, or anywhere in it,
    p(x) = 1/W² · [ (1 − ε)/n Σ N(x/W; u, σ²I) + ε / area ],
with 1/W² for the change of variables. The sizes that streams have are compared by the mean of ln p over the boxes of a
frame, summed over frames two seconds apart.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs.fold.pipeline import Pipeline
from gcs.mission.mission import Mission
from gcs.session.frame_tables import FrameDetections
from gcs.session.log import SessionLog

FloatArray = NDArray[np.float64]

WIDTHS_PX = (
    *(320, 416, 480, 512, 640, 720, 768, 800, 854, 960, 1024, 1152, 1280, 1440, 1536, 1600, 1920, 2048, 2304, 2560),
    *(2704, 3072, 3280, 3840, 4000, 4096, 5472),
)
"""Widths of the streams that cameras send."""
STD = 0.03
"""1σ by which a box lies beside its report, in widths of the frame: errors of pose, clock and receiver."""
STRANGE = 0.3
"""Share of boxes that are no vehicle's that reports."""
BEYOND = 1.02
"""Farthest place of a box's centre, in sizes of a frame: half a vehicle looks in."""
EVERY_US = 2_000_000
"""Interval of the frames that are compared: closer ones are not independent."""
MAX_LOOKS = 40
DESCRIBED = 3.0
"""Prior for the size that the camera is described for, nats: twenty streams have it for one that has not."""
SURE = 5.0
"""Advantage of the best size over any other with which it is taken, nats: 150 to one."""
ALIKE = 0.03
"""Relative difference below which two sizes are one: names do not depend on it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameSize:
    """Knowledge of the size of frames without an image."""

    size: tuple[int, int] | None = None
    """Width and height, px; None: of the size that the camera is described for."""
    known: bool = True
    """False: unknown, and nothing can be named."""
    doubt: str = ""
    """Warning for an analyst."""


_UNRECORDED = "how large the frames were is not recorded"
_GIVE = "give --frame-size WIDTHxHEIGHT"
UNDESCRIBED = FrameSize(
    doubt=f"{_UNRECORDED}, and no mission describes the camera: nothing is named unless the UAV reports its camera's "
    f"resolution; {_GIVE}"
)
"""Frames of a camera that no mission describes, in a recording without their size."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _SampledFrame:
    """Boxes and reported places of a frame, in units of the described image's width."""

    size: tuple[int, int]
    """Size of the described image, px."""
    boxes: FloatArray
    """(m, 2) their centres, as if the frame had that size."""
    places: FloatArray
    """(n, 2) of the vehicles in the image, by their reports."""


def fitting_size(mission: Mission, log: SessionLog, times_us: NDArray[np.int64], boxes: FrameDetections) -> FrameSize:
    """The size of frames at which boxes and reports fit.

    Args:
        mission: who flew, and the camera as it is described.
        log: telemetry.
        times_us: (n,) of the frames.
        boxes: what was seen in them, in pixels of unknown frames.
    """
    looks = list(_sampled_frames(mission, log, times_us, boxes))
    if not looks:
        return _unknown("no box was seen while vehicles reported places in the image")
    width, height = looks[0].size
    widths = np.array(sorted({width, *WIDTHS_PX}))
    widths = widths[[holds((each, each * height / width), boxes) for each in widths.tolist()]]
    if not len(widths):
        return _unknown("boxes lie farther out than any known size of frames")
    fit = np.array([sum(_fit(look, each / width) for look in looks) for each in widths])
    somewhere = bool(np.any(fit > [sum(_strange(look, each / width) for look in looks) for each in widths]))
    fit += DESCRIBED * (widths == width)
    best = int(widths[np.argmax(fit)])
    others = fit[np.abs(widths / best - 1.0) > ALIKE]
    if len(others) and fit.max() - others.max() < SURE:
        if not somewhere:
            # what is not of this flight fits no size: the identifier says so, and names nothing
            text = f"{_UNRECORDED}, and boxes and reports fit no size: {width}×{height}"
            return FrameSize(doubt=f"{text} is taken, as the camera is described; --frame-size sets another")
        return _unknown("boxes and reports fit several sizes")
    size = (best, round(best * height / width))
    text = f"{_UNRECORDED}: {size[0]}×{size[1]} is taken, where boxes and reports fit"
    return FrameSize(size=size, doubt=f"{text}; --frame-size sets another")


def holds(size: tuple[float, float], boxes: FrameDetections) -> bool:
    """Tell whether frames of a width and height, px, can have had all these boxes in them."""
    return all(reach <= BEYOND * side for reach, side in zip(boxes.extent, size, strict=True))


def _unknown(why: str) -> FrameSize:
    text = f"{_UNRECORDED}, and {why}: nothing is named; {_GIVE}"
    return FrameSize(known=False, doubt=text)


def _sampled_frames(
    mission: Mission, log: SessionLog, times_us: NDArray[np.int64], boxes: FrameDetections
) -> Iterator[_SampledFrame]:
    """Frames with boxes, some time apart."""
    pipeline, packets = Pipeline(mission), log.packets()
    waiting = next(packets, None)
    found, last_us = 0, -EVERY_US
    for index, t_us in enumerate(times_us.tolist()):
        seen = boxes.at(index).at_least(mission.detector.score)
        if t_us - last_us < EVERY_US or not len(seen):
            continue
        while waiting is not None and waiting.t_us <= t_us:
            pipeline.add_packet(waiting)
            waiting = next(packets, None)
        pipeline.follow_ground(t_us)
        expected = pipeline.expected_pixels(t_us)
        if expected is None:
            continue
        (width, height), places = expected[0], expected[1] / expected[0][0]
        places = places[((places > -STD) & (places < (1.0 + STD, height / width + STD))).all(axis=1)]
        if not len(places):
            continue
        last_us, found = t_us, found + 1
        yield _SampledFrame(size=(width, height), boxes=seen.centre / width, places=places)
        if found == MAX_LOOKS:
            return


def _fit(look: _SampledFrame, scale: float) -> float:
    """Mean of ln p over the boxes of a frame, for a frame this many times as wide as the described image."""
    gap = look.boxes[:, None] / scale - look.places[None]
    near = np.exp(-0.5 * (gap**2).sum(axis=2) / STD**2).mean(axis=1) / (2.0 * np.pi * STD**2)
    area = look.size[1] / look.size[0]
    return float(np.log((1.0 - STRANGE) * near + STRANGE / area).mean() - 2.0 * np.log(scale))


def _strange(look: _SampledFrame, scale: float) -> float:
    """Return the score if no box is a vehicle's that reports: they may be anywhere."""
    return -float(np.log(look.size[1] / look.size[0]) + 2.0 * np.log(scale))
