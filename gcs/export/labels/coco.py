"""COCO: ``images`` and ``annotations/instances_default.json``, with the outline of each box as its segmentation.

The outline is cut at the image's edge; ``bbox`` and ``area`` are those of what is left.

Reference: Lin et al. 2014, arXiv:1405.0312; https://cocodataset.org/#format-data.
"""

from __future__ import annotations

from typing import Any

import cv2
import msgspec
import numpy as np
from numpy.typing import NDArray

from gcs.export.job import ExportJob
from gcs.export.labels.frames import VEHICLE, LabelFolder, LabelledBox, LabelledFrame
from gcs.snapshot import Snapshot
from infra.plain_text import plain


class CocoExport:
    """Export to COCO; a box's ``attributes`` say who it is."""

    def __init__(self, job: ExportJob) -> None:
        self._name = plain(job.name)
        self._folder = LabelFolder(job)
        self._images: list[dict[str, Any]] = []
        self._annotations: list[dict[str, Any]] = []

    def write(self, snapshot: Snapshot) -> bool:
        """Write a frame's image and keep its labels, unless a box may be missing."""
        if (frame := self._folder.take(snapshot)) is None:
            return False
        number = len(self._images) + 1
        self._images.append({"id": number, "file_name": frame.image, "width": frame.width, "height": frame.height})
        self._annotations += [_annotation(frame, number, one) for one in frame.boxes]
        return True

    def close(self) -> None:
        """Write the labels."""
        for number, annotation in enumerate(self._annotations, 1):
            annotation["id"] = number
        whole = {
            "info": {"description": f"{self._name}, labelled by Rollcall"},
            "licenses": [],
            "categories": [{"id": 1, "name": VEHICLE, "supercategory": ""}],
            "images": self._images,
            "annotations": self._annotations,
        }
        (self._folder.path / "annotations").mkdir()
        (self._folder.path / "annotations" / "instances_default.json").write_bytes(msgspec.json.encode(whole))
        self._folder.close()


def _annotation(frame: LabelledFrame, image: int, one: LabelledBox) -> dict[str, Any]:
    outline = _in_image(one.corners, frame.width, frame.height)
    x, y = outline.T
    # Gauss: 2 A = |Σ x_i y_(i+1) − x_(i+1) y_i|
    area = 0.5 * abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1)))
    left, top, right, bottom = (float(side) for side in (x.min(), y.min(), x.max(), y.max()))
    return {
        "image_id": image,
        "category_id": 1,
        "segmentation": [np.round(outline, 2).ravel().tolist()],
        "bbox": [round(side, 2) for side in (left, top, right - left, bottom - top)],
        "area": round(area, 2),
        "iscrowd": 0,
        "attributes": one.attributes(),
    }


def _in_image(points: NDArray[np.float64], width: int, height: int) -> NDArray[np.float64]:
    """Part of a convex outline (n, 2) that lies in the image; its middle does."""
    image = np.array([(0, 0), (width, 0), (width, height), (0, height)], dtype=np.float32)
    _, inside = cv2.intersectConvexConvex(points.astype(np.float32), image)
    return np.asarray(inside, dtype=np.float64).reshape(-1, 2)
