"""How large the vehicles' wandering biases are, learnt from pairs that are already sure."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from assoc.evidence import PairState, bounded, taken
from assoc.pose import misfit, whiten
from assoc.search import Hypothesis, Scene

__all__ = ["BIAS_STD_M", "learnt_bias"]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

BIAS_STD_M = np.array([0.4, 0.7, 1.2, 2.0, 3.2, 4.5])
"""Candidates of σ_b, metres."""

_MEDIAN_M, _SPREAD, _WEIGHT = 1.2, 0.7, 2.0
_KEEP = 0.6


def learnt_bias(scene: Scene, best: Hypothesis, tracks: IntArray, vehicles: IntArray, state: PairState,
                now: float) -> float:  # fmt: skip
    """One step of σ_b towards the likeliest candidate.

    ln p(σ) = −Σ ln s − ½ Σ e² over the pairs' innovations − ½ w (ln σ/1.2)² / 0.7²

    Args:
        scene: The update's scene.
        best: Its best hypothesis.
        tracks: (p,) rows of sure pairs.
        vehicles: (p,) their vehicles.
        state: Evidence of all columns before the first block, variances as they are known.
        now: Present σ_b, metres.

    Returns:
        σ_b, metres.
    """
    if not len(tracks):
        return now
    raw = taken(state, scene.columns)
    value = np.zeros(len(BIAS_STD_M))
    for k, std in enumerate(BIAS_STD_M.tolist()):
        white = whiten(best.blocks, tracks, vehicles, bounded(raw, std), replace(scene.noise, bias_std=std))
        value[k] = -np.sum(white.log_det) - np.sum(misfit(white, best.theta))
    value -= 0.5 * _WEIGHT * (np.log(BIAS_STD_M / _MEDIAN_M) / _SPREAD) ** 2
    return float(_KEEP * now + (1.0 - _KEEP) * BIAS_STD_M[int(np.argmax(value))])
