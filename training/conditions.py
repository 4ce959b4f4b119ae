"""Quality of a model file by size, tilt, ground, light and cover, on images that it has not seen.

``python -m training.conditions --model vision/models/rollcall-obb-s.onnx --pictures .train/test`` prints a
table; the images are those of ``python -m training.rendered.crops``. No torch is needed.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from training.quality import Quality, measure
from vision.detect.boxes import rotated_iou
from vision.detect.decode_heatmap import decode
from vision.detect.detections import Detections
from vision.detect.onnx_model import metadata, open_session

FloatArray = NDArray[np.float64]
SIZES = ((10.0, 16.0), (16.0, 24.0), (24.0, 48.0), (48.0, 120.0))
"""Ranges of a vehicle's length, px, that are reported apart; the edges are a choice."""


@dataclass(frozen=True, slots=True, kw_only=True)
class HeldOut:
    """Held-out images."""

    images: NDArray[np.uint8]
    """(c, S, S, 3) BGR."""
    truth: list[FloatArray]
    """(n, 6) each: cx, cy, length, width px, heading, visible share."""
    about: NDArray[np.float32]
    """(c, 5) tilt, height, shadow, gain, streets; see ``training.rendered.crops.Crop``."""


def read_held_out(folder: Path) -> HeldOut:
    """All shards of a folder.

    Raises:
        FileNotFoundError: there are none.
    """
    paths = sorted(folder.glob("crops_*.npz"))
    if not paths:
        raise FileNotFoundError(
            f"{folder}: no crops_*.npz; make them with python -m training.rendered.crops --out {folder}"
        )
    images, truth, about = [], [], []
    for path in paths:
        with np.load(path) as shard:
            images.append(shard["images"])
            about.append(shard["about"])
            truth += [b[:n].astype(np.float64) for b, n in zip(shard["boxes"], shard["n"], strict=True)]
    return HeldOut(images=np.concatenate(images), truth=truth, about=np.concatenate(about))


def detect(model: Path, held_out: HeldOut, score: float = 0.05) -> list[Detections]:
    """Boxes that a model finds on each image."""
    session = open_session(model, ("CPUExecutionProvider",), 1)
    stride = int(metadata(session)["stride"])
    return [decode(session.run(None, {"image": image[None]})[0][0], stride, score) for image in held_out.images]


def by_condition(found: list[Detections], held_out: HeldOut, least_px: float = 10.0) -> Iterator[tuple[str, Quality]]:
    """Figures for each condition; vehicles shorter than ``least_px`` count neither way but under their own size."""
    tilt, _, shadow, gain, streets = held_out.about.T
    whole = [_limited(f, t, (least_px, np.inf)) for f, t in zip(found, held_out.truth, strict=True)]

    def over(chosen: NDArray[np.bool_]) -> Quality:
        return measure([whole[i][0] for i in np.flatnonzero(chosen)], [whole[i][1] for i in np.flatnonzero(chosen)])

    yield "all", over(np.ones(len(found), dtype=bool))
    for span in SIZES:
        parts = [_limited(f, t, span) for f, t in zip(found, held_out.truth, strict=True)]
        yield f"length {span[0]:.0f} to {span[1]:.0f} px", measure([f for f, _ in parts], [t for _, t in parts])
    degrees = np.degrees(tilt)
    yield "tilt below 10°", over(degrees < 10.0)
    yield "tilt 10° to 30°", over((degrees >= 10.0) & (degrees < 30.0))
    yield "tilt 30° to 62°", over((degrees >= 30.0) & (degrees < 62.0))
    yield "tilt 62° to 77°", over(degrees >= 62.0)
    yield "streets and car parks", over(streets > 0.5)
    yield "open ground", over(streets < 0.5)
    yield "sunny", over((shadow >= 0.25) & (gain >= 0.8))
    yield "overcast", over((shadow < 0.25) & (gain >= 0.8))
    yield "dark", over(gain < 0.8)
    for name, low, high in (("wholly in sight", 0.95, 2.0), ("half to nine tenths in sight", 0.5, 0.9)):
        seen = [t.copy() for _, t in whole]
        for t in seen:
            t[(t[:, 5] < low) | (t[:, 5] >= high), 5] = 0.0
        yield name, measure([f for f, _ in whole], seen)


def _limited(found: Detections, truth: FloatArray, span: tuple[float, float]) -> tuple[Detections, FloatArray]:
    """Truth of other lengths counts neither way, nor do detections of other lengths that are on none of this."""
    truth = truth.copy()
    inside = (truth[:, 2] >= span[0]) & (truth[:, 2] < span[1])
    truth[~inside, 5] = 0.0
    mine = (found.w >= span[0]) & (found.w < span[1])
    if len(found) and inside.any():
        boxes = np.column_stack([truth[inside, :4], truth[inside, 4] - 0.5 * np.pi])
        mine |= rotated_iou(found.boxes, boxes).max(axis=1) >= 0.5
    return found.select(np.flatnonzero(mine)), truth


def main() -> None:
    """Print a table of figures."""
    parser = argparse.ArgumentParser(description="Figures of a bundled model by condition.")
    parser.add_argument("--model", type=Path, required=True)
    parser.add_argument("--pictures", type=Path, default=Path(".train/test"))
    args = parser.parse_args()
    held_out = read_held_out(args.pictures)
    rows = ["| on | AP50 | recall | precision | centre | heading | turned about |", "|---|---|---|---|---|---|---|"]
    for name, q in by_condition(detect(args.model, held_out), held_out):
        rows.append(
            f"| {name} | {q.ap50:.3f} | {q.recall:.3f} | {q.precision:.3f} | {q.centre_px:.1f} px "
            f"| {q.heading_deg:.1f}° | {100.0 * q.flips:.1f} % |"
        )
    sys.stdout.write("\n".join(rows) + "\n")


if __name__ == "__main__":
    main()
