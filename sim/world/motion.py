"""Trajectories of many bodies on a common time grid, and looking them up between the samples."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]

STEP_S = 0.05
"""Step of the simulation: between two samples a vehicle at 3 m/s² bends 1 mm off the straight line."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Motion:
    """n bodies at T common times."""

    t: FloatArray
    """(T,) seconds, evenly spaced."""
    xy: FloatArray
    """(T, n, 2) ENU metres."""
    heading: FloatArray
    """(T, n) radians clockwise from north, unwrapped in time."""
    speed: FloatArray
    """(T, n) m/s along the heading; negative in reverse."""

    def at(self, t: ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Position (..., n, 2), heading (..., n) and speed (..., n) at times t (...), held beyond the ends."""
        position = np.clip((np.asarray(t, dtype=np.float64) - self.t[0]) / STEP_S, 0.0, len(self.t) - 1.0)
        low = np.minimum(position.astype(np.int64), len(self.t) - 2)
        part = position - low
        return (
            _mix(self.xy, low, part[..., None, None]),
            _mix(self.heading, low, part[..., None]),
            _mix(self.speed, low, part[..., None]),
        )

    def only(self, body: int) -> Motion:
        """The motion of one body, n = 1."""
        one = slice(body, body + 1)
        return Motion(t=self.t, xy=self.xy[:, one], heading=self.heading[:, one], speed=self.speed[:, one])


def time_grid(start_s: float, stop_s: float) -> FloatArray:
    """Sample times that cover start_s..stop_s."""
    first, last = np.floor(start_s / STEP_S), np.ceil(stop_s / STEP_S)
    return np.arange(first, last + 1.0) * STEP_S


def joined(*motions: Motion) -> Motion:
    """The bodies of several motions on the same time grid, in that order."""
    return Motion(
        t=motions[0].t,
        xy=np.concatenate([m.xy for m in motions], axis=1),
        heading=np.concatenate([m.heading for m in motions], axis=1),
        speed=np.concatenate([m.speed for m in motions], axis=1),
    )


def _mix(values: FloatArray, low: NDArray[np.int64], part: FloatArray) -> FloatArray:
    return values[low] * (1.0 - part) + values[low + 1] * part


def wrapped(angle: FloatArray) -> FloatArray:
    """Angles in [−π, π)."""
    return np.asarray((angle + np.pi) % (2.0 * np.pi) - np.pi)
