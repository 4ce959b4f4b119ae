"""Train the bundled detector on rendered images, and on labelled photographs beside them.

``python -m training.train --seed 0 --steps 12000 --out .train/ --photographs FOLDER=0.25``

Images come from ``.train/pool`` and, for evaluation, ``.train/held_out``; where they are missing, ``python -m
training.rendered.crops`` is run for them, and training starts with the first shard. A stopped run continues from its
checkpoint; ``--steps`` counts over all runs, and so does ``--minutes``, with which the learning rate falls with the
time spent instead. Writes checkpoint.pt, loss.csv, quality.csv, curves.png and model.onnx
into the folder.
"""

from __future__ import annotations

import argparse
import csv
import logging
import math
import os
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from itertools import pairwise
from pathlib import Path
from typing import IO

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.utils.data import DataLoader, Dataset

from training.curves import draw_curves
from training.data import Mixture, Pool, TrainingBatch
from training.export import PRECISION, export, read_weights, restore_statistics
from training.loss import losses
from training.net import CHANNELS, STRIDE, Net, scores
from training.photographs import MINING_SCORE, open_photographs
from training.quality import Quality, measure, score_at_precision
from vision.detect.decode_heatmap import decode
from vision.detect.detections import Detections
from vision.detect.detector import open_detector
from vision.evaluation import choose_in_all, open_folder

log = logging.getLogger(__name__)
BATCH = 16
"""Images of one step, unless another number is given; a choice."""
WARM_UP_STEPS = 200
"""Steps in which the learning rate rises to its full value; a choice."""
AVERAGE_STEPS = 1000
"""Steps over which the running average of the weights goes; a choice."""
HELD_OUT_SEED = 900_000
"""Shard of the held-out crops: training begins at 1000 × seed, so no seed below 900 has them among its own."""
PHOTOGRAPHS_SHARE = 0.25
"""Share of the images of a step that are cut from a folder of photographs, unless another is given; a choice."""
STATISTICS_IMAGES = 64
"""Images over which statistics of batch norms are taken where a model file has none; a choice."""
_MIN_SCORE = 0.05
"""Score from which boxes are kept: low, so that quality can be measured at any threshold above it."""
PER_SHARD, HELD_OUT_CROPS = 250, 500
"""Crops in a file of training data, and those held out."""


