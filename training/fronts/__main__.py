"""A front classifier for one's own vehicles, whose training set labels itself.

``python -m training.fronts --video flight.mkv --mission mission.toml --out .train/mine``

The first call cuts crops out of the video (or takes ``--crops FOLDER``), clusters each with its copy turned by 180° by
the features of a pretrained ResNet-18, and draws a contact sheet of every cluster. A person checks them and edits
``corrections.csv``. The same call again trains, and exports ``front.onnx`` for ``[detector] front`` in a mission file.
Every step is kept and not done twice; changed corrections are trained again. Needs the extra ``train``.

Reference:
    Chen, Du, Wu 2025, doi:10.3390/drones9090612, section 3.3 and figure 4.
"""

from __future__ import annotations

import argparse
import json
import logging
from pathlib import Path

import numpy as np
import torch

from training.fronts.cluster import Clusters, ends_apart, paired_kmeans
from training.fronts.collect import WIDE, Crops, collect_folder, collect_video, detector_of, read_crops
from training.fronts.features import features, guesses, pretrained
from training.fronts.learn import TrainingPlan, draw_curve, learn, logits_of, save
from training.fronts.quality import quality, write_quality
from training.fronts.sheets import (
    UNDECIDED,
    Corrections,
    draw_sheets,
    fronts,
    read_corrections,
    write_corrections,
)
from vision.detect.front import BUNDLED_FRONT, open_front_classifier
from vision.errors import LabelError, VisionError

MARGIN = 0.15
"""Margin beyond its box of a crop from a video that the classifier sees, a share of the sides; a choice."""
BLOCKS, HELD_OUT_OF = 50, 5
"""Crops in the order of time fall into blocks and every fifth is held out: neighbours in time look alike."""
MIN_KNOWN = 50
"""Crops with a known front that training needs: one for each of the ``BLOCKS``."""
log = logging.getLogger(__name__)


def main() -> None:
    """Do what is still to be done; unusable input is reported in one line."""
    try:
        _run(_arguments())
    except VisionError as error:
        raise SystemExit(f"error: {error}") from error


def _run(args: argparse.Namespace) -> None:
    args.out.mkdir(parents=True, exist_ok=True)
    logging.basicConfig(
        level=logging.INFO,
        format="%(asctime)s %(message)s",
        handlers=[logging.StreamHandler(), logging.FileHandler(args.out / "log.txt")],
    )
    torch.set_num_threads(args.threads)
    torch.manual_seed(args.seed)
    _same_settings(args)
    # crops of a folder have no surroundings to show
    shown, margin = (WIDE, MARGIN) if args.video else (0.0, 0.0)
    _collect(args)
    crops = read_crops(args.out, shown)
    clusters = _cluster(args, crops, margin)
    table = args.out / "corrections.csv"
    if not table.exists():
        _ask(args.out, crops, clusters)
        if not args.trust:
            log.info("now look at %s, correct %s and run this again", args.out / "sheets", table)
            return
    corrections = read_corrections(table, len(crops), int(clusters.number.max()) + 1)
    _train(args, crops, clusters, corrections, margin)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m training.fronts", description="Train a front classifier.")
    source = parser.add_mutually_exclusive_group(required=True)
    source.add_argument("--video", type=Path, help="cut crops out of this video")
    source.add_argument("--crops", type=Path, help="folder of images, each cut at an oriented box, length along x")
    parser.add_argument("--mission", type=Path, help="mission file whose [detector] finds the vehicles")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--weights", type=Path, help="ResNet-18 of torchvision (.pth); default: the bundled classifier")
    parser.add_argument("--frames", type=int, default=300, help="how many of the video's frames to look at")
    parser.add_argument("--most", type=int, default=6000, help="crops at most")
    parser.add_argument("--clusters", type=int, default=6)
    parser.add_argument("--side", type=int, default=64, help="of a classifier's crop, px")
    parser.add_argument("--steps", type=int, default=400, help="training steps of 64 crops")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--trust", action="store_true", help="train at once, without waiting for corrections")
    return parser.parse_args()


