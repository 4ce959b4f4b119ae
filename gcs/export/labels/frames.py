"""The images of a labelled folder, and the frames that must not be in it.

An image in a training set says that everything else in it is no vehicle. So a frame of which it is known that a box may
be missing is left out as a whole: one in which a track was not found, which a detector did not look at, or, with a
least confidence, in which a box has no name or one that is less certain. ``left_out.csv`` has them with the reason.
"""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from gcs.export.job import ExportJob
from gcs.export.unfinished import Unfinished
from gcs.session.line_file import open_new
from gcs.snapshot import Box, Snapshot
from infra.plain_text import plain, to_cell
from vision.detect.boxes import corners

VEHICLE: Final = "vehicle"
"""Name of the only class."""
QUALITY: Final = 95
"""Quality of JPEG: the film was coded before, and what this loses nobody sees."""
_COLUMNS: Final = (
    *("image", "cx_px", "cy_px", "w_px", "h_px", "angle_deg", "heading_deg"),
    *("track_id", "system_id", "name", "confidence", "score", "stated"),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class LabelledBox:
    """One vehicle in an image."""

    box: Box
    name: str
    """Plain text, empty without a name."""
    corners: NDArray[np.float64]
    """(4, 2) px, clockwise on screen; the first two are those of the front, where it is known."""

    def attributes(self) -> dict[str, int | float | str]:
        """Name of a box and its certainty; what is unknown is not in it."""
        found: dict[str, int | float | str] = {}
        if self.box.track_id:
            found["track_id"] = self.box.track_id
        if self.box.system_id:
            found |= {"system_id": self.box.system_id, "name": self.name}
        for key, value in (("confidence", self.box.confidence), ("score", self.box.score)):
            if math.isfinite(value):
                found[key] = round(value, 4)
        return found


@dataclass(frozen=True, slots=True, kw_only=True)
class LabelledFrame:
    """One image and all that is in it."""

    stem: str
    """Name of the image without its ending."""
    width: int
    height: int
    boxes: tuple[LabelledBox, ...]

    @property
    def image(self) -> str:
        """Name of the image."""
        return f"{self.stem}.jpg"


class LabelFolder:
    """Writes the images and what all formats have beside them."""

    def __init__(self, job: ExportJob, images: str = "images") -> None:
        self._job = job
        self._unfinished = Unfinished(job.path)
        self.path = self._unfinished.path
        """Folder in which the format writes its own files."""
        self._images = self.path / images
        self._images.mkdir(parents=True)
        self._boxes_file = open_new(self.path / "boxes.csv")
        self._boxes = csv.writer(self._boxes_file, lineterminator="\n")
        self._boxes.writerow(_COLUMNS)
        self._left_out: list[tuple[int, str]] = []
        self._taken = 0

    def take(self, snapshot: Snapshot) -> LabelledFrame | None:
        """Write the image of a frame; None: the frame is left out."""
        reason = _missing(snapshot, self._job.min_confidence)
        if reason or snapshot.image is None:
            self._left_out.append((snapshot.frame, reason or "no image"))
            return None
        height, width = snapshot.image.shape[:2]
        boxes = tuple(_labelled(snapshot, box) for box in snapshot.new_boxes if not box.coasting)
        frame = LabelledFrame(stem=f"frame_{snapshot.frame:06d}", width=width, height=height, boxes=boxes)
        _, coded = cv2.imencode(".jpg", snapshot.image, (cv2.IMWRITE_JPEG_QUALITY, QUALITY))
        (self._images / frame.image).write_bytes(coded.tobytes())
        self._boxes.writerows(_row(frame, one) for one in boxes)
        self._taken += 1
        return frame

    def close(self) -> None:
        """Say what was left out, and put the folder into its place."""
        self._boxes_file.close()
        with open_new(self.path / "left_out.csv", "frame,reason\n") as file:
            file.writelines(f"{frame},{reason}\n" for frame, reason in self._left_out)
        if self._left_out:
            count = len(self._left_out)
            self._job.note(f"{count} of {count + self._taken} frames are left out, with reasons in left_out.csv")
        self._unfinished.finish()


def _missing(snapshot: Snapshot, least: float) -> str:
    """Return why the boxes of a frame may not be all; empty: there is no reason to think so."""
    if snapshot.held or (not snapshot.seen_us and not snapshot.boxes):
        return "not looked at"
    for box in snapshot.boxes:
        inside = 0.0 <= box.cx < snapshot.width and 0.0 <= box.cy < snapshot.height
        if box.coasting and inside:
            return f"track {box.track_id} was not found"
        if not box.coasting and not (inside and min(box.w, box.h) > 0.0 and math.isfinite(box.angle)):
            return "a box is not in the image"
        if not box.coasting and least > 0.0 and not (box.system_id and box.confidence >= least):
            return "a name is missing or not certain enough"
    return ""


def _labelled(snapshot: Snapshot, box: Box) -> LabelledBox:
    points = corners((box.cx, box.cy, box.w, box.h, box.angle))
    if math.isfinite(box.heading):
        # d = (sin heading, −cos heading): clockwise from image up, y down
        ahead = np.array([math.sin(box.heading), -math.cos(box.heading)])
        middles = 0.5 * (points + np.roll(points, -1, axis=0)) - (box.cx, box.cy)
        # of each side, which way it lies; the box's own two sizes do not count
        ways = middles / np.linalg.norm(middles, axis=1, keepdims=True)
        points = np.roll(points, -int(np.argmax(ways @ ahead)), axis=0)
    name = plain(snapshot.name_of(box.system_id)) if box.system_id else ""
    return LabelledBox(box=box, name=name, corners=points)


def _row(frame: LabelledFrame, one: LabelledBox) -> tuple[object, ...]:
    box = one.box
    place = (_cell(value, 2) for value in (box.cx, box.cy, box.w, box.h))
    turn = (_cell(math.degrees(value), 2) for value in (box.angle, box.heading))
    who = (box.track_id or "", box.system_id or "", to_cell(one.name))
    return (frame.image, *place, *turn, *who, _cell(box.confidence, 4), _cell(box.score, 4), int(box.stated))


def _cell(value: float, digits: int) -> str:
    return f"{value:.{digits}f}" if math.isfinite(value) else ""
