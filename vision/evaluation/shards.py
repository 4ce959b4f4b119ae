"""Shards of rendered training crops, ``crops_*.npz`` of ``python -m training.rendered.crops``, as labelled images."""

from __future__ import annotations

import os
import zipfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from infra.files.safe_open import open_to_read
from vision.errors import LabelError
from vision.evaluation.truth import LabelledImage, Truth

__all__ = ["VEHICLE", "read_shard", "shard_truth"]

Image = NDArray[np.uint8]
VEHICLE = "vehicle"
"""Name of the only class."""


def shard_truth(rows: ArrayLike) -> Truth:
    """Labels of one crop.

    Args:
        rows: (n, 6) cx, cy, length, width px, heading (rad, clockwise from image up), weight (½ and less: does not
            count).
    """
    table = np.asarray(rows, dtype=np.float64).reshape(-1, 6)
    # the width axis of a box points to the front: angle = heading − π/2
    boxes = np.column_stack([table[:, :4], table[:, 4] - 0.5 * np.pi])
    return Truth(
        boxes=boxes,
        heading=table[:, 4],
        name=np.full(len(table), VEHICLE),
        counts=table[:, 5] > 0.5,
        hidden=np.full(len(table), -1),
    )


def read_shard(path: Path) -> list[LabelledImage]:
    """All crops of a shard.

    Raises:
        LabelError: it is no such file.
    """
    try:
        with os.fdopen(open_to_read(path), "rb") as file, np.load(file) as shard:
            images, boxes, n = shard["images"], shard["boxes"], shard["n"]
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        raise LabelError(f"{path}: no shard of crops with images, boxes and n: {error}") from error
    fits = images.ndim == 4 and images.shape[3] == 3 and boxes.ndim == 3 and boxes.shape[2] == 6
    if not fits or not len(images) == len(boxes) == len(n) or (len(n) and n.max() > boxes.shape[1]):
        raise LabelError(f"{path}: images {images.shape}, boxes {boxes.shape} and n {n.shape} do not belong together")
    return [
        LabelledImage(name=f"{path.stem} {i}", read=_reader(image), truth=shard_truth(rows[:k]), as_seen=True)
        for i, (image, rows, k) in enumerate(zip(images, boxes, n.tolist(), strict=True))
    ]


def _reader(image: Image) -> Callable[[], Image]:
    return partial(np.asarray, image)
