"""Figures over all images.

AP      area under precision over recall, precision being the best at this recall or more (all-point
        interpolation, as PASCAL VOC from 2010 on and DOTA have it; COCO takes 101 points of the same curve)
AP50    at intersection over union 0.5;  AP50-95  mean over 0.50, 0.55, … 0.95
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vision.detect.detections import Detections
from vision.evaluation.centres import match_centres
from vision.evaluation.matching import ASIDE, FALSE_ALARM, THRESHOLDS, Matches, match
from vision.evaluation.precision import average_precision
from vision.evaluation.reliability import ScoreBin, score_bins, score_for
from vision.evaluation.shares import Share, by_class, by_hiding, by_place, by_size
from vision.evaluation.truth import Truth

Floats = NDArray[np.float64]

FLOOR = 0.01
"""Smallest score that average precision sees: detectors are asked for all from it on."""
USUAL_PRECISION = 0.85
"""Precision that the bundled detector's operating score is set to."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Directions:
    """Directions of found objects at the operating score."""

    axis_deg: float
    """Median error of the long axis, of boxes that are a fifth longer than wide; NaN with upright labels."""
    given: int
    """Objects of which labels and detections have the front."""
    missing: int
    """Objects whose labels do, and whose detections do not."""
    heading_deg: float
    """Median error of the front."""
    turned_about: float
    """Share of the detected fronts that are more than 90° off."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Centres:
    """Figures by centres alone: a detection is right if its centre lies in an object, one detection for each."""

    ap: float
    precision: float
    recall: float
    sizes: tuple[Share, ...]
    places: tuple[Share, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Reliability:
    """Worth of scores: judged by centres with upright labels, by overlap of a half with others."""

    bins: tuple[ScoreBin, ...]
    usual_score: float
    """Lowest score from which on USUAL_PRECISION of the detections are right."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Evaluation:
    """Quality of detections; shares are NaN where there is nothing to take a share of."""

    images: int
    objects: int
    """Number of objects that count."""
    aside: int
    """Labelled, but neither help nor hurt."""
    detections: int
    """Number of detections at the operating score, those set aside left out."""
    score: float
    """Operating score."""
    floor: float
    """Smallest score that average precision saw."""
    ap50: float
    ap50_95: float
    ap: tuple[float, ...]
    """Average precision at each of the thresholds 0.50, 0.55, … 0.95."""
    precision: float
    recall: float
    centre_px: float
    """Median distance of centres."""
    directions: Directions
    classes: tuple[Share, ...]
    sizes: tuple[Share, ...]
    hidden: tuple[Share, ...]
    """Recall by how hidden objects are, where labels have it; last those that do not count."""
    centres: Centres
    reliability: Reliability


def evaluate(
    found: Sequence[Detections], truth: Sequence[Truth], *, score: float = 0.3, floor: float = FLOOR
) -> Evaluation:
    """Judge detections, image by image.

    Args:
        score: operating score of precision, recall, errors and shares.
        floor: the smallest score that the detector returned, for the record.
    """
    matches = [match(d, t) for d, t in zip(found, truth, strict=True)]
    by_centre = [match_centres(d, t) for d, t in zip(found, truth, strict=True)]
    all_scores = np.concatenate([np.empty(0), *(d.score for d in found)])
    number = _numbers(matches, len(THRESHOLDS))
    objects = sum(int(t.counts.sum()) for t in truth)
    ap = tuple(average_precision(all_scores[row != ASIDE], row[row != ASIDE] >= 0, objects) for row in number)
    hits, false = _counts(number[0], all_scores, score)
    seen = _seen_in_all(found, truth, matches, score)
    upright = any(t.upright for t in truth)
    judged = by_centre if upright else matches
    return Evaluation(
        images=len(truth),
        objects=objects,
        aside=sum(int((~t.counts).sum()) for t in truth),
        detections=hits + false,
        score=score,
        floor=floor,
        ap50=ap[0],
        ap50_95=float(np.mean(ap)),
        ap=ap,
        precision=hits / (hits + false) if hits + false else float("nan"),
        recall=hits / objects if objects else float("nan"),
        centre_px=_median(np.concatenate([np.empty(0), *(_apart(*pair) for pair in _pairs(found, truth, seen))])),
        directions=_directions(_pairs(found, truth, seen), upright),
        classes=by_class(all_scores, matches, truth, seen),
        sizes=by_size(truth, seen),
        hidden=by_hiding(truth, seen),
        centres=_centres(found, truth, by_centre, score),
        reliability=Reliability(bins=score_bins(found, judged), usual_score=score_for(USUAL_PRECISION, found, judged)),
    )


