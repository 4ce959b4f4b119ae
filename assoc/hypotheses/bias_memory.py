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
    """Bias estimate of each vehicle from the last update in which a track was confidently named as it."""

    def __init__(self, n: int) -> None:
        self._mean = np.zeros((n, 2))
        self._var = np.full(n, np.inf)
        self._t = np.full(n, -np.inf)

    def store(self, t: float, vehicles: IntArray, mean: FloatArray, var: FloatArray) -> None:
        """Store (p, 2) means, metres, and (p,) variances per axis, m², of some vehicles at time t, seconds."""
        self._mean[vehicles], self._var[vehicles], self._t[vehicles] = mean, var, t

    def recall(self, t: float, bias_std: float, tau_s: float) -> tuple[FloatArray, FloatArray]:
        """Stored biases propagated to time t: M λ, (V + 0.05) λ² + (1 − λ²) σ_b², λ = exp(−Δt/τ); else the prior.

        Args:
            t: Time, seconds.
            bias_std: σ_b, metres.
            tau_s: τ, seconds.

        Returns:
            (n, 2) means, metres, and (n,) variances per axis, m².
        """
        known = np.isfinite(self._var)
        decay = np.where(known, np.exp(-(t - np.where(known, self._t, t)) / tau_s), 0.0)
        var = np.where(known, self._var + _NEW_TRACK_VAR_M2, 0.0) * decay**2 + (1.0 - decay**2) * bias_std**2
        return self._mean * decay[:, None], np.minimum(var, bias_std**2)
