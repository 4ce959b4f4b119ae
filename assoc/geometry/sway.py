"""How a camera sways beyond the attitude that is reported, if any is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Sway"]

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Sway:
    """Yaw, pitch and roll of the camera over time, beyond those in θ and about the same axes."""

    t: FloatArray
    """(K,) video time, seconds, ascending."""
    turn: FloatArray
    """(K, 3) yaw, pitch and roll, radians."""
    free: bool
    """Whether no attitude is reported that bounds it."""
    cost: float = 0.0
    """What its freedom costs the evidence for the film, nats: with it, some of what is not so fits as well."""

    def at(self, t: FloatArray) -> FloatArray:
        """(N, 3) yaw, pitch and roll at times (N,), radians, straight between two knots, constant beyond the last."""
        return np.stack([np.interp(t, self.t, of_axis) for of_axis in self.turn.T], axis=1)
