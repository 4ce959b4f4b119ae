"""Train the bundled front classifier on rendered vehicles.

``python -m training.fronts.renders --seed 0 --out .train/fronts``

Images come from ``pool`` and ``held_out`` in the folder; where they are missing, ``python -m
training.rendered.front_crops`` is run for them. A stopped run continues. Writes checkpoint.pt, learning.csv and .png,
quality.csv and front.onnx.
"""

from __future__ import annotations

import argparse
import logging
import subprocess
import sys
from pathlib import Path

import numpy as np
import torch

from training.fronts.learn import TrainingPlan, draw_curve, learn, save
from training.fronts.quality import quality, write_quality
from training.fronts.resnet import ResNet18, load_weights
from training.fronts.vehicles import Vehicles

log = logging.getLogger(__name__)
HELD_OUT_SEED = 900_000
"""First shard of the held-out crops: training begins at 1000 × seed, so no seed below 900 has them among its own."""


def read_shards(folder: Path) -> Vehicles:
    """All shards of a folder as ``python -m training.rendered.front_crops`` writes them."""
    parts = []
    for path in sorted(folder.glob("fronts_*.npz")):
        with np.load(path) as shard:
            boxes = shard["boxes"].astype(np.float64)
            # the width axis points to the front: angle = heading − π/2
            boxes[:, 4] -= 0.5 * np.pi
            parts.append(Vehicles(images=shard["images"], boxes=boxes))
    return Vehicles.join(*parts)


def _render(folder: Path, seed: int, shards: int) -> Vehicles:
    command = [sys.executable, "-m", "training.rendered.front_crops", "--out", str(folder), "--seed", str(seed)]
    subprocess.run([*command, "--shards", str(shards)], check=True)
    return read_shards(folder)


def run(out: Path, plan: TrainingPlan, shards: int, weights: Path | None) -> None:
    """Render what is missing, train, export, measure."""
    held_out = _render(out / "held_out", HELD_OUT_SEED, 2)
    vehicles = _render(out / "pool", 1000 * plan.seed, shards)
    torch.manual_seed(plan.seed)
    net = ResNet18(plan.classes)
    if weights is not None:
        load_weights(net, weights)
    learn(net, vehicles, held_out, plan, out)
    draw_curve(out)
    save(net, plan, f"{len(vehicles)} rendered vehicles", out / "front.onnx")
    write_quality(out / "quality.csv", quality(out / "front.onnx", held_out, held_out.boxes[:, 2]))


def main() -> None:
    """Train from the command line."""
    parser = argparse.ArgumentParser(description="Train the bundled front classifier on renders.")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--steps", type=int, default=1800)
    parser.add_argument("--shards", type=int, default=24, help="of 1000 vehicles each")
    parser.add_argument("--weights", type=Path, help="start from these, .onnx or torchvision's .pth")
    parser.add_argument("--rate", type=float, default=1e-3, help="peak of the learning rate")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path(".train/fronts"))
    args = parser.parse_args()
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(message)s")
    torch.set_num_threads(args.threads)
    plan = TrainingPlan(seed=args.seed, steps=args.steps, rate=args.rate, classes=4)
    run(args.out, plan, args.shards, args.weights)


if __name__ == "__main__":
    main()
