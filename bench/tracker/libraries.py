"""Published trackers that run when their package is installed; what is missing is named, with why.

    pip install trackers "supervision<0.31"

in an environment of their own, which needs nothing else of this project than numpy and scipy.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from importlib import import_module
from importlib.metadata import version
from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.tracker.scene import SimulatedFrame
from bench.tracker.upright import upright

__all__ = ["PUBLISHED", "Absent", "Published"]

IntArray = NDArray[np.int64]

HIGH, NEW = 0.5, 0.6
"""Scores of sure boxes and of boxes that begin a track, the same for all."""

_Make = Callable[[Any], Any]

PUBLISHED: dict[str, tuple[str, _Make]] = {
    "trackers SORT": ("trackers", lambda m: m.SORTTracker(track_activation_threshold=HIGH)),
    "trackers ByteTrack": (
        "trackers",
        lambda m: m.ByteTrackTracker(track_activation_threshold=NEW, high_conf_det_threshold=HIGH),
    ),
    "trackers OC-SORT": ("trackers", lambda m: m.OCSORTTracker(high_conf_det_threshold=HIGH)),
    "trackers C-BIoU": ("trackers", lambda m: m.CBIoUTracker()),
    "supervision ByteTrack": ("supervision", lambda m: m.ByteTrack(track_activation_threshold=HIGH)),
}
"""Name → its package and how it is made."""


class Absent(Exception):  # noqa: N818 - nothing went wrong
    """A package that is not installed, or not in a version that has this tracker."""


class Published:
    """One of them, behind the same call as the others."""

    def __init__(self, name: str) -> None:
        package, make = PUBLISHED[name]
        if find_spec(package) is None or find_spec("supervision") is None:
            raise Absent(f"package {package} is not installed")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            self._boxes = import_module("supervision").Detections
            try:
                self._tracker = make(import_module(package))
            except (AttributeError, TypeError) as error:
                raise Absent(f"{package} {version(package)} has it not as expected: {error}") from error
        self._update = getattr(self._tracker, "update_with_detections", None) or self._tracker.update

    def prepare(self, frame: SimulatedFrame) -> Any:  # noqa: ANN401 - the package's own type
        """The frame's boxes in the package's form."""
        boxes = frame.boxes
        return self._boxes(
            xyxy=upright(boxes),
            confidence=boxes.score.copy(),
            class_id=np.zeros(len(boxes), int),
            data={"index": np.arange(len(boxes))},
        )

    def update(self, boxes: Any) -> Any:  # noqa: ANN401 - the package's own type
        """Take in one frame."""
        return self._update(boxes)

    @staticmethod
    def track_of_boxes(found: Any, count: int) -> IntArray:  # noqa: ANN401 - the package's own type
        """The track of each of the boxes (count,), -1 none."""
        out = np.full(count, -1)
        if len(found) and found.tracker_id is not None:
            out[np.asarray(found.data["index"], int)] = found.tracker_id
        return out
