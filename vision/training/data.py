"""The pool of training pictures, and batches out of it with turns, mirrors and changes of light.

The pool is made by ``python -m sim.crops``, a process of its own: shards ``crops_*.npz`` with images (c, S, S, 3) uint8
BGR, boxes (c, 24, 6) float32 (cx, cy, length, width px, heading clockwise from image up, weight) and n (c,). New shards
join while training runs.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

__all__ = ["Batch", "Pool"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Batch:
    """What one training step sees."""

    images: Tensor
    """(B, 3, S, S) float32 BGR in 0..1."""
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

    def refresh(self) -> int:
        """Take in shards that have come since; returns the number of pictures in all."""
        for path in sorted(self.folder.glob("crops_*.npz")):
            if path.name not in self.seen:
                with np.load(path) as shard:
                    self.images.append(shard["images"])
                    self.boxes.append(shard["boxes"])
                    self.n.append(shard["n"])
                self.seen.add(path.name)
        return sum(len(n) for n in self.n)

    def batch(self, rng: np.random.Generator, size: int) -> Batch:
        """A random, augmented batch."""
        shard = rng.integers(len(self.n), size=size)
        row = [int(rng.integers(len(self.n[s]))) for s in shard]
        images = np.stack([self.images[s][r] for s, r in zip(shard, row, strict=True)])
        boxes = np.stack([self.boxes[s][r] for s, r in zip(shard, row, strict=True)])
        n = np.array([self.n[s][r] for s, r in zip(shard, row, strict=True)])
        boxes = boxes[:, : max(int(n.max()), 1)]
        images, boxes = _turn(images, boxes, int(rng.integers(4)), bool(rng.random() < 0.5))
        light = _light(torch.from_numpy(images).permute(0, 3, 1, 2).float() / 255.0, rng)
        real = np.less(np.arange(boxes.shape[1]), n[:, None])
        return Batch(images=light, boxes=torch.from_numpy(boxes), real=torch.from_numpy(real))

    def all(self) -> Batch:
        """Every picture as it is, for evaluation."""
        images, boxes, n = np.concatenate(self.images), np.concatenate(self.boxes), np.concatenate(self.n)
        real = np.arange(boxes.shape[1]) < n[:, None]
        tensor = torch.from_numpy(images).permute(0, 3, 1, 2).float() / 255.0
        return Batch(images=tensor, boxes=torch.from_numpy(boxes), real=torch.from_numpy(real))


def _turn(
    images: NDArray[np.uint8], boxes: NDArray[np.float32], quarters: int, mirror: bool
) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    """Turn a batch anticlockwise by quarters, then mirror it left to right."""
    side = images.shape[1]
    images, boxes = np.rot90(images, quarters, axes=(1, 2)), boxes.copy()
    for _ in range(quarters):
        # a quarter anticlockwise: (x, y) → (y, side − x), heading − π/2
        boxes[..., 0], boxes[..., 1] = boxes[..., 1].copy(), side - boxes[..., 0]
        boxes[..., 4] -= np.pi / 2.0
    if mirror:
        images = images[:, :, ::-1]
        boxes[..., 0] = side - boxes[..., 0]
        boxes[..., 4] = -boxes[..., 4]
    return np.ascontiguousarray(images), boxes


def _light(images: Tensor, rng: np.random.Generator) -> Tensor:
    """Another brightness and colour balance for each picture, another order of colours for the batch."""
    size = len(images)
    gain = torch.from_numpy(rng.normal(1.0, 0.12, (size, 3, 1, 1)) * rng.normal(1.0, 0.15, (size, 1, 1, 1))).float()
    bias = torch.from_numpy(rng.normal(0.0, 0.04, (size, 1, 1, 1))).float()
    images = images * gain + bias
    if rng.random() < 0.3:
        images = images[:, torch.from_numpy(rng.permutation(3))]
    return images.clamp(0.0, 1.0)
