"""The last estimate of each vehicle's position bias, with which the bias filter of a new track starts."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from assoc.evidence.likelihood import PairState, select_tracks
from assoc.hypotheses.pose import BiasModels, log_evidence
from assoc.hypotheses.search import Hypothesis, UpdateContext

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
_NEW_TRACK_VAR_M2 = 0.05
"""Variance added to a stored bias, m²: a new track's box may be centred a little differently on its vehicle."""
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


class BiasMemory:
    """Bias estimate of each vehicle from the last update in which a track was confidently named as it.

    The estimate by the track before that one is kept as well. If a new track is the vehicle, one that has its name
    and is still seen is another: what that one taught says nothing about the new track, what came before it does.
    """

    def __init__(self, n: int) -> None:
        # [0] by the last track that was named, [1] by the one before
        self._mean = np.zeros((2, n, 2))
        self._var = np.full((2, n), np.inf)
        self._t = np.full((2, n), -np.inf)
        self._track = np.zeros((2, n), np.int64)

    def store(self, t: float, vehicles: IntArray, tracks: IntArray, mean: FloatArray, var: FloatArray) -> None:
        """Store the biases of some vehicles.

        Args:
            t: Time, seconds.
            vehicles: (p,) their indices.
            tracks: (p,) ids of the tracks that were named as them.
            mean: (p, 2) means, metres.
            var: (p,) variances per axis, m².
        """
        changed = vehicles[self._track[0, vehicles] != tracks]
        for kept in (self._mean, self._var, self._t, self._track):
            kept[1, changed] = kept[0, changed]
        self._mean[0, vehicles], self._var[0, vehicles], self._t[0, vehicles] = mean, var, t
        self._track[0, vehicles] = tracks

    def recall(
        self, t: float, bias_std: float, tau_s: float, seen: IntArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Stored biases propagated to time t: M λ, (V + 0.05) λ² + (1 − λ²) σ_b², λ = exp(−Δt/τ); else the prior.

        Args:
            t: Time, seconds.
            bias_std: σ_b, metres.
            tau_s: τ, seconds.
            seen: Ids of tracks in sight beside those that the biases are for: what they taught does not count.

        Returns:
            (n, 2) means, metres, and (n,) variances per axis, m².
        """
        n = self._var.shape[1]
        which = np.isin(self._track[0], seen).astype(np.int64) if seen is not None else np.zeros(n, np.int64)
        own = (which, np.arange(n))
        known = np.isfinite(self._var[own])
        decay = np.where(known, np.exp(-(t - np.where(known, self._t[own], t)) / tau_s), 0.0)
        var = np.where(known, self._var[own] + _NEW_TRACK_VAR_M2, 0.0) * decay**2 + (1.0 - decay**2) * bias_std**2
        return self._mean[own] * decay[:, None], np.minimum(var, bias_std**2)
