"""Deep features of crops and of their copies turned by 180°: what the last layer of a ResNet-18 sees."""

from __future__ import annotations

import logging
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from training.fronts.collect import Crops
from training.fronts.resnet import ResNet18, load_weights
from training.fronts.sheets import LEFT, RIGHT, UNDECIDED
from training.fronts.vehicles import planes_of
from vision.detect.front import BUNDLED_FRONT, FrontClassifier
from vision.detect.front_crops import rectify

AGREED = 0.7
"""Least share of a cluster's crops that must face one way for a guess."""
CHUNK = 64
"""Crops that go through the network at once, so that memory stays bounded."""
log = logging.getLogger(__name__)


def pretrained(weights: Path | None, classes: int) -> ResNet18:
    """A network that has seen much: given weights, else the bundled classifier, which was trained on renders."""
    net = ResNet18(classes)
    chosen = weights or BUNDLED_FRONT
    whole = load_weights(net, chosen)
    log.info("starts from %s%s", chosen, "" if whole else ", with a new last layer")
    return net


def features(net: ResNet18, crops: Crops, side: int, margin: float) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """(n, 512) of the crops, and of their copies turned by 180°."""
    net.eval()
    box = crops.vehicles(np.ones(len(crops), dtype=bool)).boxes
    seen = np.concatenate([rectify(i, b, side, margin) for i, b in zip(crops.images, box, strict=True)])
    parts: tuple[list[NDArray[np.float32]], list[NDArray[np.float32]]] = ([], [])
    with torch.no_grad():
        for start in range(0, len(seen), CHUNK):
            chunk = seen[start : start + CHUNK]
            for part, views in zip(parts, (chunk, chunk[:, ::-1, ::-1]), strict=True):
                part.append(net.features(torch.from_numpy(planes_of(views))).numpy())
    return np.concatenate(parts[0]), np.concatenate(parts[1])


def guesses(
    classifier: FrontClassifier, crops: Crops, number: NDArray[np.int64], turned: NDArray[np.bool_]
) -> dict[int, str]:
    """Way that each cluster faces, by a classifier's votes: right, left, or ? where they disagree."""
    boxes = crops.vehicles(np.ones(len(crops), dtype=bool)).boxes
    heading = np.array([classifier.classify(i, b).heading[0] for i, b in zip(crops.images, boxes, strict=True)])
    # on a crop a heading of 90°, clockwise from up, is the right
    right = (np.sin(heading) > 0.0) ^ turned
    found = {}
    for cluster in range(int(number.max()) + 1):
        votes = right[(number == cluster) & np.isfinite(heading)]
        share = float(votes.mean()) if len(votes) else 0.5
        found[cluster] = RIGHT if share >= AGREED else LEFT if share <= 1.0 - AGREED else UNDECIDED
        log.info(
            "cluster %d: %d crops, %.0f %% of %d votes are right",
            cluster,
            (number == cluster).sum(),
            100.0 * share,
            len(votes),
        )
    return found
