"""Formations that follow a gently winding path."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim.world.motion import STEP_S, Motion
from sim.world.roads import Path
from sim.world.scenario import ScenarioGround
from sim.world.traffic import fleet_speed

__all__ = ["drive_formation", "slots"]

FloatArray = NDArray[np.float64]


def slots(formation: str, n: int, spacing_m: float) -> FloatArray:
    """(n, 2) metres ahead of and to the right of the formation's middle."""
    i = np.arange(n, dtype=np.float64)
    if formation == "line":
        places = np.stack([np.zeros(n), i], axis=-1)
    elif formation == "column":
        places = np.stack([-i, np.zeros(n)], axis=-1)
    elif formation == "wedge":
        rank = np.ceil(i / 2.0)
        places = np.stack([-rank, rank * np.where(i % 2 == 1, 1.0, -1.0)], axis=-1)
    elif formation == "triangle":
        rank = np.floor((np.sqrt(8.0 * i + 1.0) - 1.0) / 2.0)
        # rank r has r + 1 places, each half a side inwards of the next rank's
        along, across = -rank * np.sqrt(3.0) / 2.0, i - rank * (rank + 1.0) / 2.0 - rank / 2.0
        places = np.stack([along, across], axis=-1)
    else:
        columns = int(np.ceil(np.sqrt(n)))
        places = np.stack([-(i // columns), i % columns], axis=-1)
    centred: FloatArray = (places - 0.5 * (places.max(axis=0) + places.min(axis=0))) * spacing_m
    return centred


def drive_formation(
    path: Path, t: FloatArray, places: FloatArray, ground: ScenarioGround, rng: np.random.Generator
) -> Motion:
    """Hold places (n, 2) relative to a point that moves along the path, to within the station keeping."""
    cruise = fleet_speed(t, ground.speed_mps, rng)
    reference = np.concatenate([[0.0], np.cumsum(cruise[:-1]) * STEP_S])
    waves = _slow_waves(t, 2 * len(places), rng).reshape(len(t), len(places), 2)
    wander = ground.station_keeping_m * np.sqrt(2.0) * waves
    s = reference[:, None] + places[:, 0] + wander[..., 0]
    d = places[:, 1] + wander[..., 1]
    xy, theta, kappa = path.at(s, d)
    along = np.gradient(s, STEP_S, axis=0) * (1.0 - kappa * d)
    across = np.gradient(d, STEP_S, axis=0)
    return Motion(t=t, xy=xy, heading=theta + np.arctan2(across, along), speed=np.hypot(along, across))


def _slow_waves(t: FloatArray, n: int, rng: np.random.Generator) -> FloatArray:
    periods, phases = rng.uniform(8.0, 25.0, n), rng.uniform(0.0, 2.0 * np.pi, n)
    return np.asarray(np.sin(2.0 * np.pi * t[:, None] / periods + phases))
