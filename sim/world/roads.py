"""A centre line by arc length, and places beside it. ENU metres; headings clockwise from north; d to the right."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]

STEP_M = 0.5
"""Distance between points of a line: far below the radius of any bend."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Path:
    """A smooth line sampled every half metre."""

    s: FloatArray
    """(k,) arc length, metres."""
    xy: FloatArray
    """(k, 2) ENU metres."""
    theta: FloatArray
    """(k,) heading of the tangent, radians, unwrapped."""
    kappa: FloatArray
    """(k,) dθ/ds, 1/m, positive when turning right."""

    def at(self, s: ArrayLike, d: ArrayLike = 0.0) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Places at arc length s, d metres to the right of the line.

        Returns:
            xy (..., 2), heading of the tangent (...), curvature (...).
        """
        s = np.asarray(s, dtype=np.float64)
        d = np.asarray(d, dtype=np.float64)
        theta = np.interp(s, self.s, self.theta)
        # p = C(s) + d n(s), n = (cos θ, −sin θ)
        x = np.interp(s, self.s, self.xy[:, 0]) + d * np.cos(theta)
        y = np.interp(s, self.s, self.xy[:, 1]) - d * np.sin(theta)
        return np.stack([x, y], axis=-1), theta, np.interp(s, self.s, self.kappa)


def winding_path(
    rng: np.random.Generator, start_m: float, stop_m: float, mean: float, bend_rad: float, bend_length_m: float
) -> Path:
    """A line that swings to both sides of a mean direction (clockwise from north) and passes (0, 0) at s = 0.

    The tangent never leaves ±``bend_rad`` about the mean, so below 90° the line cannot cross itself.
    """
    s = np.arange(np.floor(start_m / STEP_M), np.ceil(stop_m / STEP_M) + 1) * STEP_M
    phase_a, phase_b = rng.uniform(0.0, 2.0 * np.pi, 2)
    wave_a, wave_b = 2.0 * np.pi / bend_length_m, 2.0 * np.pi / (0.6 * bend_length_m)
    # θ(s) = θ₀ + β (0.7 sin(ω₁s + φ₁) + 0.3 sin(ω₂s + φ₂));  dC/ds = (sin θ, cos θ)
    theta = mean + bend_rad * (0.7 * np.sin(wave_a * s + phase_a) + 0.3 * np.sin(wave_b * s + phase_b))
    kappa = bend_rad * (0.7 * wave_a * np.cos(wave_a * s + phase_a) + 0.3 * wave_b * np.cos(wave_b * s + phase_b))
    tangent = np.stack([np.sin(theta), np.cos(theta)], axis=-1)
    steps = 0.5 * (tangent[1:] + tangent[:-1]) * STEP_M
    xy = np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
    xy = xy - xy[int(np.argmin(np.abs(s)))]
    return Path(s=s, xy=xy, theta=theta, kappa=kappa)
