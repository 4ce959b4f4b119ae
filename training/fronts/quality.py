"""Quality of an exported classifier through ``vision.detect.front``, by the length of vehicles in the image."""

from __future__ import annotations

import csv
import logging
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from training.fronts.vehicles import Vehicles, jittered
from vision.detect.front import open_front_classifier

LENGTHS_PX = (0, 16, 24, 36, 54, 10_000)
"""Edges of the ranges of a vehicle's length that are reported apart; a choice."""
SURE = 0.8
"""Least probability of a front that is returned, as ``open_front_classifier`` has it."""
log = logging.getLogger(__name__)


def quality(model: Path, held_out: Vehicles, length_px: NDArray[np.float64], seed: int = 0) -> list[dict[str, float]]:
    """Shares of right fronts, boxes jittered as a detector's are.

    Args:
        length_px: (n,) of the vehicles in the images that they come from.

    Returns:
        A row for each class of length that there is, and one for all: the lengths, the number of vehicles, the share of
        share of right fronts if all were returned, the share returned at ``SURE``, the share of those that is right.
    """
    classifier = open_front_classifier(model, sure=0.0)
    boxes = jittered(held_out.boxes, np.random.default_rng([seed, 2]))
    returned = [classifier.classify(image, box) for image, box in zip(held_out.images, boxes, strict=True)]
    heading = np.array([t.heading[0] for t in returned])
    confidence = np.array([t.confidence[0] for t in returned])
    right = np.cos(heading - held_out.boxes[:, 4] - 0.5 * np.pi) > np.cos(np.radians(45.0))
    spans = [*pairwise(LENGTHS_PX), (LENGTHS_PX[0], LENGTHS_PX[-1])]
    chosen = [((length_px >= a) & (length_px < b), a, b) for a, b in spans]
    return [_row(right, confidence, part, a, b) for part, a, b in chosen if part.any()]


def write_quality(path: Path, rows: Sequence[dict[str, float]]) -> None:
    """Write the rows, and log them."""
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows({k: f"{v:.6g}" for k, v in row.items()} for row in rows)
    for row in rows:
        log.info("%s", ", ".join(f"{k} {v:.4g}" for k, v in row.items()))


def _row(
    right: NDArray[np.bool_], confidence: NDArray[np.float64], chosen: NDArray[np.bool_], a: float, b: float
) -> dict[str, float]:
    returned = chosen & (confidence >= SURE)
    return {
        "from_px": a,
        "to_px": b,
        "vehicles": int(chosen.sum()),
        "right": _share(right, chosen),
        "told": _share(returned, chosen),
        "right_of_told": _share(right, returned),
    }


def _share(part: NDArray[np.bool_], whole: NDArray[np.bool_]) -> float:
    return float(part[whole].mean()) if whole.any() else float("nan")
