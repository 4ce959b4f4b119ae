"""Detections with their centre on a labelled object: what upright labels of turned vehicles can judge fairly.

The upright box around a turned vehicle overlaps little with the upright box around a good detection of it, but its
centre is inside. Greedy by score, image by image: a detection takes, of the objects that count, that its centre lies in
and that no better one has taken, the one whose centre is nearest. One that finds none is no false alarm where its
centre lies in something that does not count.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vision.detect.detections import Detections
from vision.evaluation.matching import ASIDE, FALSE_ALARM, Matches
from vision.evaluation.truth import Truth

Floats = NDArray[np.float64]


def match_centres(found: Detections, truth: Truth) -> Matches:
    """Pair detections with objects by their centres; there is no threshold of overlap."""
    far = _distance(found.centre, truth.boxes)
    free = np.where(truth.counts, far, np.inf)
    number = np.full(len(found), FALSE_ALARM, dtype=np.int64)
    for i in np.argsort(-found.score, kind="stable"):
        j = int(np.argmin(free[i])) if len(truth) else -1
        if j >= 0 and np.isfinite(free[i, j]):
            number[i] = j
            free[:, j] = np.inf
    aside = np.where(truth.counts, np.inf, far)
    on = aside.argmin(axis=1) if len(truth) else np.zeros(len(found), dtype=np.int64)
    excused = (number == FALSE_ALARM) & np.isfinite(aside.min(axis=1, initial=np.inf))
    number[excused] = ASIDE
    return Matches(truth=number[None], under=np.where(excused, on, -1))


def _distance(centre: Floats, boxes: Floats) -> Floats:
    """(m, n) distance of centres (m, 2), px, to those of the boxes (n, 5) that they lie in, inf elsewhere."""
    apart = centre[:, None] - boxes[None, :, :2]
    c, s = np.cos(boxes[:, 4]), np.sin(boxes[:, 4])
    along, across = c * apart[..., 0] + s * apart[..., 1], c * apart[..., 1] - s * apart[..., 0]
    inside = (np.abs(along) <= 0.5 * boxes[:, 2]) & (np.abs(across) <= 0.5 * boxes[:, 3])
    return np.where(inside, np.hypot(along, across), np.inf)
