"""Errors of an ordinary flight and of a hard one, drawn at random: GNSS, attitude, clocks, radio."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from sim.world.scenario import Gnss, ScenarioAttitude, ScenarioTiming


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightErrors:
    """All errors of what one flight's vehicles report."""

    gnss: Gnss
    attitude: ScenarioAttitude
    timing: ScenarioTiming


def standard_errors(rng: np.random.Generator) -> FlightErrors:
    """Small errors alone: noise 0.3 m, bias 0.5 m, compass within 4°, tilt within 0.8°."""
    return FlightErrors(gnss=gnss(rng), attitude=slight(rng), timing=ScenarioTiming())


def hard_errors(rng: np.random.Generator) -> FlightErrors:
    """Large errors together: bias 1 m, compass 7 to 10°, tilt to 1.5°, video late, one report in ten lost."""
    return FlightErrors(
        gnss=gnss(rng, white=0.5, bias=1.0, uav_bias_m=1.5, height_bias_m=signed(rng, 0.5, 1.5)),
        attitude=slight(
            rng,
            compass_bias_deg=signed(rng, 7.0, 10.0),
            tilt_pitch_deg=signed(rng, 0.8, 1.5),
            tilt_roll_deg=signed(rng, 0.8, 1.5),
        ),
        timing=ScenarioTiming(
            video_offset_s=signed(rng, 0.3, 0.4), declared_offset="auto", rate_min_hz=1.0, jitter_s=0.1, loss=0.1
        ),
    )


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
