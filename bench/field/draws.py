"""Random parts that the families share."""

from __future__ import annotations

from typing import Any

import numpy as np

from sim.world.scenario import Gnss, Scenario, ScenarioAttitude, ScenarioGround

__all__ = ["gnss", "road", "session", "signed", "slight"]

DURATION_S = 36.0


def session(**parts: Any) -> Scenario:  # noqa: ANN401 - the fields of a scenario
    """A scenario of the suite's length and frame rate."""
    return Scenario(**({"duration_s": DURATION_S, "fps": 10.0} | parts))


def signed(rng: np.random.Generator, least: float, most: float) -> float:
    """A magnitude between the two, either way."""
    return float(rng.uniform(least, most) * rng.choice((-1.0, 1.0)))


def slight(rng: np.random.Generator, **parts: Any) -> ScenarioAttitude:  # noqa: ANN401 - the fields of an attitude
    """Errors of attitude that a good UAV has: compass within 4°, tilt within 0.8°."""
    ordinary = {
        "compass_bias_deg": float(np.clip(rng.normal(0.0, 2.0), -4.0, 4.0)),
        "tilt_pitch_deg": float(np.clip(rng.normal(0.0, 0.4), -0.8, 0.8)),
        "tilt_roll_deg": float(np.clip(rng.normal(0.0, 0.4), -0.8, 0.8)),
    }
    return ScenarioAttitude(**(ordinary | parts))


def gnss(rng: np.random.Generator, *, white: float = 0.3, bias: float = 0.5, **parts: Any) -> Gnss:  # noqa: ANN401
    """Position errors; the UAV's own height is off by a few decimetres."""
    return Gnss(**({"white_m": white, "bias_m": bias, "height_bias_m": float(rng.normal(0.0, 0.3))} | parts))


def road(k: int, *, vehicles: int = 7, **parts: Any) -> ScenarioGround:  # noqa: ANN401 - the fields of a ground
    """Straight, curved or open, in turn."""
    ordinary: dict[str, Any] = {"kind": ("straight", "curved", "open")[k % 3], "spacing_m": 8.0, "bend_deg": 35.0}
    return ScenarioGround(**(ordinary | {"vehicles": vehicles} | parts))
