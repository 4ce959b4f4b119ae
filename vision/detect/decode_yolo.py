"""Decodes the output of a YOLO-OBB export to boxes in canvas pixels; ``vision.detect.yolo_layout`` draws the layouts.

A row that is no valid box is dropped and counted. The model does not distinguish front and rear: headings are NaN.

Non-maximum suppression is the fast one that is used with YOLO-OBB models: a box that overlaps any better one is
dropped.

Reference:
    D. Bolya, C. Zhou, F. Xiao, Y. J. Lee, "YOLACT: Real-time Instance Segmentation", arXiv:1904.02689, section 3.4
    (Fast NMS: boxes that are themselves dropped still drop others), with the overlap of arXiv:2106.06072.
"""

from __future__ import annotations

from dataclasses import astuple, dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from vision.detect.boxes import canonical, prob_iou_pairs
from vision.detect.detections import Detections

MAX_CANDIDATES = 2000
"""Most boxes, the best ones, that enter suppression; bounds the time for a model with very many detections."""
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


@dataclass(frozen=True, slots=True, kw_only=True)
class Rule:
    """Rule for the boxes that are returned."""

    classes: NDArray[np.intp]
    """(k,) class numbers of vehicles."""
    score: float
    """Boxes of this score or less are dropped, 0 to 1."""
    overlap: float = 0.45
    """Overlap: of two boxes that overlap more (probabilistic IoU), the one of lower score is dropped."""
    per_class: bool = False
    """True: only boxes of one class drop each other, so that a vehicle may have a box of each class. False: a box is
    one vehicle, whatever its kind."""
    most: int = 300
    """Most boxes of one canvas."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Dropped:
    """Numbers of output rows that were dropped as invalid or surplus."""

    damaged: int = 0
    """Rows with NaN or infinity, or with a class that the model lacks."""
    flat: int = 0
    """Boxes with a side of zero or less."""
    surplus: int = 0
    """Boxes beyond the number that enters suppression or is returned."""

    def __add__(self, other: Dropped) -> Dropped:
        damaged, flat, surplus = (a + b for a, b in zip(astuple(self), astuple(other), strict=True))
        return Dropped(damaged=damaged, flat=flat, surplus=surplus)


def decode_raw(rows: NDArray[np.floating], rule: Rule) -> tuple[Detections, Dropped]:
    """Boxes of an output that has not been through suppression, best first.

    Args:
        rows: (4 + classes + 1, a): x, y, w, h, px; a score for each class; angle, rad. An anchor's class is its
            best.
        rule: which are returned.
    """
    scores = rows[4:-1]
    best = scores.max(axis=0)
    damaged = int(np.isnan(best).sum())
    chosen = np.flatnonzero(best > rule.score)
    kind = scores[:, chosen].argmax(axis=0)
    wanted = np.isin(kind, rule.classes)
    chosen, kind = chosen[wanted], kind[wanted]
    table = np.vstack([rows[:4, chosen], rows[-1:, chosen], best[None, chosen]]).T.astype(np.float64)
    found, dropped = _suppressed(table, kind, rule, "same" if rule.per_class else "any")
    return found, dropped + Dropped(damaged=damaged)


def decode_boxes(table: NDArray[np.floating], classes: int, rule: Rule) -> tuple[Detections, Dropped]:
    """Boxes of an output that the model has already suppressed, best first.

    Args:
        table: (m, 7): x, y, w, h, px; score; class; angle, rad. Rows below the score, such as zeros, are no boxes.
        rule: which are returned; suppression within one class is done by the model.
    """
    score, kind = table[:, 4], table[:, 5]
    damaged = int(np.isnan(score).sum())
    chosen = np.flatnonzero(score > rule.score)
    real = np.isin(kind[chosen], np.arange(classes))
    damaged += int((~real).sum())
    chosen = chosen[real]
    chosen = chosen[np.isin(kind[chosen], rule.classes)]
    columns = table[chosen][:, [0, 1, 2, 3, 6, 4]].astype(np.float64)
    found, dropped = _suppressed(columns, kind[chosen].astype(np.intp), rule, "none" if rule.per_class else "other")
    return found, dropped + Dropped(damaged=damaged)


def _suppressed(
    table: NDArray[np.float64], kind: NDArray[np.intp], rule: Rule, rivals: Rivals | Literal["none"]
) -> tuple[Detections, Dropped]:
    """Detections of candidates (m, 6) x y w h angle score of classes (m,), after suppression among ``rivals``."""
    finite = np.isfinite(table).all(axis=1)
    real = finite & (table[:, 2] > 0.0) & (table[:, 3] > 0.0)
    table, kind = table[real], kind[real]
    best = np.argsort(-table[:, 5], kind="stable")[:MAX_CANDIDATES]
    boxes, score = canonical(table[best, :5]), table[best, 5]
    kept = np.arange(len(best)) if rivals == "none" else fast_nms(boxes, score, rule.overlap, kind[best], rivals)
    dropped = Dropped(
        damaged=int((~finite).sum()),
        flat=int((finite & ~real).sum()),
        surplus=len(table) - len(best) + max(len(kept) - rule.most, 0),
    )
    kept = kept[: rule.most]
    cx, cy, w, h, angle = boxes[kept].T
    value, heading = np.clip(score[kept], 0.0, 1.0), np.full(len(kept), np.nan)
    return Detections(cx=cx, cy=cy, w=w, h=h, angle=angle, score=value, heading=heading), dropped
