"""Vehicles to learn from, and batches of crops out of them, jittered as a detector's boxes are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vision.detect.front_crops import rectify

FloatArray = NDArray[np.float64]
Image = NDArray[np.uint8]

# ImageNet's, of RGB in 0..1, as published weights expect it
MEAN = np.array([0.485, 0.456, 0.406], np.float32)
STD = np.array([0.229, 0.224, 0.225], np.float32)
CENTRE, SIZE, ANGLE = 0.04, 0.07, np.radians(3.0)
"""Deviations of a detector's boxes: centre as a share of the sides, logarithm of the sides, radians."""
CENTRE_PX = 0.5
"""Deviation of the centre in pixels, beside that which grows with the box."""
SQUARE = 1.5
"""Boxes up to this ratio of sides are also learnt with the front at a longer side, if there are four classes."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Vehicles:
    """n images with a vehicle each."""

    images: Image
    """(n, P, P, 3) BGR."""
    boxes: FloatArray
    """(n, 5) cx, cy, w, h, angle; the width axis points to the front."""

    def __len__(self) -> int:
        return len(self.images)

    def select(self, index: NDArray[np.integer]) -> Vehicles:
        """The vehicles at ``index``, integers (k,) in that order."""
        return Vehicles(images=self.images[index], boxes=self.boxes[index])

    @classmethod
    def join(cls, *parts: Vehicles) -> Vehicles:
        """All of several."""
        return cls(images=np.concatenate([p.images for p in parts]), boxes=np.concatenate([p.boxes for p in parts]))


@dataclass(frozen=True, slots=True, kw_only=True)
class CropBatch:
    """Crops that a network sees."""

    planes: NDArray[np.float32]
    """(n, 3, S, S) RGB, normalised."""
    label: NDArray[np.int64]
    """(n,) class: front at label · 360° / classes, clockwise on the crop from +x."""


def crops_of(
    vehicles: Vehicles, rng: np.random.Generator, *, side: int, margin: float, classes: int, light: bool
) -> CropBatch:
    """A crop of every vehicle, turned at random, its box as inexact as a detector's.

    Args:
        side: of a crop, px.
        margin: as in ``rectify``.
        classes: 2, or 4 for vehicles that may be square.
        light: whether to change brightness, colours and sharpness and mirror, as for training.
    """
    boxes, label = _turned(jittered(vehicles.boxes, rng), rng, classes)
    crops = np.concatenate(
        [rectify(image, box, side, margin) for image, box in zip(vehicles.images, boxes, strict=True)]
    )
    if light:
        crops, label = _mirrored(crops, label, rng, classes)
        crops = _lit(crops, rng)
    return CropBatch(planes=planes_of(crops), label=label)


def planes_of(crops: Image) -> NDArray[np.float32]:
    """(n, 3, S, S) RGB, normalised, of crops (n, S, S, 3) BGR."""
    planes = (crops[..., ::-1].astype(np.float32) / 255.0 - MEAN) / STD
    return np.ascontiguousarray(planes.transpose(0, 3, 1, 2))


def jittered(boxes: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Boxes (n, 5) as inexact as a detector's."""
    n = len(boxes)
    rows = boxes.copy()
    away = rng.normal(0.0, CENTRE, (n, 2)) * rows[:, 2:4] + rng.normal(0.0, CENTRE_PX, (n, 2))
    c, s = np.cos(rows[:, 4]), np.sin(rows[:, 4])
    rows[:, 0] += c * away[:, 0] - s * away[:, 1]
    rows[:, 1] += s * away[:, 0] + c * away[:, 1]
    rows[:, 2:4] *= np.exp(rng.normal(0.0, SIZE, (n, 2)))
    rows[:, 4] += rng.normal(0.0, ANGLE, n)
    return rows


def _turned(boxes: FloatArray, rng: np.random.Generator, classes: int) -> tuple[FloatArray, NDArray[np.int64]]:
    """Boxes whose width axis points anywhere, and where the front is then."""
    label = rng.integers(classes, size=len(boxes))
    if classes == 4:
        # a slim vehicle is never found the other way
        slim = np.maximum(boxes[:, 2], boxes[:, 3]) > SQUARE * np.minimum(boxes[:, 2], boxes[:, 3])
        label = np.where(slim, label // 2 * 2, label)
    turn = label * (2.0 * np.pi / classes)
    rows = boxes.copy()
    rows[:, 4] -= turn
    across = np.abs(np.sin(turn)) > 0.5
    rows[across, 2], rows[across, 3] = boxes[across, 3], boxes[across, 2]
    return rows, label


def _mirrored(
    crops: Image, label: NDArray[np.int64], rng: np.random.Generator, classes: int
) -> tuple[Image, NDArray[np.int64]]:
    """Half of the crops upside down: a front at the right stays there, one at the top goes to the bottom."""
    flip = rng.random(len(crops)) < 0.5
    crops = np.where(flip[:, None, None, None], crops[:, ::-1], crops)
    return crops, np.where(flip, -label % classes, label)


def _lit(crops: Image, rng: np.random.Generator) -> Image:
    """Another brightness, contrast and colour balance for each crop; the order of colours changed for some."""
    n = len(crops)
    gain = rng.normal(1.0, 0.1, (n, 1, 1, 3)) * rng.normal(1.0, 0.2, (n, 1, 1, 1))
    bias = rng.normal(0.0, 12.0, (n, 1, 1, 1))
    values = np.clip(crops * gain.astype(np.float32) + bias.astype(np.float32), 0, 255).astype(np.uint8)
    swapped = rng.random(n) < 0.3
    values[swapped] = values[swapped][..., rng.permutation(3)]
    return values
