"""The last estimate of each vehicle's position bias, with which the bias filter of a new track starts."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["BiasMemory"]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_NEW_TRACK_VAR_M2 = 0.05
"""Variance added to a stored bias, m²: a new track's box may be centred a little differently on its vehicle."""


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
