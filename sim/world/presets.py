"""Named scenarios."""

from __future__ import annotations

import difflib
from collections.abc import Callable
from dataclasses import replace

from sim.errors import ScenarioError
from sim.world.scenario import (
    Gnss,
    Occlusion,
    Scenario,
    ScenarioCamera,
    ScenarioFlight,
    ScenarioGround,
    ScenarioTiming,
    ScenarioView,
    Targets,
)


def nominal(seed: int = 1) -> Scenario:
    """Seven vehicles on a winding road for a minute, ordinary errors, nothing in the way."""
    return Scenario(
        name="nominal",
        seed=seed,
        ground=ScenarioGround(kind="curved", vehicles=7, spacing_m=8.0, lanes=2, bend_deg=35.0),
        gnss=Gnss(white_m=0.3, bias_m=0.5),
    )


def curved_road(seed: int = 2) -> Scenario:
    """Six of ours on a winding road, a seventh out of view, a canopy at a turn, a look-alike at the roadside."""
    return Scenario(
        name="curved-road",
        seed=seed,
        duration_s=32.0,
        scenery="dressed",
        ground=ScenarioGround(kind="curved", vehicles=6, outside=1, speed_mps=3.2, spacing_m=9.0, lanes=3),
        flight=ScenarioFlight(height_m=40.0, sway_m=0.8),
        gnss=Gnss(white_m=0.3, bias_m=0.6, tau_s=60.0),
        camera=ScenarioCamera(crf=31),
        timing=ScenarioTiming(rate_min_hz=5.0, rate_max_hz=5.0),
        targets=Targets(parked_lookalikes=1),
        occlusions=(Occlusion(vehicle=0, t_s=20.0, duration_s=2.2),),
    )


def hand_over(seed: int = 3) -> Scenario:
    """Five in a row along a road; one camera hovers over its begin, a second one over where they come to later."""
    hover = ScenarioFlight(height_m=40.0, follow=False)
    timing = ScenarioTiming(video_offset_s=-0.3)
    return Scenario(
        name="hand-over",
        seed=seed,
        ground=ScenarioGround(kind="straight", vehicles=5, spacing_m=8.0, lanes=2, stops_per_min=0.0),
        flight=hover,
        views=(ScenarioView(aside_m=(90.0, 0.0), flight=replace(hover, yaw_deg=60.0), timing=timing),),
    )


PRESETS: dict[str, Callable[[], Scenario]] = {
    "nominal": nominal,
    "curved-road": curved_road,
    "hand-over": hand_over,
}
"""Scenarios by the name that the command line knows."""


def preset(name: str) -> Scenario:
    """The scenario of that name.

    Raises:
        ScenarioError: if there is none, with the nearest name.
    """
    if name not in PRESETS:
        near = difflib.get_close_matches(name, PRESETS, n=1, cutoff=0.0)[0]
        raise ScenarioError(f"{name}: no such scenario; did you mean {near}? There are {', '.join(PRESETS)}")
    return PRESETS[name]()
