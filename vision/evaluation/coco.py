"""COCO labels: one JSON file for many images, upright boxes.

    {"images": [{"id": 1, "file_name": "a.jpg"}], "categories": [{"id": 1, "name": "car"}],
     "annotations": [{"image_id": 1, "category_id": 1, "bbox": [left, top, width, height]}]}

Boxes are in pixels. An annotation with ``iscrowd`` is an area of objects that are not labelled one by one: it counts
neither way. Segmentations are not read.

Reference:
    Lin et al. 2014, arXiv:1405.0312; https://cocodataset.org/#format-data
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path

import msgspec
import numpy as np

from infra.files.safe_open import read_small
from vision.errors import LabelError
from vision.evaluation.truth import Truth

MAX_BYTES = 1 << 30
"""COCO's own file of the training images has half of that."""


class _Image(msgspec.Struct):
    id: int
    file_name: str


class _Category(msgspec.Struct):
    id: int
    name: str


class _Annotation(msgspec.Struct):
    image_id: int
    category_id: int
    bbox: tuple[float, float, float, float]
    iscrowd: int = 0


class _CocoFile(msgspec.Struct):
    images: list[_Image]
    annotations: list[_Annotation]
    categories: list[_Category]


def find_coco(folder: Path) -> list[Path]:
    """The JSON files below a folder that have images and annotations, in the order of their names.

    Raises:
        LabelError: one cannot be read.
    """
    found = []
    for path in sorted(folder.rglob("*.json")):
        text = _read(path)
        if b'"images"' in text and b'"annotations"' in text:
            found.append(path)
    return found


def read_coco(path: Path) -> tuple[dict[str, Truth], int]:
    """The labels of each image, by its name in the file, and how many boxes without area were left out.

    An image without annotations holds nothing.

    Raises:
        LabelError: the file is not of this form, or an annotation is of no image or category.
    """
    try:
        file = msgspec.json.decode(_read(path), type=_CocoFile)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise LabelError(f"{path}: is no COCO file of boxes: {error}") from error
    categories = {category.id: category.name for category in file.categories}
    of_image: dict[int, list[_Annotation]] = defaultdict(list)
    images = {image.id for image in file.images}
    for i, one in enumerate(file.annotations):
        where = f"{path}, annotation {i}"
        if one.image_id not in images:
            raise LabelError(f"{where}: image_id {one.image_id} is none of the file's images")
        if one.category_id not in categories:
            raise LabelError(f"{where}: category_id {one.category_id} is none of the file's categories")
        if np.isfinite(one.bbox).all() and min(one.bbox[2:]) > 0.0:
            of_image[one.image_id].append(one)
    labels = {image.file_name: _truth(of_image[image.id], categories) for image in file.images}
    return labels, len(file.annotations) - sum(map(len, of_image.values()))


def _read(path: Path) -> bytes:
    try:
        return read_small(path, MAX_BYTES)
    except OSError as error:
        raise LabelError(f"{path}: cannot be read: {error.strerror}") from error


def _truth(annotations: Sequence[_Annotation], names: Mapping[int, str]) -> Truth:
    left, top, width, height = np.array([a.bbox for a in annotations], dtype=np.float64).reshape(-1, 4).T
    n = len(annotations)
    return Truth(
        boxes=np.column_stack([left + 0.5 * width, top + 0.5 * height, width, height, np.zeros(n)]),
        heading=np.full(n, np.nan),
        name=np.array([names[a.category_id] for a in annotations], dtype=np.str_),
        counts=np.array([not a.iscrowd for a in annotations], dtype=bool),
        hidden=np.full(n, -1),
        upright=True,
    )
