"""Decodes the output of a YOLO-OBB export to boxes in canvas pixels; ``vision.detect.yolo_layout`` draws the layouts.

A row that is no valid box is dropped and counted. The model does not distinguish front and rear: headings are NaN.
"""

from __future__ import annotations

from dataclasses import astuple, dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from vision.detect.boxes import canonical
from vision.detect.detections import Detections
from vision.detect.yolo_nms import Rivals, fast_nms

__all__ = ["Dropped", "Rule", "decode_boxes", "decode_raw"]

MOST_CANDIDATES = 2000
"""Most boxes, the best ones, that enter suppression; bounds the time for a model with very many detections."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Rule:
    """Which boxes are returned."""

    classes: NDArray[np.intp]
    """(k,) class numbers of vehicles."""
    score: float
    """Boxes of this score or less are dropped, 0 to 1."""
    overlap: float = 0.45
    """Of two boxes that overlap more (probabilistic IoU), the one of lower score is dropped."""
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
        classes: how many the model has.
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
    best = np.argsort(-table[:, 5], kind="stable")[:MOST_CANDIDATES]
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
