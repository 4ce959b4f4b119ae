"""What is remembered of a vehicle's position bias, so that a new track of it is known at once."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["BiasMemory"]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_FRESHNESS_VAR = 0.05
"""Variance added to a remembered bias, m²: a new track's box lies a little differently on its vehicle."""


class BiasMemory:
    """Bias of each vehicle as last seen under a confident name."""

    def __init__(self, n: int) -> None:
        self._mean = np.zeros((n, 2))
        self._var = np.full(n, np.inf)
        self._t = np.full(n, -np.inf)

    def store(self, t: float, vehicles: IntArray, mean: FloatArray, var: FloatArray) -> None:
        """Keep (p, 2) means and (p,) variances of some vehicles."""
        self._mean[vehicles], self._var[vehicles], self._t[vehicles] = mean, var, t

    def recall(self, t: float, bias_std: float, tau_s: float) -> tuple[FloatArray, FloatArray]:
        """Bias now: M λ, (V + 0.05) λ² + (1 − λ²) σ_b²; the prior where nothing is known.

        Returns:
            (n, 2) means and (n,) variances.
        """
        known = np.isfinite(self._var)
        decay = np.where(known, np.exp(-(t - np.where(known, self._t, t)) / tau_s), 0.0)
        var = np.where(known, self._var + _FRESHNESS_VAR, 0.0) * decay**2 + (1.0 - decay**2) * bias_std**2
        return self._mean * decay[:, None], np.minimum(var, bias_std**2)
