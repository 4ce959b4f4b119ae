"""Size σ_b and correlation time τ of the vehicles' position biases, learnt from pairs that are already certain."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from assoc.evidence.likelihood import PairState, select_tracks
from assoc.hypotheses.pose import BiasModels, log_evidence
from assoc.hypotheses.search import Hypothesis, UpdateContext

__all__ = ["BIAS_STD_M", "BIAS_TAU_S", "learn_bias_noise"]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

BIAS_STD_M = np.array([0.4, 0.7, 1.2, 2.0, 3.2, 4.5])
"""Candidates of σ_b, metres."""
BIAS_TAU_S = np.array([7.0, 20.0, 60.0, 240.0])
"""Candidates of τ, seconds."""

_MEDIAN_M, _SPREAD, _WEIGHT = 1.2, 0.7, 2.0
"""Prior of σ_b: log-normal, median in metres, 1σ of its log, and its weight in samples."""
_MEDIAN_TAU_S, _TAU_SPREAD = 60.0, 1.0
"""Prior of τ: log-normal, median in seconds and 1σ of its log."""
_SMOOTHING = 0.6
"""Weight of the previous value in exponential smoothing: single steps are noisy."""


def learn_bias_noise(
    context: UpdateContext,
    best: Hypothesis,
    tracks: IntArray,
    vehicles: IntArray,
    state: PairState,
    current: tuple[float, float],
) -> tuple[float, float]:
    """Move σ_b and τ one smoothed step towards the candidates of largest posterior probability.

    ln p(σ, τ) = −Σ ln s − ½ Σ e² over the pairs' innovations − Σ ln (σ² + V) − ½ Σ |M|²/(σ² + V) over the biases that
    were known before the window − ½ w (ln σ/1.2)² / 0.7² − ½ w (ln τ/60)²

    Args:
        context: The update's context.
        best: Its best hypothesis.
        tracks: (p,) rows of certain pairs.
        vehicles: (p,) their vehicles.
        state: Evidence of all columns before the first block; variances not yet limited to the prior's.
        current: Present σ_b, metres, and τ, seconds.

    Returns:
        σ_b, metres, and τ, seconds.
    """
    if not len(tracks):
        return current
    std, tau = (grid.ravel() for grid in np.meshgrid(BIAS_STD_M, BIAS_TAU_S, indexing="ij"))
    models = BiasModels(std=std, decay=np.exp(-context.block_s / tau))
    start = select_tracks(state, context.columns)
    value = log_evidence(best.blocks, tracks, vehicles, best.theta, start, context.noise, models)
    value = value.reshape(len(BIAS_STD_M), len(BIAS_TAU_S))
    # what was seen before the window: each bias that is known by then is a sample of N(0, σ² + V)
    M, V = start.mean[tracks, vehicles], start.var[tracks, vehicles]
    known = np.isfinite(V)
    total = BIAS_STD_M[:, None] ** 2 + V[known]
    value += np.sum(-np.log(total) - np.sum(M[known] ** 2, axis=1) / (2.0 * total), axis=1)[:, None]
    value -= 0.5 * _WEIGHT * (np.log(BIAS_STD_M / _MEDIAN_M) / _SPREAD)[:, None] ** 2
    value -= 0.5 * _WEIGHT * (np.log(BIAS_TAU_S / _MEDIAN_TAU_S) / _TAU_SPREAD)[None, :] ** 2
    best_std, best_tau = np.unravel_index(int(np.argmax(value)), value.shape)
    new_std = _SMOOTHING * current[0] + (1.0 - _SMOOTHING) * float(BIAS_STD_M[best_std])
    return new_std, float(current[1] ** _SMOOTHING * BIAS_TAU_S[best_tau] ** (1.0 - _SMOOTHING))
