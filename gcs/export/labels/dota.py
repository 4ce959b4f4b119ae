"""DOTA: ``train/images`` and ``train/labelTxt``, corners in pixels.

A line is ``x1 y1 x2 y2 x3 y3 x4 y4 category difficult``; the first two corners are the front, where it is known.

Reference: Xia et al. 2018, arXiv:1711.10398; https://captain-whu.github.io/DOTA/dataset.html.
"""

from __future__ import annotations

from gcs.export.job import ExportJob
from gcs.export.labels.frames import VEHICLE, LabelFolder
from gcs.session.line_file import open_new
from gcs.snapshot import Snapshot


class DotaExport:
    """Export to DOTA; an image without vehicles has a label file of the two head lines."""

    def __init__(self, job: ExportJob) -> None:
        self._folder = LabelFolder(job, "train/images")
        self._labels = self._folder.path / "train" / "labelTxt"
        self._labels.mkdir()

    def write(self, snapshot: Snapshot) -> bool:
        """Write a frame's image and labels, unless a box may be missing."""
        if (frame := self._folder.take(snapshot)) is None:
            return False
        with open_new(self._labels / f"{frame.stem}.txt", "imagesource:Rollcall\ngsd:null\n") as file:
            for one in frame.boxes:
                file.write(f"{' '.join(f'{px:.2f}' for px in one.corners.ravel().tolist())} {VEHICLE} 0\n")
        return True

    def close(self) -> None:
        """Finish the folder."""
        self._folder.close()