class Trainer:
    """The state of a run: weights, their running average, optimiser, time spent."""

    def __init__(self, seed: int, device: str, rate: float) -> None:
        torch.manual_seed(seed)
        self.rate = rate
        self.warm_up_steps, self.average_steps = WARM_UP_STEPS, AVERAGE_STEPS
        self.device = device
        self.net = Net().to(device, memory_format=torch.channels_last)
        self.average: dict[str, Tensor] = {k: v.detach().clone() for k, v in self.net.state_dict().items()}
        decay = [p for p in self.net.parameters() if p.ndim > 1]
        plain = [p for p in self.net.parameters() if p.ndim <= 1]
        groups = [{"params": decay, "weight_decay": 0.02}, {"params": plain, "weight_decay": 0.0}]
        self.optimiser = torch.optim.AdamW(groups, lr=rate, fused=device == "cuda")
        self.step_count = 0
        self.spent_s = 0.0

    def step(self, batch: TrainingBatch, progress: float) -> dict[str, Tensor | float]:
        """One update; ``progress`` 0..1 sets the learning rate: a warm-up, then half a cosine."""
        warm = min(1.0, (self.step_count + 1) / self.warm_up_steps)
        rate = self.rate * warm * (0.5 + 0.5 * math.cos(math.pi * min(progress, 1.0))) + 1e-6
        for group in self.optimiser.param_groups:
            group["lr"] = rate
        self.net.train()
        batch = batch.to(self.device)
        with torch.autocast(self.device, dtype=torch.bfloat16, enabled=_has_half_floats(self.device)):
            cells = self.net(batch.values())
        parts = losses(cells.float(), batch)
        total = parts.total()
        self.optimiser.zero_grad(set_to_none=True)
        total.backward()
        torch.nn.utils.clip_grad_norm_(self.net.parameters(), 10.0)
        self.optimiser.step()
        self.step_count += 1
        self._average()
        # read where they are written down alone: to read a value waits for the GPU
        values = {name: value.detach() for name, value in _parts(parts).items()}
        return {"step": self.step_count, "rate": rate, "total": total.detach(), **values}

    def start_from(self, path: Path, images: Tensor) -> None:
        """Begin with a model file, or with the averaged weights of another run; blocks that it has not keep their own.

        Args:
            path: a ``.onnx`` file of ours, or a checkpoint.
            images: (B, 3, H, W) as in training, which tell the statistics that a model file has not.

        Raises:
            RuntimeError, ModelError: it is of another shape.
        """
        if path.suffix == ".onnx":
            net = Net()
            read_weights(net, path)
            restore_statistics(net, images)
            weights = net.state_dict()
        else:
            weights = torch.load(path, map_location=self.device, weights_only=True)["average"]
        self.net.load_state_dict({**self.net.state_dict(), **weights})
        self.average = {k: v.detach().clone() for k, v in self.net.state_dict().items()}

    def averaged(self) -> Net:
        """The network with averaged weights, on the CPU."""
        net = Net()
        net.load_state_dict({k: v.cpu() for k, v in self.average.items()})
        return net

    def save(self, path: Path) -> None:
        """Write all that is needed to continue, or nothing."""
        part = path.with_suffix(".part")
        state = {
            "net": self.net.state_dict(),
            "average": self.average,
            "optimiser": self.optimiser.state_dict(),
            "step_count": self.step_count,
            "spent_s": self.spent_s,
        }
        torch.save(state, part)
        part.replace(path)

    def load(self, path: Path) -> None:
        """Continue from a checkpoint."""
        state = torch.load(path, map_location=self.device, weights_only=True)
        self.net.load_state_dict(state["net"])
        self.average = state["average"]
        self.optimiser.load_state_dict(state["optimiser"])
        self.step_count, self.spent_s = int(state["step_count"]), float(state["spent_s"])

    def _average(self) -> None:
        keep = 1.0 - 1.0 / min(self.average_steps, self.step_count + 1)
        weights = self.net.state_dict()
        real = [name for name, value in weights.items() if value.is_floating_point()]
        torch._foreach_lerp_([self.average[name] for name in real], [weights[name] for name in real], 1.0 - keep)
        for name in weights.keys() - set(real):
            self.average[name].copy_(weights[name])


def _has_half_floats(device: str) -> bool:
    """Tell whether it computes with them: twice as fast as floats; a processor without takes 2.5 times as long."""
    told = getattr(torch.cpu, "get_capabilities", None)
    return device == "cuda" or bool(told and told().get("avx512_bf16"))


def best_device() -> str:
    """The name of what torch computes on here."""
    return "cuda" if torch.cuda.is_available() else "cpu"