def _numbers(matches: Sequence[Matches], thresholds: int) -> NDArray[np.int64]:
    """(thresholds, k) what each detection of all images is."""
    return np.concatenate([np.empty((thresholds, 0), np.int64), *(m.truth for m in matches)], axis=1)


def _counts(number: NDArray[np.int64], all_scores: Floats, score: float) -> tuple[int, int]:
    """Right ones and false alarms at the operating score."""
    strong = number[all_scores >= score]
    return int((strong >= 0).sum()), int((strong == FALSE_ALARM).sum())


def _centres(found: Sequence[Detections], truth: Sequence[Truth], matches: Sequence[Matches], score: float) -> Centres:
    number = _numbers(matches, 1)[0]
    all_scores = np.concatenate([np.empty(0), *(d.score for d in found)])
    objects = sum(int(t.counts.sum()) for t in truth)
    hits, false = _counts(number, all_scores, score)
    seen = _seen_in_all(found, truth, matches, score)
    return Centres(
        ap=average_precision(all_scores[number != ASIDE], number[number != ASIDE] >= 0, objects),
        precision=hits / (hits + false) if hits + false else float("nan"),
        recall=hits / objects if objects else float("nan"),
        sizes=by_size(truth, seen),
        places=by_place(truth, seen),
    )


def _seen_in_all(
    found: Sequence[Detections], truth: Sequence[Truth], matches: Sequence[Matches], score: float
) -> list[NDArray[np.int64]]:
    return [_seen(d, t, m, score) for d, t, m in zip(found, truth, matches, strict=True)]


def _seen(found: Detections, truth: Truth, matches: Matches, score: float) -> NDArray[np.int64]:
    """(n,) detection that found each object at the operating score, −1 none; also for those that do not count."""
    by = np.full(len(truth), -1, dtype=np.int64)
    for i in np.flatnonzero(found.score >= score):
        j = matches.truth[0, i] if matches.truth[0, i] >= 0 else matches.under[i]
        if j >= 0:
            by[j] = i
    return by


def _pairs(
    found: Sequence[Detections], truth: Sequence[Truth], seen: Sequence[NDArray[np.int64]]
) -> list[tuple[Detections, Truth]]:
    """Counted objects of each image that were found, row by row with their detections."""
    kept = [(by >= 0) & t.counts for t, by in zip(truth, seen, strict=True)]
    return [(d.select(by[k]), t.select(k)) for d, t, by, k in zip(found, truth, seen, kept, strict=True)]


def _apart(found: Detections, truth: Truth) -> Floats:
    return np.asarray(np.linalg.norm(found.centre - truth.boxes[:, :2], axis=1))


def _directions(pairs: Sequence[tuple[Detections, Truth]], upright: bool) -> Directions:
    estimated, true = (np.concatenate([np.empty(0), *(p[k].heading for p in pairs)]) for k in (0, 1))
    known, given = np.isfinite(true), np.isfinite(true) & np.isfinite(estimated)
    # smallest turn between two directions, and between two axes
    off = np.degrees(np.abs(np.angle(np.exp(1j * (estimated[given] - true[given])))))
    boxes, wanted = (np.concatenate([np.empty((0, 5)), *rows]) for rows in zip(*_rows_of(pairs), strict=True))
    longer = np.maximum(wanted[:, 2], wanted[:, 3]) > 1.2 * np.minimum(wanted[:, 2], wanted[:, 3])
    double = 2.0 * (_axis(boxes[longer]) - _axis(wanted[longer]))
    return Directions(
        axis_deg=float("nan") if upright else _median(np.degrees(0.5 * np.abs(np.angle(np.exp(1j * double))))),
        given=int(given.sum()),
        missing=int(known.sum() - given.sum()),
        heading_deg=_median(off),
        turned_about=float((off > 90.0).mean()) if len(off) else float("nan"),
    )


def _rows_of(pairs: Sequence[tuple[Detections, Truth]]) -> list[tuple[Floats, Floats]]:
    return [(d.boxes, t.boxes) for d, t in pairs] or [(np.empty((0, 5)), np.empty((0, 5)))]


def _axis(boxes: Floats) -> Floats:
    """Direction of the longer side, rad."""
    return np.asarray(boxes[:, 4] + np.where(boxes[:, 3] > boxes[:, 2], 0.5 * np.pi, 0.0))


def _median(values: Floats) -> float:
    return float(np.median(values)) if len(values) else float("nan")