def _same_settings(args: argparse.Namespace) -> None:
    """A folder belongs to one set of settings."""
    path = args.out / "settings.json"
    now = {k: str(v) for k, v in sorted(vars(args).items()) if k not in ("out", "threads", "trust", "steps")}
    if not path.exists():
        path.write_text(json.dumps(now, indent=1) + "\n")
    begun = json.loads(path.read_text())
    other = [f"{k} was {begun.get(k)}, is {v}" for k, v in now.items() if begun.get(k) != v]
    if other:
        raise VisionError(f"{args.out} was begun with other settings ({'; '.join(other)}); take another --out")


def _collect(args: argparse.Namespace) -> None:
    if (args.out / "crops.csv").exists():
        return
    if args.video:
        collect_video(args.video, detector_of(args.mission), args.out, args.frames, args.most)
    else:
        collect_folder(args.crops, args.out, args.most)


def _cluster(args: argparse.Namespace, crops: Crops, margin: float) -> Clusters:
    path = args.out / "features.npz"
    if not path.exists():
        ahead, turned = features(pretrained(args.weights, 2), crops, args.side, margin)
        np.savez(path, ahead=ahead, turned=turned)
    with np.load(path) as kept:
        d = ends_apart(kept["ahead"], kept["turned"])
    return paired_kmeans(d, args.clusters, np.random.default_rng(args.seed))


def _ask(out: Path, crops: Crops, clusters: Clusters) -> None:
    """Sheets, and the table to correct."""
    found = dict.fromkeys(range(int(clusters.number.max()) + 1), UNDECIDED)
    if BUNDLED_FRONT.exists():
        found = guesses(open_front_classifier(), crops, clusters.number, clusters.turned)
    draw_sheets(out / "sheets", crops.images, clusters, found)
    write_corrections(out / "corrections.csv", found)


def _train(args: argparse.Namespace, crops: Crops, clusters: Clusters, corrections: Corrections, margin: float) -> None:
    known, right = fronts(clusters, corrections)
    log.info("%d of %d crops have a front", len(known), len(crops))
    if len(known) < MIN_KNOWN:
        raise LabelError(f"{args.out / 'corrections.csv'}: too few crops have a front; enter right or left in it")
    plan = TrainingPlan(seed=args.seed, steps=args.steps, side=args.side, margin=margin, every=max(args.steps // 10, 1))
    _forget_if_changed(args.out, known, right, plan)
    facing = np.zeros(len(crops), dtype=bool)
    facing[known] = right
    vehicles = crops.vehicles(facing)
    held = np.arange(len(known)) * BLOCKS // len(known) % HELD_OUT_OF == HELD_OUT_OF // 2
    training, held_out = vehicles.select(known[~held]), vehicles.select(known[held])
    net = pretrained(args.weights, plan.classes)
    learn(net, training, held_out, plan, args.out)
    draw_curve(args.out)
    source = args.video or args.crops
    save(net, plan, f"{len(training)} crops of {source.name}", args.out / "front.onnx")
    logits, batch = logits_of(net, held_out, plan)
    log.info("in training's float32: %.4f right", (logits.argmax(axis=1) == batch.label).mean())
    write_quality(args.out / "quality.csv", quality(args.out / "front.onnx", held_out, crops.length_px[known[held]]))
    log.info("wrote %s; name it as [detector] front in a mission file", args.out / "front.onnx")


def _forget_if_changed(out: Path, known: np.ndarray, right: np.ndarray, plan: TrainingPlan) -> None:
    """Other labels or steps need another training."""
    path, now = out / "labels.csv", f"# {plan}\n"
    now += "".join(f"{crop},{'right' if front else 'left'}\n" for crop, front in zip(known, right, strict=True))
    if path.exists() and path.read_text() == now:
        return
    for name in ("checkpoint.pt", "learning.csv"):
        (out / name).unlink(missing_ok=True)
    path.write_text(now)


if __name__ == "__main__":
    main()
