"""Sway of a camera beyond the pose that is reported: turns beyond its attitude, or moves beyond its place."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from assoc.geometry.ground import EAST, NORTH, PITCH, ROLL, THETA, YAW

FloatArray = NDArray[np.float64]
_WANDER_SHARE, _WANDER_S = 0.25, 3.0
_MIN_WANDER_M, _MAX_WANDER_M = 0.01, 1.0
"""A receiver that is off by tens of metres hardly wanders faster than one that is off by a few."""
FAST_MPS = 4.0
"""Speed from which a camera's places wander, m/s: filters smooth them and are late, more or less, in each turn."""
_FLIGHT_S, _TURN_S = 0.12, 1.5
"""Time of flight by which places are off, 1σ, and the correlation length of that, seconds: a turn."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SwayPrior:
    """Prior of a sway: of what, by how much and how fast."""

    axes: tuple[int, ...]
    """Numbers of θ."""
    std: float
    """1σ of each, radians or metres."""
    length_s: float
    """Correlation length, seconds."""
    counted: float = 0.25
    """Share of the cost of its freedom that counts against the film: what each block can bring is bounded, too."""
    free: bool = False
    """True if nothing is reported that bounds it."""


TURNS = SwayPrior(axes=(YAW, PITCH, ROLL), std=float(np.deg2rad(0.4)), length_s=0.8)
"""Rest that attitude and boxes leave of the sway of a camera that is fixed to the body."""
FREE_TURNS = SwayPrior(axes=(YAW, PITCH, ROLL), std=float(np.deg2rad(2.5)), length_s=0.8, free=True)
"""Rest that boxes alone leave of it."""


def wander_of(position_std_m: float) -> SwayPrior:
    """Error of a path through coarse positions: it is off for good by most of their 1σ, and wanders by a share."""
    std_m = min(max(_WANDER_SHARE * position_std_m, _MIN_WANDER_M), _MAX_WANDER_M)
    return SwayPrior(axes=(EAST, NORTH), std=std_m, length_s=_WANDER_S, counted=1.0)


def wander_in_flight(speed_mps: float) -> SwayPrior:
    """Prior of how reported places of a camera in fast flight wander, metres: as far as it flies in 0.12 s.

    Filters smooth positions, so that they are late by more in one turn than in another.

    Args:
        speed_mps: Of the flight, m/s.
    """
    return SwayPrior(axes=(EAST, NORTH), std=min(_FLIGHT_S * speed_mps, _MAX_WANDER_M), length_s=_TURN_S)


@dataclass(frozen=True, slots=True, kw_only=True)
class Sway:
    """Some numbers of the pose over time, beyond those in θ."""

    t: FloatArray
    """(K,) video time, seconds, ascending."""
    off: FloatArray
    """(K, A) radians or metres, of the prior's axes."""
    prior: SwayPrior
    """Prior under which the sway was fitted."""
    cost: float = 0.0
    """Cost of its freedom to the evidence for the film, nats: with it, some of what is not so fits as well."""

    def at(self, t: FloatArray) -> FloatArray:
        """(N, 9) beyond θ at times (N,), straight between two knots, constant beyond the last."""
        beyond = np.zeros((len(t), THETA))
        for axis, off in zip(self.prior.axes, self.off.T, strict=True):
            beyond[:, axis] = np.interp(t, self.t, off)
        return beyond
