"""The pool of training images, and batches out of it: turned, scaled, mirrored, in other light, in worse quality.

The pool is made by ``python -m sim.training.crops``, a process of its own: shards ``crops_*.npz`` with images (c, S, S,
3) uint8 BGR, boxes (c, N, 6) float32 (cx, cy, length, width px, heading clockwise from image up, visible share), n
(c,) and about (c, 5). New shards join while training runs.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

__all__ = ["Pool", "TrainingBatch"]

SIDE = 256
"""Side of the images that training sees, cut from larger ones."""
SCALES = (0.68, 1.6)
"""Range of the scale of a cut; at the least one it shows nearly all of a crop of 384 px."""
LEAST_LENGTH_PX, LEAST_WIDTH_PX = 8.0, 3.0
"""Smaller vehicles count neither way."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TrainingBatch:
    """What one training step sees."""

    images: Tensor
    """(B, 3, S, S) BGR, float32 in 0..1, or uint8."""
    boxes: Tensor
    """(B, N, 6) float32, see the module."""
    real: Tensor
    """(B, N) bool, False for padding."""


@dataclass(slots=True, kw_only=True)
class Pool:
    """Shards in memory."""

    folder: Path
    seen: set[str] = field(default_factory=set)
    images: list[NDArray[np.uint8]] = field(default_factory=list)
    boxes: list[NDArray[np.float32]] = field(default_factory=list)
    n: list[NDArray[np.int64]] = field(default_factory=list)
    about: list[NDArray[np.float32]] = field(default_factory=list)

    def refresh(self) -> int:
        """Take in shards that have come since; returns the number of images in all."""
        for path in sorted(self.folder.glob("crops_*.npz")):
            if path.name not in self.seen:
                with np.load(path) as shard:
                    self.images.append(shard["images"])
                    self.boxes.append(shard["boxes"])
                    self.n.append(shard["n"])
                    self.about.append(shard["about"])
                self.seen.add(path.name)
        return sum(len(n) for n in self.n)

    def batch(self, rng: np.random.Generator, size: int) -> TrainingBatch:
        """A random, augmented batch of (SIDE, SIDE) images."""
        made = []
        for _ in range(size):
            s = int(rng.integers(len(self.n)))
            r = int(rng.integers(len(self.n[s])))
            image, boxes = _cut(self.images[s][r], self.boxes[s][r, : self.n[s][r]], rng)
            made.append((_worse(image, rng), boxes))
        n = np.array([len(boxes) for _, boxes in made])
        boxes = np.zeros((size, max(int(n.max()), 1), 6), np.float32)
        for row, (_, own) in zip(boxes, made, strict=True):
            row[: len(own)] = own
        images = torch.from_numpy(np.stack([image for image, _ in made])).permute(0, 3, 1, 2).float() / 255.0
        real = np.less(np.arange(boxes.shape[1]), n[:, None])
        return TrainingBatch(images=_light(images, rng), boxes=torch.from_numpy(boxes), real=torch.from_numpy(real))

    def all(self) -> TrainingBatch:
        """Every image as it is, uint8, for evaluation."""
        images, boxes, n = np.concatenate(self.images), np.concatenate(self.boxes), np.concatenate(self.n)
        real = np.arange(boxes.shape[1]) < n[:, None]
        tensor = torch.from_numpy(images).permute(0, 3, 1, 2)
        return TrainingBatch(images=tensor, boxes=torch.from_numpy(boxes), real=torch.from_numpy(real))


