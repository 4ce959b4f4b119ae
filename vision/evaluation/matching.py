"""Pairs of detections and labelled objects, at every threshold of overlap: greedy by score, image by image.

A detection takes, of the objects that count and that no better detection has taken, the one it overlaps most, if that
is enough. One that finds none is no false alarm where it lies on something that does not count: overlap enough with
that, or half of the detection inside it. That is COCO's rule with every uncounted object as a crowd.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vision.detect.boxes import hull, rotated_iou
from vision.detect.detections import Detections
from vision.evaluation.truth import Truth

Floats = NDArray[np.float64]

THRESHOLDS: Floats = np.linspace(0.5, 0.95, 10)
"""Thresholds of intersection over union."""
FALSE_ALARM, ASIDE = -1, -2
"""Numbers in place of an object's: nothing is there; what is there does not count."""
MOSTLY = 0.5
"""A detection with this share inside an object that does not count is set aside: more of it inside than outside."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Matches:
    """The m detections of one image, each threshold for itself."""

    truth: NDArray[np.int64]
    """(thresholds, m) number of the object, FALSE_ALARM or ASIDE."""
    under: NDArray[np.int64]
    """(m,) the uncounted object that a detection set aside at the first threshold lies on, −1 where there is none."""


def match(found: Detections, truth: Truth, thresholds: Floats = THRESHOLDS) -> Matches:
    """Pair detections with objects.

    Args:
        found: m detections.
        thresholds: least intersection over union of a pair.
    """
    iou, inside = overlap(found, truth)
    best_first = np.argsort(-found.score, kind="stable")
    counted = np.flatnonzero(truth.counts)
    taken = np.array([_greedy(iou[:, counted], best_first, t) for t in thresholds], dtype=np.int64)
    taken = taken.reshape(len(thresholds), len(found))
    number = np.where(taken >= 0, np.append(counted, 0)[taken], FALSE_ALARM)
    aside = np.where(truth.counts, 0.0, iou)
    most = aside.max(axis=1, initial=0.0)
    within = np.where(truth.counts, 0.0, inside).max(axis=1, initial=0.0) >= MOSTLY
    excused = (most >= np.asarray(thresholds)[:, None]) | within
    number = np.where((number == FALSE_ALARM) & excused, ASIDE, number)
    on = aside.argmax(axis=1) if len(truth) else np.zeros(len(found), dtype=np.int64)
    return Matches(truth=number, under=np.where((number[0] == ASIDE) & (most >= thresholds[0]), on, -1))


def overlap(found: Detections, truth: Truth) -> tuple[Floats, Floats]:
    """Intersection over union, and the share of each detection that lies inside each object: (m, n) each."""
    boxes, objects = (upright_boxes(b) if truth.upright else b for b in (found.boxes, truth.boxes))
    iou = rotated_iou(boxes, objects)
    area, other = (b[:, 2] * b[:, 3] for b in (boxes, objects))
    # IoU = I / (A + B − I)  ⇒  I = IoU (A + B) / (1 + IoU)
    common = iou * (area[:, None] + other) / (1.0 + iou)
    return iou, common / np.maximum(area, 1e-12)[:, None]


def upright_boxes(boxes: Floats) -> Floats:
    """(n, 5) the upright boxes around boxes (n, 5)."""
    around = hull(boxes)
    low, high = around[:, :2], around[:, 2:]
    return np.column_stack([0.5 * (low + high), high - low, np.zeros(len(boxes))])


def _greedy(iou: Floats, best_first: NDArray[np.intp], threshold: float) -> NDArray[np.int64]:
    """(m,) column that each row takes, −1 none."""
    taken = np.full(len(iou), -1, dtype=np.int64)
    free = np.where(iou >= threshold, iou, -1.0)
    for i in best_first:
        j = int(np.argmax(free[i])) if free.shape[1] else -1
        if j >= 0 and free[i, j] >= 0.0:
            taken[i] = j
            free[:, j] = -1.0
    return taken
