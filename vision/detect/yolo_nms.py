"""Fast non-maximum suppression, as used with YOLO-OBB models: a box that overlaps any better one is dropped.

Reference:
    D. Bolya, C. Zhou, F. Xiao, Y. J. Lee, "YOLACT: Real-time Instance Segmentation", arXiv:1904.02689, section 3.4
    (Fast NMS: boxes that are themselves dropped still drop others), with the overlap of arXiv:2106.06072.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from vision.detect.boxes import prob_iou_pairs

__all__ = ["Rivals", "fast_nms"]

Rivals = Literal["any", "same", "other"]

PAIRS = 1 << 20
"""Pairs of boxes compared in one step; bounds the memory."""
FIRST = 16
"""Boxes, the best ones, that all others are compared with in the first step; later steps double it."""


def fast_nms(
    boxes: NDArray[np.float64],
    score: NDArray[np.float64],
    overlap: float,
    kind: NDArray[np.integer] | None = None,
    rivals: Rivals = "any",
) -> NDArray[np.intp]:
    """Keep the boxes that no better one overlaps.

    Unlike greedy suppression (``vision.detect.boxes.nms``) a chain of boxes, each over the next, leaves only its best.

    Args:
        boxes: (m, 5) cx cy w h angle.
        score: (m,) higher is better.
        overlap: probabilistic IoU above which a box is dropped, 0 to 1.
        kind: (m,) class numbers; needed unless ``rivals`` is "any".
        rivals: which boxes drop each other: any, those of the same kind, or those of another.

    Returns:
        Indices of the survivors, best score first.
    """
    order = np.argsort(-score, kind="stable")
    rows, kinds = boxes[order], np.zeros(len(order), dtype=np.intp) if kind is None else kind[order]
    reach_px2 = _reach(rows, overlap)
    alive = np.ones(len(order), dtype=bool)
    start, step = 0, FIRST
    while start < len(order):
        # the best ones first: of thousands of boxes of one object they leave few to compare
        better = np.arange(start, min(start + step, len(order)))
        worse = start + np.flatnonzero(alive[start:])
        start, step = start + step, max(1, min(2 * step, PAIRS // len(order)))
        if not len(worse):
            break
        gap = (rows[better, None, :2] - rows[None, worse, :2]) ** 2
        near = gap.sum(axis=-1) <= reach_px2[better, None] + reach_px2[None, worse]
        near &= better[:, None] < worse
        if rivals != "any":
            near &= (kinds[better, None] == kinds[worse]) == (rivals == "same")
        i, j = np.nonzero(near)
        over = prob_iou_pairs(rows[better[i]], rows[worse[j]]) > overlap
        alive[worse[j[over]]] = False
    return order[alive]


def _reach(rows: NDArray[np.float64], overlap: float) -> NDArray[np.float64]:
    """(m,) px²: two boxes whose squared distance exceeds the sum of their values overlap by less than ``overlap``.

    1 − √(1 − e^−B) > t  ⇒  B < −ln(1 − (1 − t)²);  B ≥ ¼ d² / λ with λ ≤ (a² + b²) / 12, a and b the longer sides.
    """
    share = 1.0 - (1.0 - overlap) ** 2
    most = -np.log(share) if share > 0.0 else np.inf
    longer = np.maximum(rows[:, 2:4].max(axis=1, initial=0.0), 0.1)
    return np.asarray(most * longer**2 / 3.0)
