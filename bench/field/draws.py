"""Random parts that the families share."""

from __future__ import annotations

from typing import Any

import numpy as np

from sim.world.error_draws import gnss, slight
from sim.world.scenario import Scenario, ScenarioGround

DURATION_S = 36.0
FROM_THE_START_S = -60.0
"""Start of a fault that lasts for the whole flight, s: before the first telemetry."""


def session(rng: np.random.Generator, **parts: Any) -> Scenario:  # noqa: ANN401 - the fields of a scenario
    """A scenario of the suite's length and frame rate; errors of positions and attitude, if not given, are drawn."""
    ordinary = {"duration_s": DURATION_S, "fps": 10.0}
    for name, draw in (("gnss", gnss), ("attitude", slight)):
        if name not in parts:
            parts[name] = draw(rng)
    return Scenario(**(ordinary | parts))


def road(k: int, *, vehicles: int = 7, **parts: Any) -> ScenarioGround:  # noqa: ANN401 - the fields of a ground
    """Straight, curved or open, in turn."""
    ordinary: dict[str, Any] = {"kind": ("straight", "curved", "open")[k % 3], "spacing_m": 8.0, "bend_deg": 35.0}
    return ScenarioGround(**(ordinary | {"vehicles": vehicles} | parts))
