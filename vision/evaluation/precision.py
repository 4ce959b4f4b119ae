"""Average precision, by all-point interpolation.

Precision over recall, precision being the best at this recall or more, integrated at every recall that occurs: as
PASCAL VOC from 2010 on and DOTA have it. COCO samples the same curve at 101 recalls.

Reference:
    Everingham et al. 2015, doi:10.1007/s11263-014-0733-5, section 4.2 (and VOC 2010's development kit).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def average_precision(
    score: NDArray[np.float64], hit: NDArray[np.bool_], objects: int, times: NDArray[np.int64] | None = None
) -> float:
    """Area under the precision-recall curve.

    Args:
        score: (k,) of detections.
        hit: (k,) whether each is right.
        times: (k,) how often each detection counts; None: once.

    Returns:
        0 to 1, NaN without objects.
    """
    if not objects:
        return float("nan")
    order = np.argsort(-score, kind="stable")
    count = np.ones(len(order), np.int64) if times is None else times[order]
    right, given = np.cumsum(count * hit[order]), np.cumsum(count)
    last = np.append(np.diff(score[order]) != 0.0, True) if len(order) else np.zeros(0, dtype=bool)
    # detections of one score come in together: their order is arbitrary
    precision, recall = (right / np.maximum(given, 1))[last], (right / objects)[last]
    best = np.maximum.accumulate(precision[::-1])[::-1]
    # AP = Σ (r_k − r_{k−1}) max_{j ≥ k} p_j
    return float(np.sum(np.diff(recall, prepend=0.0) * best))


def balanced_score(score: NDArray[np.float64], hit: NDArray[np.bool_], objects: int, slack: float = 0.0) -> float:
    """The operating score with the highest F1, the harmonic mean of precision and recall.

    Args:
        score: (k,) of detections.
        hit: (k,) whether each is right.
        slack: the lowest score is taken whose F1 is no more than this below the highest: F1 is flat near its peak, and
            on few images the peak's place is a matter of chance.

    Returns:
        0 to 1, NaN where nothing right is found.
    """
    if not hit.any():
        return float("nan")
    order = np.argsort(-score, kind="stable")
    # F1 = 2 TP / (TP + FP + objects)
    f1 = 2.0 * np.cumsum(hit[order]) / (np.arange(1, len(order) + 1) + objects)
    # as above, of each score its last
    last = np.append(np.diff(score[order]) != 0.0, True)
    good = np.flatnonzero(last & (f1 >= f1[last].max() - slack))
    return float(score[order][int(good[-1])])
