"""What the detector sees in parts of a film: a few frames a second, enough to follow vehicles."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import numpy as np

from gcs.fold.detector_factory import open_mission_detector
from gcs.importing.fleet_clock import FilmBoxes, film_spans
from gcs.mission.mission import DetectorChoice
from vision.detect.scale_finder import ScaleFinder
from vision.video.prefetch import look_ahead
from vision.video.video import Frame, VideoFile

__all__ = ["boxes_of_spans"]

EVERY_US = 240_000
"""Between two frames that are looked at: a vehicle moves by less than its own length."""


def boxes_of_spans(path: Path, film_us: int, choice: DetectorChoice) -> Iterator[FilmBoxes]:
    """Boxes of the parts of a film that tell its clock, each looked at when it is asked for.

    Args:
        path: the film.
        film_us: time of its first frame, Unix µs.
        choice: which network.

    Raises:
        VideoError, ModelError: a file cannot be used.
    """
    detector = open_mission_detector(choice)
    with VideoFile.open(path, start_us=film_us) as video:
        for first_us, last_us in film_spans(video.times_us):
            scale = ScaleFinder(detector)
            times, boxes = [], []

            def gsd_m(frame: Frame, scale: ScaleFinder = scale) -> float | None:
                return scale.gsd_m(frame.image, frame.t_us, None)

            with closing(look_ahead(_few(video, first_us, last_us), detector, gsd_m)) as looked:
                for frame, found in looked:
                    times.append(frame.t_us)
                    boxes.append(found.useful(choice.score))
            yield FilmBoxes(t_us=np.array(times, np.int64), boxes=boxes, size=(video.width, video.height))


def _few(video: VideoFile, first_us: int, last_us: int) -> Iterator[Frame]:
    """Frames of a part of the video, some time apart."""
    next_us = first_us
    for frame in video.frames(int(np.searchsorted(video.times_us, first_us))):
        if frame.t_us > last_us:
            return
        if frame.t_us >= next_us:
            next_us = frame.t_us + EVERY_US
            yield frame
