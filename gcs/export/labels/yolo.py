"""YOLO-OBB, as Ultralytics trains on it: ``images/train``, ``labels/train`` and ``data.yaml``.

A line is ``class x1 y1 x2 y2 x3 y3 x4 y4``, shares of the image's sides; the first two are the front, where it is
known. Corners of a box that the image cuts off lie beyond 0 and 1.

Reference: https://docs.ultralytics.com/datasets/obb/.
"""

from __future__ import annotations

from typing import Final

from gcs.export.job import ExportJob
from gcs.export.labels.frames import VEHICLE, LabelFolder
from gcs.session.line_file import open_new
from gcs.snapshot import Snapshot

_DATA: Final = f"""# one flight: validate on another, not on the frames between these
train: images/train
val: images/train
names:
  0: {VEHICLE}
"""


class YoloObbExport:
    """Export to YOLO-OBB; an image without vehicles has an empty label file."""

    def __init__(self, job: ExportJob) -> None:
        self._folder = LabelFolder(job, "images/train")
        self._labels = self._folder.path / "labels" / "train"
        self._labels.mkdir(parents=True)

    def write(self, snapshot: Snapshot) -> bool:
        """Write a frame's image and labels, unless a box may be missing."""
        if (frame := self._folder.take(snapshot)) is None:
            return False
        with open_new(self._labels / f"{frame.stem}.txt") as file:
            for one in frame.boxes:
                shares = (one.corners / (frame.width, frame.height)).ravel().tolist()
                file.write(f"0 {' '.join(f'{share:.6f}' for share in shares)}\n")
        return True

    def close(self) -> None:
        """Write data.yaml."""
        open_new(self._folder.path / "data.yaml", _DATA).close()
        self._folder.close()
