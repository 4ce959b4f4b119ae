"""The scale of a film in which neither telemetry nor the camera's numbers tell what a pixel measures on the ground.

Now and then the vehicles themselves are measured (``vision.detect.apparent_length``), at one scale in each frame, which
at most doubles the work on that frame. The result is kept until vehicles are clearly of another length twice in a row,
since the camera zoomed or climbed; where none are seen it stays as it was.
"""

from __future__ import annotations

from collections.abc import Generator

import numpy as np
from numpy.typing import NDArray

from vision.detect.apparent_length import ApparentLength
from vision.detect.detector import Detector, DetectorAround, MeasuringDetector

Image = NDArray[np.uint8]

SEARCH_US, WATCH_US = 2_000_000, 4_000_000
"""Interval of measurements while the scale is in question, and while it is not. A measurement takes as long as three
frames."""
OTHER = 1.25
"""Vehicles longer or shorter by this factor are of another length: several times the error of an examination."""


class ScaleFinder:
    """Gives the ground resolution to look at each frame with. Frames come in order, from one thread.

    What it gives is determined by the frames and their times alone.

    Args:
        detector: looks at the frames, None: nobody. One that cannot measure vehicles finds its own way.

    Attributes:
        length_px: how long vehicles are, None while unknown.
    """

    def __init__(self, detector: Detector | None) -> None:
        while isinstance(detector, DetectorAround):
            detector = detector.detector
        self._detector = detector if isinstance(detector, MeasuringDetector) else None
        self._examination: Generator[None, None, ApparentLength | None] | None = None
        self._size = (0, 0)
        self._next_us: int | None = None
        self._doubt_px: float | None = None
        self._reported_px: float | None = None
        self.length_px: float | None = None

    def gsd_m(self, image: Image, t_us: int, known_m: float | None) -> float | None:
        """The ground resolution to ask a detector for.

        Args:
            image: (H, W, 3) BGR; not to be written to afterwards.
            t_us: when it was taken, Unix µs.
            known_m: ground metres a pixel as telemetry has it, None unknown.

        Returns:
            ``known_m`` where it is known; else one at which the vehicles seen have the length that the network knows
            best; None: the detector finds its own way.
        """
        if self._detector is None or (known_m is not None and np.isfinite(known_m) and known_m > 0.0):
            self._examination = None
            return known_m
        if image.shape[:2] != self._size:
            self._size, self._examination, self._next_us = image.shape[:2], None, None
            self.length_px = self._doubt_px = None
        self._examine(self._detector, image, t_us)
        return self._detector.film_gsd_m(image, self.length_px)

    def news(self) -> str:
        """Change since the last call, one line, empty for nothing."""
        if self.length_px == self._reported_px:
            return ""
        before, self._reported_px = self._reported_px, self.length_px
        if self.length_px is None:
            return "scale: lost with the frames' size"
        text = f"ground resolution unknown: vehicles are about {self.length_px:.0f} px long"
        return f"{text}, {before:.0f} px before" if before else f"{text}, and looked for at that scale"

    def _examine(self, detector: MeasuringDetector, image: Image, t_us: int) -> None:
        """Go on with an examination, or begin one when it is due."""
        if self._examination is None:
            # a clock that was set back must not end the watch
            if self._next_us is not None and 0 < self._next_us - t_us <= WATCH_US:
                return
            self._examination = detector.examine(image)
        try:
            next(self._examination)
        except StopIteration as end:
            self._examination = None
            self._take(end.value)
            settled = self.length_px is not None and self._doubt_px is None
            self._next_us = t_us + (WATCH_US if settled else SEARCH_US)

    def _take(self, found: ApparentLength | None) -> None:
        """Keep the first length that is found, and another when it is found twice in a row."""
        if found is None or _alike(found.px, self.length_px):
            self._doubt_px = None
        elif self.length_px is None or _alike(found.px, self._doubt_px):
            self.length_px, self._doubt_px = found.px, None
        else:
            self._doubt_px = found.px


def _alike(length_px: float, other_px: float | None) -> bool:
    return other_px is not None and 1.0 / OTHER < length_px / other_px < OTHER
