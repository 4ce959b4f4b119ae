"""The training of a front classifier: the same steps whether it learns from renders or from crops of one's own."""

from __future__ import annotations

import logging
import math
import time
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import onnx
import torch
from numpy.typing import NDArray
from torch import Tensor

from training.curves import plot, read_columns
from training.fronts.export import metadata, to_onnx
from training.fronts.resnet import ResNet18
from training.fronts.vehicles import CropBatch, Vehicles, crops_of
from training.train import append_row

log = logging.getLogger(__name__)
WARM_UP = 0.05
"""Share of the steps in which the learning rate rises to its full value; a choice."""
SMOOTHING = 0.02
"""Smoothing of the labels; some are wrong."""
WEIGHT_DECAY = 0.05
"""Weight decay of AdamW; a usual choice."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TrainingPlan:
    """Settings that determine a run."""

    seed: int = 0
    steps: int = 2400
    batch: int = 64
    rate: float = 1e-3
    """Peak of the learning rate."""
    side: int = 64
    margin: float = 0.15
    classes: int = 2
    every: int = 200
    """Steps between evaluations on the held-out vehicles, each with a checkpoint."""


def learn(net: ResNet18, vehicles: Vehicles, held_out: Vehicles, plan: TrainingPlan, out: Path) -> None:
    """Train a network in place; writes ``checkpoint.pt`` and ``learning.csv`` and continues from the former.

    Every step draws from a generator seeded by the seed and the step's number, so a stopped run continues as if
    it had not been.
    """
    optimiser = torch.optim.AdamW(net.parameters(), lr=plan.rate, weight_decay=WEIGHT_DECAY)
    checkpoint, done = out / "checkpoint.pt", 0
    if checkpoint.exists():
        state = torch.load(checkpoint, map_location="cpu", weights_only=True)
        net.load_state_dict(state["net"])
        optimiser.load_state_dict(state["optimiser"])
        done = int(state["steps"])
        log.info("goes on from step %d", done)
    net.to(memory_format=torch.channels_last)
    seen = _Mean()
    for step in range(done, plan.steps):
        rng = np.random.default_rng([plan.seed, step])
        batch = _batch(vehicles.select(rng.integers(len(vehicles), size=plan.batch)), rng, plan, light=True)
        seen.add(*_step(net, optimiser, batch, plan.rate * _pace(step / plan.steps)))
        if (step + 1) % plan.every == 0 or step + 1 == plan.steps:
            part = checkpoint.with_suffix(".part")
            torch.save({"net": net.state_dict(), "optimiser": optimiser.state_dict(), "steps": step + 1}, part)
            part.replace(checkpoint)
            _note(net, held_out, plan, out, step + 1, seen)
            seen = _Mean()
    net.eval()


def logits_of(
    net: ResNet18, vehicles: Vehicles, plan: TrainingPlan, seed: int = 0
) -> tuple[NDArray[np.float32], CropBatch]:
    """(n, classes) of one jittered crop of every vehicle, the same for the same seed; and those crops."""
    batch = _batch(vehicles, np.random.default_rng([seed, 1]), plan, light=False)
    net.eval()
    with torch.no_grad():
        parts = [net(torch.from_numpy(batch.planes[k : k + 64])) for k in range(0, len(vehicles), 64)]
    return torch.cat(parts).numpy(), batch


def save(net: ResNet18, plan: TrainingPlan, trained_on: str, path: Path) -> None:
    """Write a trained network as a model for ``vision.detect.front``."""
    weights = {name: value.numpy() for name, value in net.state_dict().items()}
    notes = metadata(plan.seed, plan.classes, plan.margin, trained_on)
    onnx.save(to_onnx(weights, plan.side, notes), str(path))


def draw_curve(folder: Path) -> None:
    """``learning.csv`` as ``learning.png``."""
    column = read_columns(folder / "learning.csv")
    steps, loss = column["step"], column["loss"]
    left = plot("loss", steps, {"training": loss}, (0.0, float(loss.max())))
    right = plot("right fronts", steps, {"training": column["accuracy"], "held out": column["held_out"]}, (0.0, 1.0))
    cv2.imwrite(str(folder / "learning.png"), np.hstack([left, right]))


class _Mean:
    """Mean loss and accuracy since the last evaluation."""

    def __init__(self) -> None:
        self.loss, self.right, self.n, self.start_s = 0.0, 0, 0, time.monotonic()

    def add(self, loss: float, right: int, n: int) -> None:
        self.loss, self.right, self.n = self.loss + loss * n, self.right + right, self.n + n


def _batch(vehicles: Vehicles, rng: np.random.Generator, plan: TrainingPlan, *, light: bool) -> CropBatch:
    return crops_of(vehicles, rng, side=plan.side, margin=plan.margin, classes=plan.classes, light=light)


def _pace(progress: float) -> float:
    """Share of the peak learning rate: a warm-up, then half a cosine."""
    return min(1.0, (progress + 1e-3) / WARM_UP) * (0.5 + 0.5 * math.cos(math.pi * progress))


def _step(net: ResNet18, optimiser: torch.optim.Optimizer, batch: CropBatch, rate: float) -> tuple[float, int, int]:
    for group in optimiser.param_groups:
        group["lr"] = rate
    net.train()
    planes = torch.from_numpy(batch.planes).to(memory_format=torch.channels_last)
    label = torch.from_numpy(batch.label)
    with torch.autocast("cpu", dtype=torch.bfloat16):
        logits: Tensor = net(planes)
    loss = torch.nn.functional.cross_entropy(logits.float(), label, label_smoothing=SMOOTHING)
    optimiser.zero_grad(set_to_none=True)
    loss.backward()
    optimiser.step()
    return float(loss.detach()), int((logits.argmax(dim=1) == label).sum()), len(label)


def _note(net: ResNet18, held_out: Vehicles, plan: TrainingPlan, out: Path, step: int, seen: _Mean) -> None:
    logits, batch = logits_of(net, held_out, plan)
    right = float((logits.argmax(axis=1) == batch.label).mean()) if len(held_out) else math.nan
    row = {"step": step, "loss": seen.loss / seen.n, "accuracy": seen.right / seen.n, "held_out": right}
    append_row(out / "learning.csv", row)
    took = (time.monotonic() - seen.start_s) / seen.n * 1e3
    log.info("step %d: loss %.4f, right %.4f, held out %.4f; %.1f ms a crop", step, *list(row.values())[1:], took)
