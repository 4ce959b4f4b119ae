"""Worth of scores: how many of the detections of a score are right, by their size."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from vision.detect.detections import Detections
from vision.evaluation.matching import ASIDE, Matches

Floats = NDArray[np.float64]

SCORES = (0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0)
"""Edges of the classes by score; below, there are many detections and few of any use."""
LENGTHS_PX = (0.0, 24.0, 48.0, np.inf)
"""Edges of the classes by length of the detection, px."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ScoreBin:
    """Detections of similar score and length; those set aside are left out."""

    score: tuple[float, float]
    """Bounds of the score: from, and below; the last class includes 1."""
    length_px: tuple[float, float]
    """Longer side, from and below."""
    detections: int
    right: int


def score_bins(found: Sequence[Detections], matches: Sequence[Matches]) -> tuple[ScoreBin, ...]:
    """Count what is right at the first threshold of the matches, by score and length."""
    score, hit, length = _judged(found, matches)
    bins = []
    for low, high in pairwise(SCORES):
        of_score = (score >= low) & ((score < high) | (high == SCORES[-1]))
        for short, long in pairwise(LENGTHS_PX):
            mine = of_score & (length >= short) & (length < long)
            row = ScoreBin(
                score=(low, high), length_px=(short, long), detections=int(mine.sum()), right=int(hit[mine].sum())
            )
            bins.append(row)
    return tuple(bins)


def score_for(precision: float, found: Sequence[Detections], matches: Sequence[Matches]) -> float:
    """The lowest score from which on enough of the detections are right.

    Args:
        precision: wanted share of right ones among the detections of this score or more.

    Returns:
        0 to 1, NaN where no score has it.
    """
    score, hit, _ = _judged(found, matches)
    order = np.argsort(-score, kind="stable")
    score, hit = score[order], hit[order]
    enough = np.cumsum(hit) / np.arange(1, len(hit) + 1) >= precision
    # equal scores cannot be told apart by a threshold: the last of them decides
    last = np.flatnonzero(np.append(score[1:] != score[:-1], True)) if len(score) else np.zeros(0, dtype=np.intp)
    good = last[enough[last]]
    return float(score[good[-1]]) if len(good) else float("nan")


def _judged(found: Sequence[Detections], matches: Sequence[Matches]) -> tuple[Floats, NDArray[np.bool_], Floats]:
    """Score, whether right and length, px, of the detections of all images that are not set aside."""
    number = np.concatenate([np.empty(0, np.int64), *(m.truth[0] for m in matches)])
    score = np.concatenate([np.empty(0), *(d.score for d in found)])
    length = np.concatenate([np.empty(0), *(d.boxes[:, 2:4].max(axis=1, initial=0.0) for d in found)])
    kept = number != ASIDE
    return score[kept], number[kept] >= 0, length[kept]
