"""Training images, and batches out of them: turned, scaled, mirrored, in other light, in worse quality.

They are cut from photographs (``training.photographs``) and from the pool of rendered images, which ``python -m
training.rendered.crops`` makes, a process of its own: shards ``crops_*.npz`` with images (c, S, S, 3) uint8 BGR, boxes
(c, N, 6) float32 (cx, cy, length, width px, heading clockwise from image up, visible share), n (c,) and about (c, 5).
New shards join while training runs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from training.cuts import SIDE, Known, TrainingSample, cut, rendered_sample, worsen
from training.net import STRIDE
from training.photographs import Photographs

SWAPPED_SHARE, GREY_SHARE, NEGATIVE_SHARE = 0.12, 0.12, 0.5
"""Shares of images: colours that change places, colours that are lost and, of these, negatives: cameras for daylight
may see but grey, and for warmth what is warm either dark or light. A choice."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TrainingBatch:
    """Batch that one training step sees."""

    images: Tensor
    """(B, 3, S, S) BGR, uint8."""
    boxes: Tensor
    """(B, N, 6) float32, see the module."""
    real: Tensor
    """(B, N) bool, False for padding."""
    known: Tensor
    """(B, N) int64 of ``training.cuts.Known``."""
    unjudged: Tensor
    """(B, S / STRIDE, S / STRIDE) bool, True in cells that may hold a vehicle without a label."""

    def values(self) -> Tensor:
        """(B, 3, S, S) float32 in 0..1, as the network takes images."""
        return self.images.float() / 255.0

    def to(self, device: str) -> TrainingBatch:
        """The same on another device."""
        return TrainingBatch(
            images=self.images.to(device, memory_format=torch.channels_last),
            boxes=self.boxes.to(device),
            real=self.real.to(device),
            known=self.known.to(device),
            unjudged=self.unjudged.to(device),
        )


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

    def samples(self, count: int, rng: np.random.Generator) -> list[TrainingSample]:
        """Random images."""
        made = []
        for _ in range(count):
            s = int(rng.integers(len(self.n)))
            r = int(rng.integers(len(self.n[s])))
            tilt = float(self.about[s][r, 0])
            made.append(rendered_sample(self.images[s][r], self.boxes[s][r, : self.n[s][r]], tilt))
        return made

    def all(self) -> TrainingBatch:
        """Every image as it is, uint8, for evaluation."""
        images, boxes, n = np.concatenate(self.images), np.concatenate(self.boxes), np.concatenate(self.n)
        real = np.arange(boxes.shape[1]) < n[:, None]
        side = images.shape[1] // STRIDE
        return TrainingBatch(
            images=torch.from_numpy(images).permute(0, 3, 1, 2),
            boxes=torch.from_numpy(boxes),
            real=torch.from_numpy(real),
            known=torch.full(real.shape, int(Known.FRONT)),
            unjudged=torch.zeros((len(images), side, side), dtype=torch.bool),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Mixture:
    """Sources of training images in given shares; the batch of a step depends on the seed and the step alone."""

    rendered: Pool
    photographs: Sequence[tuple[Photographs, float]]
    """Each with its share of the images; what is left is rendered."""
    seed: int

    def batch(self, step: int, size: int) -> TrainingBatch:
        """A random, augmented batch of (SIDE, SIDE) images."""
        rng = np.random.default_rng([self.seed, step])
        shares = [share for _, share in self.photographs]
        counts = rng.multinomial(size, [*shares, max(1.0 - sum(shares), 0.0)])
        samples = self.rendered.samples(int(counts[-1]), rng)
        for (source, _), count in zip(self.photographs, counts, strict=False):
            samples += source.samples(step, int(count), rng)
        return batch_samples([cut(sample, rng) for sample in samples], rng)


def batch_samples(samples: Sequence[TrainingSample], rng: np.random.Generator) -> TrainingBatch:
    """Cut samples in other light and worse quality, as tensors."""
    n = np.array([len(sample.boxes) for sample in samples])
    boxes = np.zeros((len(samples), max(int(n.max()), 1), 6), np.float32)
    known = np.zeros(boxes.shape[:2], np.int64)
    unjudged = np.zeros((len(samples), SIDE // STRIDE, SIDE // STRIDE), np.uint8)
    for i, sample in enumerate(samples):
        boxes[i, : n[i]], known[i, : n[i]] = sample.boxes, sample.known
        for area in sample.unjudged:
            cv2.fillConvexPoly(unjudged[i], np.rint(area / STRIDE - 0.5).astype(np.int32), 1)
    images = np.stack([_light(worsen(sample.image, rng), rng) for sample in samples])
    return TrainingBatch(
        images=torch.from_numpy(images).permute(0, 3, 1, 2),
        boxes=torch.from_numpy(boxes),
        real=torch.from_numpy(np.less(np.arange(boxes.shape[1]), n[:, None])),
        known=torch.from_numpy(known),
        unjudged=torch.from_numpy(unjudged).bool(),
    )


def _light(image: NDArray[np.uint8], rng: np.random.Generator) -> NDArray[np.uint8]:
    """Another brightness, contrast and colour balance; for some another order of colours, or none."""
    kind = rng.random()
    grey = kind < GREY_SHARE
    if grey:
        shares = rng.dirichlet((2.0, 2.0, 2.0)).astype(np.float32)
        image = np.asarray(cv2.transform(image, np.tile(shares, (3, 1))), np.uint8)
    elif kind < GREY_SHARE + SWAPPED_SHARE:
        image = image[..., rng.permutation(3)]
    gain = rng.normal(1.0, 0.18) * (1.0 if grey else rng.normal(1.0, 0.06, 3))
    values = np.arange(256.0)[:, None] if kind >= NEGATIVE_SHARE * GREY_SHARE else 255.0 - np.arange(256.0)[:, None]
    table = np.clip(values * gain + 255.0 * rng.normal(0.0, 0.06) + 0.5, 0, 255) * np.ones(3)
    return np.asarray(cv2.LUT(np.ascontiguousarray(image), table.astype(np.uint8)[None]), np.uint8)