def run(
    out: Path,
    *,
    seed: int,
    steps: int,
    rate: float,
    minutes: float,
    threads: int,
    batch: int,
    workers: int,
    crops: int,
    renderers: int,
    check_every: int,
    start: Path | None,
    photographs: Sequence[tuple[Path, float]],
) -> None:
    """Train until the steps are done or the minutes over, then export."""
    torch.set_num_threads(threads)
    cv2.setNumThreads(1)
    pool, held_out = Pool(folder=out / "pool"), Pool(folder=out / "held_out")
    makers = _render_missing(out, crops, seed, renderers)
    checkpoint = out / "checkpoint.pt"
    trainer = Trainer(seed, best_device(), rate)
    miner = open_detector(start if start and start.suffix == ".onnx" else None, score=MINING_SCORE, threads=threads)
    sources = [
        (open_photographs(choose_in_all(open_folder(folder).images)[0], miner, seed), share)
        for folder, share in photographs
    ]
    _await(pool, makers)
    mixture = Mixture(rendered=pool, photographs=sources, seed=seed)
    if checkpoint.exists():
        trainer.load(checkpoint)
        log.info("goes on from step %d after %.1f min", trainer.step_count, trainer.spent_s / 60.0)
    elif start is not None:
        trainer.start_from(start, mixture.batch(0, STATISTICS_IMAGES).values())

    def progress() -> float:
        return max(trainer.step_count / steps, trainer.spent_s / (60.0 * minutes))

    while progress() < 1.0:
        begun, tick = trainer.spent_s, time.monotonic()
        # what was rendered meanwhile joins after each look at the held-out images
        until = min(steps, (trainer.step_count // check_every + 1) * check_every)
        for training in batches(mixture, range(trainer.step_count, until), batch, workers):
            row = trainer.step(training, progress())
            trainer.spent_s = begun + time.monotonic() - tick
            done = progress() >= 1.0
            if done or trainer.step_count % 50 == 0:
                append_row(out / "loss.csv", row)
            if done:
                break
        _check(trainer, held_out, out, pool.refresh())
    _await(held_out, makers)
    score = score_at_precision(*detections_and_truth(trainer.averaged(), held_out.all()), PRECISION)
    log.info("%.0f %% of detections are right from score %.3f on", 100.0 * PRECISION, score)
    export(checkpoint, out / "model.onnx", version="7", score=score)
    draw_curves(out)
    for maker in makers:
        # what it has not rendered yet comes too late
        maker.terminate()
        maker.wait()


def evaluate(net: Net, batch: TrainingBatch) -> Quality:
    """Run a network over a batch and measure it."""
    return measure(*detections_and_truth(net, batch))


def detections_and_truth(
    net: Net, batch: TrainingBatch, chunk: int = 32
) -> tuple[list[Detections], list[NDArray[np.float64]]]:
    """Detections of a network on each image of a batch, ``chunk`` at a time, and the true boxes of each image."""
    net.eval()
    device = next(net.parameters()).device
    found: list[Detections] = []
    with torch.no_grad():
        for start in range(0, len(batch.images), chunk):
            out = net(batch.images[start : start + chunk].to(device).float() / 255.0)
            cells = torch.cat([scores(out), out[:, 1:CHANNELS]], dim=1).cpu().numpy()
            found += [decode(c, STRIDE, _MIN_SCORE) for c in cells]
    truth = [b[r].astype(np.float64) for b, r in zip(batch.boxes.numpy(), batch.real.numpy(), strict=True)]
    return found, truth


def _await(pool: Pool, makers: Sequence[subprocess.Popen[bytes]]) -> None:
    """Wait for a first shard."""
    while pool.refresh() == 0:
        if any(maker.poll() not in (None, 0) for maker in makers):
            raise RuntimeError(
                f"{pool.folder}: no images were made; "
                f"run python -m training.rendered.crops --out {pool.folder} to see why"
            )
        time.sleep(1.0)


def batches(mixture: Mixture, steps: range, size: int = BATCH, workers: int = 0) -> Iterator[TrainingBatch]:
    """The batch of each step, later ones made while one is learnt from.

    Args:
        mixture: where they come from, as it is now: processes do not see shards that join later.
        steps: numbers of the steps.
        workers: processes that make them, each with a share of the memory that images take; 0: a thread of this one.
    """
    if workers:
        yield from DataLoader(
            _Steps(mixture, size), sampler=list(steps), batch_size=None, num_workers=workers, prefetch_factor=4
        )
        return
    with ThreadPoolExecutor(1) as maker:
        coming = [maker.submit(mixture.batch, step, size) for step in steps[:1]]
        for step in steps:
            batch = coming.pop().result()
            coming += [maker.submit(mixture.batch, after, size) for after in (step + 1,) if after in steps]
            yield batch


class _Steps(Dataset[TrainingBatch]):  # type: ignore[misc]  # torch is not typed here
    """The batches of a mixture by the number of the step."""

    def __init__(self, mixture: Mixture, size: int) -> None:
        self._mixture, self._size = mixture, size

    def __getitem__(self, step: int) -> TrainingBatch:
        return self._mixture.batch(step, self._size)


def _check(trainer: Trainer, held_out: Pool, out: Path, images: int) -> None:
    trainer.save(out / "checkpoint.pt")
    if held_out.refresh() == 0:
        return  # still rendered
    quality = asdict(evaluate(trainer.averaged().to(trainer.device), held_out.all()))
    append_row(out / "quality.csv", {"step": trainer.step_count, "minutes": trainer.spent_s / 60.0, **quality})
    figures = " ".join(f"{name} {value:.4f}" for name, value in quality.items())
    log.info("%.1f min, step %d, %d images: %s", trainer.spent_s / 60.0, trainer.step_count, images, figures)


def _render_missing(out: Path, crops: int, seed: int, renderers: int) -> list[subprocess.Popen[bytes]]:
    """Render what is missing beside the training, in this many processes."""
    jobs, shards = [], crops // PER_SHARD
    if not any((out / "held_out").glob("crops_*.npz")):
        jobs.append(render_crops(out / "held_out", HELD_OUT_SEED, 1, HELD_OUT_CROPS))
    if len(list((out / "pool").glob("crops_*.npz"))) < shards:
        first = [shards * k // renderers for k in range(renderers + 1)]
        jobs += [render_crops(out / "pool", 1000 * seed + a, b - a, PER_SHARD) for a, b in pairwise(first)]
    return jobs


def render_crops(
    folder: Path, seed: int, shards: int, per_shard: int, words: IO[bytes] | None = None
) -> subprocess.Popen[bytes]:
    """Begin to render shards of crops, in a process of its own; those that exist are left as they are.

    Args:
        seed: of the first shard; the others follow.
        words: where what it prints goes, else where this process's goes.
    """
    numbers = ("--seed", str(seed), "--shards", str(shards), "--per-shard", str(per_shard))
    command = [sys.executable, "-m", "training.rendered.crops", "--out", str(folder), *numbers]
    path = os.pathsep.join(sys.path)  # where this package is found
    found = os.environ | {"PYTHONPATH": path}
    return subprocess.Popen(command, stdout=words, stderr=words, start_new_session=words is not None, env=found)


def _parts(parts: object) -> dict[str, Tensor]:
    return {name: getattr(parts, name) for name in ("score", "offset", "size", "front", "axis", "judge")}


def append_row(path: Path, row: Mapping[str, Tensor | float]) -> None:
    """Append numbers to a csv file, which begins with their names."""
    new = not path.exists()
    with path.open("a", newline="") as file:
        writer = csv.DictWriter(file, list(row))
        if new:
            writer.writeheader()
        writer.writerow({k: f"{float(v):.6g}" for k, v in row.items()})


def _folder_and_share(text: str) -> tuple[Path, float]:
    folder, _, share = text.rpartition("=")
    try:
        return (Path(folder), float(share)) if folder else (Path(text), PHOTOGRAPHS_SHARE)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text!r}: {share!r} is no share between 0 and 1") from error


def main() -> None:
    """Train from the command line."""
    parser = argparse.ArgumentParser(description="Train the bundled oriented detector.")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--steps", type=int, default=12000, help="training steps over all runs")
    parser.add_argument("--minutes", type=float, default=math.inf, help="of training, over all runs, at most")
    parser.add_argument("--out", type=Path, default=Path(".train"))
    parser.add_argument("--rate", type=float, default=3e-3, help="highest learning rate")
    parser.add_argument("--start", type=Path, help="checkpoint or .onnx whose weights to begin with")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--batch", type=int, default=BATCH, help="images of a step; a GPU wants 128")
    parser.add_argument("--workers", type=int, default=0, help="processes that cut images; a GPU needs a dozen")
    parser.add_argument("--crops", type=int, default=8000, help="images to render")
    parser.add_argument("--renderers", type=int, default=1, help="processes that render")
    parser.add_argument("--check-every", type=int, default=1000, help="steps between looks at the held-out images")
    parser.add_argument(
        "--photographs",
        type=_folder_and_share,
        action="append",
        default=[],
        metavar="FOLDER[=SHARE]",
        help=f"labelled photographs, and their share of the images (else {PHOTOGRAPHS_SHARE}); may be repeated",
    )
    args = parser.parse_args()
    if any(share < 0.0 for _, share in args.photographs) or sum(share for _, share in args.photographs) > 1.0:
        parser.error("--photographs: shares are 0 or more, and 1 or less in all")
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(message)s")
    run(
        args.out,
        seed=args.seed,
        steps=args.steps,
        rate=args.rate,
        minutes=args.minutes,
        threads=args.threads,
        batch=args.batch,
        workers=args.workers,
        crops=args.crops,
        renderers=args.renderers,
        check_every=args.check_every,
        start=args.start,
        photographs=args.photographs,
    )


if __name__ == "__main__":
    main()
