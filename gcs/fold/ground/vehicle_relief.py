"""Bumps and hollows under each vehicle, by how its own altitude changes while it drives.

An altitude above the plane is the vehicle's constant error, the relief under it, and noise. A filter of z and its rate
with the time constant T follows it (gains α = 1 − λ², β = (1 − λ)², λ = exp(−Δt/T)). What it is above its own mean of
some time is relief, in the share of its variance that noise does not explain.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

FOLLOWS_S = 1.2
"""Time constant T: a wave of 90 m takes a vehicle 10 to 20 s."""
MEMORY_S = 20.0
"""Time of the mean, and of the variances."""
NOISE_LEFT = 0.3
"""Variance of the filter's answer over that of its innovations, for reports five times a second that are noise."""
MIN_VAR = 0.15**2
"""Variance of the relief, m², that counts as flat ground: a decimetre or two."""


class VehicleRelief:
    """Heights of the vehicles above the plane that all drive on.

    Attributes:
        heights_m: (n,) metres, 0 unknown.
    """

    def __init__(self, n: int) -> None:
        self.heights_m: FloatArray = np.zeros(n)
        self._z, self._rate = np.full(n, np.nan), np.zeros(n)
        self._mean, self._weight = np.zeros(n), np.zeros(n)
        self._noise_var = self._var = 0.0

    def update(self, above_m: FloatArray, dt_s: float) -> None:
        """Take in the altitudes of one moment.

        Args:
            above_m: (n,) altitudes above the plane, NaN unknown.
            dt_s: time since the last one.
        """
        known, before = np.isfinite(above_m), np.isfinite(self._z)
        if dt_s <= 0.0:
            return
        keep, memory = math.exp(-dt_s / FOLLOWS_S), math.exp(-dt_s / MEMORY_S)
        predicted = self._z + self._rate * dt_s
        innovation = np.where(known & before, above_m - predicted, 0.0)
        self._z = np.where(known, np.where(before, predicted + (1.0 - keep**2) * innovation, above_m), np.nan)
        self._rate = np.where(known & before, self._rate + (1.0 - keep) ** 2 / dt_s * innovation, 0.0)
        self._mean = np.where(known, self._mean * memory + self._z * dt_s, self._mean * memory)
        self._weight = np.where(known, self._weight * memory + dt_s, self._weight * memory)
        deviation = np.where(known, self._z - self._mean / np.maximum(self._weight, 1e-9), 0.0)
        if known.any():
            self._noise_var += (1.0 - memory) * (float(np.mean(innovation[known] ** 2)) - self._noise_var)
            self._var += (1.0 - memory) * (float(np.mean(deviation[known] ** 2)) - self._var)
        noise = NOISE_LEFT * self._noise_var + MIN_VAR
        self.heights_m = deviation * max(1.0 - noise / max(self._var, 1e-9), 0.0)
