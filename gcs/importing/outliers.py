"""Samples that stand alone: what comes before and after them is together, and nothing moves out and back so fast."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

__all__ = ["alone", "metres", "usual_step"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_DEG_M = 111_320.0
_STEPS = 3.0
"""Usual steps, and the way between those before and after, that a sample may be off by as well."""
_LEAST = 3


def alone(t_us: Ints, path: Floats, far: float, fastest: float) -> NDArray[np.bool_]:
    """(n,) which samples are farther off than ``far`` from both neighbours, who are near each other.

    Args:
        t_us: (n,) increasing.
        path: (n, k) in any unit.
        far: in that unit; what is nearer may be noise.
        fastest: per second; nothing of which this is measured goes out and back faster.
    """
    found = np.zeros(len(t_us), np.bool_)
    if len(t_us) < _LEAST:
        return found
    leg, step_s = _steps(path), np.diff(t_us) * 1e-6
    past = np.linalg.norm(path[2:] - path[:-2], axis=1)
    with np.errstate(invalid="ignore"):
        off = np.minimum(leg[:-1], leg[1:]) > far + _STEPS * (past + usual_step(path))
        fast = (leg[:-1] > fastest * step_s[:-1]) & (leg[1:] > fastest * step_s[1:])
    found[1:-1] = off & fast
    return found


def usual_step(path: Floats) -> float:
    """Median distance of samples (n, k) that follow each other and differ."""
    step = _steps(path)
    step = step[step > 0.0]
    return float(np.median(step)) if len(step) else 0.0


def metres(places: Floats) -> Floats:
    """Places (n, 2) in degrees as metres north and east of the middle of all."""
    lat, lon = np.median(places[:, 0]), np.median(places[:, 1])
    east = (places[:, 1] - lon + 180.0) % 360.0 - 180.0
    return np.column_stack([places[:, 0] - lat, east * math.cos(math.radians(float(lat)))]) * _DEG_M


def _steps(path: Floats) -> Floats:
    return np.asarray(np.linalg.norm(np.diff(path, axis=0), axis=1))
