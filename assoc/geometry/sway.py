"""How a camera sways whose attitude nobody reports."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Sway"]

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Sway:
    """Pitch and roll of the camera over time, beyond those in θ and about the same axes."""

    t: FloatArray
    """(K,) video time, seconds, ascending."""
    tilt: FloatArray
    """(K, 2) pitch and roll, radians."""
    cost: float = 0.0
    """What its freedom costs the evidence for the film, nats: with it, some of what is not so fits as well."""

    def at(self, t: FloatArray) -> FloatArray:
        """(N, 2) pitch and roll at times (N,), radians, straight between two knots and constant beyond the last."""
        return np.stack([np.interp(t, self.t, self.tilt[:, axis]) for axis in (0, 1)], axis=1)
