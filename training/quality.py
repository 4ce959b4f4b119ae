"""Quality of detections against the truth: average precision, box and heading errors. Needs no torch."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vision.detect.boxes import rotated_iou
from vision.detect.detections import Detections

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Quality:
    """Figures over all images; a vehicle that is mostly hidden neither helps nor hurts."""

    ap50: float
    """Average precision at rotated IoU 0.5, all-point interpolation."""
    recall: float
    """At score 0.3."""
    precision: float
    """At score 0.3."""
    centre_px: float
    """Median distance of centres, pixels."""
    heading_deg: float
    """Median error of headings that point the right way, degrees."""
    flips: float
    """Share of the returned fronts that are more than 90° off."""
    unsure: float
    """Share of found vehicles whose front is not returned."""


def measure(found: list[Detections], truth: list[FloatArray], score: float = 0.3) -> Quality:
    """Compare detections with the truth, image by image.

    Args:
        truth: (n, 6) cx, cy, length, width, heading, weight (0: counts neither way).
    """
    scores, hits, centre, heading, unsure = [], [], [], [], []
    wanted = sum(int((t[:, 5] > 0.5).sum()) for t in truth)
    for d, t in zip(found, truth, strict=True):
        for i, j in _match(d, t):
            if j >= 0 and t[j, 5] <= 0.5:
                continue
            scores.append(float(d.score[i]))
            hits.append(j >= 0)
            if j >= 0 and d.score[i] >= score:
                centre.append(float(np.hypot(d.cx[i] - t[j, 0], d.cy[i] - t[j, 1])))
                unsure.append(bool(np.isnan(d.heading[i])))
                if not unsure[-1]:
                    turn = np.angle(np.exp(1j * (d.heading[i] - t[j, 4])))
                    heading.append(float(np.degrees(abs(turn))))
    s, hit, turns = np.array(scores), np.array(hits, dtype=bool), np.array(heading)
    strong = s >= score
    right = turns[turns <= 90.0]
    return Quality(
        ap50=_average_precision(s, hit, wanted),
        recall=float(hit[strong].sum() / max(wanted, 1)),
        precision=float(hit[strong].mean()) if strong.any() else 0.0,
        centre_px=float(np.median(centre)) if centre else np.nan,
        heading_deg=float(np.median(right)) if len(right) else np.nan,
        flips=float((turns > 90.0).mean()) if len(turns) else np.nan,
        unsure=float(np.mean(unsure)) if unsure else np.nan,
    )


def score_at_precision(found: list[Detections], truth: list[FloatArray], precision: float) -> float:
    """The lowest score from which on so large a share of detections is right; arguments as for ``measure``."""
    rows = []
    for d, t in zip(found, truth, strict=True):
        rows += [(float(d.score[i]), j >= 0) for i, j in _match(d, t) if j < 0 or t[j, 5] > 0.5]
    rows.sort(reverse=True)
    right = np.cumsum([hit for _, hit in rows]) / np.arange(1, len(rows) + 1)
    enough = np.flatnonzero(right >= precision)
    return rows[int(enough[-1])][0] if len(enough) else 0.5


def _match(d: Detections, t: FloatArray) -> list[tuple[int, int]]:
    """(detection, truth) pairs by falling score, each truth once; truth −1 = false alarm."""
    boxes = np.column_stack([t[:, :4], t[:, 4] - 0.5 * np.pi])
    iou = rotated_iou(d.boxes, boxes) if len(d) and len(t) else np.zeros((len(d), len(t)))
    pairs = []
    free = np.ones(len(t), dtype=bool)
    for i in np.argsort(-d.score, kind="stable"):
        j = int(np.argmax(np.where(free, iou[i], -1.0))) if free.any() else -1
        if j >= 0 and iou[i, j] >= 0.5:
            free[j] = False
            pairs.append((int(i), j))
        else:
            hidden = len(t) and bool(np.any((iou[i] > 0.1) & (t[:, 5] <= 0.5)))
            if not hidden:
                pairs.append((int(i), -1))
    return pairs


def _average_precision(score: FloatArray, hit: NDArray[np.bool_], wanted: int) -> float:
    order = np.argsort(-score, kind="stable")
    good = np.cumsum(hit[order])
    precision = good / np.arange(1, len(good) + 1)
    recall = good / max(wanted, 1)
    # the best precision at this recall or more, integrated over recall
    envelope = np.maximum.accumulate(precision[::-1])[::-1]
    return float(np.sum(np.diff(np.concatenate([[0.0], recall])) * envelope))
