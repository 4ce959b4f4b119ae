"""Boxes seen in the frames of a recording: as the flight kept it, or found by looking at the video again.

The detector and OpenCV are imported when a video is looked at: to load them takes longer than many a fold.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gcs.session.frame_tables import FrameDetections, FrameMotions, read_detections, read_motions
from vision.detect.detections import Detections
from vision.motion.image_motion import ImageMotion

if TYPE_CHECKING:
    from vision.detect.detector import Detector
    from vision.video.video import Frame, VideoFile


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LookedFrame:
    """A frame with what was seen in it."""

    index: int
    """Place in the video."""
    t_us: int
    """Time of the frame, Unix µs."""
    image: NDArray[np.uint8] | None
    """(H, W, 3) BGR, where there is one."""
    boxes: Detections | None
    """None: the detector did not look at it."""
    motion: ImageMotion | None
    """Motion of the camera since the last frame that was looked at; None: not known."""
    news: str = ""
    """Findings about the film's scale until this frame, one line."""


class RecordedLooks:
    """Boxes that a session kept.

    Attributes:
        boxes: by frame.
        skipped: rows that could not be used, by file.
    """

    def __init__(self, boxes: FrameDetections, motions: FrameMotions | None) -> None:
        self.boxes, self._motions = boxes, motions
        self.skipped = {
            "detections.csv": boxes.skipped,
            "looks.csv": boxes.looks_skipped,
            "motion.csv": motions.skipped if motions else 0,
        }

    @classmethod
    def read(cls, detections: Path, motion: Path | None) -> RecordedLooks:
        """Read ``detections.csv`` and, where it is there, ``motion.csv``.

        Raises:
            SessionError: a file is no such table.
        """
        return cls(read_detections(detections), read_motions(motion) if motion else None)

    def motion(self, index: int) -> ImageMotion | None:
        """Motion of the camera until a frame."""
        return self._motions.at(index) if self._motions else None


def recorded_frames(
    looks: RecordedLooks | None, times_us: NDArray[np.int64], first: int, video: VideoFile | None
) -> Iterator[LookedFrame]:
    """Frames with what was kept of them; one without anything was perhaps never looked at, as a flight skips frames.

    Args:
        looks: what was kept; None: nothing.
        times_us: (n,) Unix µs of the frames.
        first: index of the first frame.
        video: for their images, None: without; frames that cannot be decoded are left out.
    """
    frames: Iterator[tuple[int, int, NDArray[np.uint8] | None]]
    if video is not None:
        frames = ((frame.index, frame.t_us, frame.image) for frame in video.frames(first))
    else:
        frames = ((index, t_us, None) for index, t_us in enumerate(times_us[first:].tolist(), first))
    for index, t_us, image in frames:
        boxes, motion = (looks.boxes.at(index), looks.motion(index)) if looks else (None, None)
        looked = boxes is not None and (len(boxes) > 0 or motion is not None)
        yield LookedFrame(index=index, t_us=t_us, image=image, boxes=boxes if looked else None, motion=motion)


def look_again(
    video: VideoFile,
    detector: Detector,
    gsd_m: Callable[[Frame], float | None],
    score: float,
    first: int = 0,
    *,
    threads: int = 2,
) -> Iterator[LookedFrame]:
    """Look at the frames of a video, from one on.

    Args:
        video: decoded as frames are asked for.
        detector: may be asked from several threads at once.
        gsd_m: metres on the ground per pixel of a frame as telemetry has it, None unknown: then the vehicles tell it.
        score: weaker boxes do not count, of which the best are kept.
        first: index of the first frame.
        threads: which look at the next frames meanwhile; 0: none.
    """
    from vision.detect.scale_finder import ScaleFinder
    from vision.motion.estimator import MotionEstimator
    from vision.video.prefetch import look_ahead

    motions, scale, news = MotionEstimator(), ScaleFinder(detector), dict[int, str]()

    def used_gsd_m(frame: Frame) -> float | None:
        used = scale.gsd_m(frame.image, frame.t_us, gsd_m(frame))
        news[frame.index] = scale.news()
        return used

    with closing(look_ahead(video.frames(first), detector, used_gsd_m, workers=threads)) as looked:
        for frame, found in looked:
            boxes = found.useful(score)
            motion = motions.update(frame.image, boxes.at_least(score))
            yield LookedFrame(
                index=frame.index,
                t_us=frame.t_us,
                image=frame.image,
                boxes=boxes,
                motion=motion,
                news=news.pop(frame.index),
            )