def _cut(
    image: NDArray[np.uint8], boxes: NDArray[np.float32], rng: np.random.Generator
) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    """A part of an image, turned by any angle, scaled, and mirrored half of the time."""
    scale, turn = float(np.exp(rng.uniform(*np.log(SCALES)))), float(rng.uniform(0.0, 2.0 * np.pi))
    mirror = bool(rng.random() < 0.5)
    side = image.shape[0]
    room = max(0.5 * side - 0.5 * SIDE / scale, 0.0)
    focus = 0.5 * side + rng.uniform(-1.0, 1.0, 2) * room
    # p' = s R (p − focus) + ½ SIDE, R clockwise on the screen; mirrored: x → −x first
    c, s = np.cos(turn), np.sin(turn)
    A = scale * np.array([[c, -s], [s, c]]) @ np.diag([-1.0 if mirror else 1.0, 1.0])
    b = 0.5 * SIDE - A @ focus
    # whole pixel coordinates are the middles of pixels for OpenCV: u = x − ½
    M = np.column_stack([A, b + A @ (0.5, 0.5) - 0.5])
    border = tuple(int(v) for v in rng.integers(0, 256, 3))
    flags = cv2.INTER_CUBIC if scale > 1.15 else cv2.INTER_LINEAR
    out = cv2.warpAffine(image, M, (SIDE, SIDE), flags=flags, borderMode=cv2.BORDER_CONSTANT, borderValue=border)
    moved = boxes.copy()
    moved[:, :2] = boxes[:, :2] @ A.T + b
    moved[:, 2:4] *= scale
    moved[:, 4] = turn + (-boxes[:, 4] if mirror else boxes[:, 4])
    moved[:, 5] *= _share_inside(moved)
    moved[(moved[:, 2] < LEAST_LENGTH_PX) | (moved[:, 3] < LEAST_WIDTH_PX), 5] = 0.0
    inside = ((moved[:, :2] > 0.0) & (moved[:, :2] < SIDE)).all(axis=1)
    return np.asarray(out, np.uint8), moved[inside]


def _share_inside(boxes: NDArray[np.float32]) -> NDArray[np.float32]:
    """(n,) share of each box within the image."""
    a, c = np.meshgrid(np.linspace(-0.45, 0.45, 7), np.linspace(-0.4, 0.4, 3))
    cx, cy, length, width, heading = boxes[:, :5].T[..., None, None]
    u = cx + a * length * np.sin(heading) + c * width * np.cos(heading)
    v = cy - a * length * np.cos(heading) + c * width * np.sin(heading)
    return np.asarray(((u > 0.0) & (v > 0.0) & (u < SIDE) & (v < SIDE)).mean(axis=(1, 2)), np.float32)


def _worse(image: NDArray[np.uint8], rng: np.random.Generator) -> NDArray[np.uint8]:
    """Now and then noise, blur, sharpening or compression, as scaling has softened what the pool had of them."""
    kind = rng.random()
    if kind < 0.15:
        image = np.asarray(cv2.GaussianBlur(image, (0, 0), float(rng.uniform(0.4, 1.1))), np.uint8)
    elif kind < 0.4:
        blurred = cv2.GaussianBlur(image, (0, 0), float(rng.uniform(0.6, 1.5)))
        amount = float(rng.uniform(0.3, 1.5))
        image = np.asarray(cv2.addWeighted(image, 1.0 + amount, blurred, -amount, 0.0), np.uint8)
    if rng.random() < 0.2:
        noise = rng.normal(0.0, float(rng.uniform(1.0, 9.0)), (SIDE, SIDE, 1)).astype(np.float32)
        image = np.clip(image + noise, 0, 255).astype(np.uint8)
    if rng.random() < 0.2:
        packed = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, int(rng.integers(30, 95))])[1]
        image = np.asarray(cv2.imdecode(packed, cv2.IMREAD_COLOR), np.uint8)
    return image


def _light(images: Tensor, rng: np.random.Generator) -> Tensor:
    """Another brightness, contrast and colour balance for each image, another order of colours for some."""
    size = len(images)
    gain = torch.from_numpy(rng.normal(1.0, 0.06, (size, 3, 1, 1)) * rng.normal(1.0, 0.18, (size, 1, 1, 1))).float()
    bias = torch.from_numpy(rng.normal(0.0, 0.06, (size, 1, 1, 1))).float()
    images = images * gain + bias
    if rng.random() < 0.15:
        images = images[:, torch.from_numpy(rng.permutation(3))]
    return images.clamp(0.0, 1.0)
