"""Families of ordinary errors together: strangers, missed boxes, slow biases, what comes late, and who falls silent."""

from __future__ import annotations

import numpy as np

from bench.field.ordinary import FROM_THE_START_S, road, session
from sim.world.error_draws import gnss, signed, slight
from sim.world.scenario import (
    Scenario,
    ScenarioCamera,
    ScenarioDeclared,
    ScenarioDetector,
    ScenarioFault,
    ScenarioFlight,
    ScenarioGround,
    ScenarioTiming,
    Targets,
)

MESSY = ("straight down", "-60°", "-45°")
MESSY_HARD = ("four lanes", "four lanes, -60°", "-35°")
CROWDED = ("recall 0.85", "recall 0.85, bursts", "recall 0.8")
CROWDED_HARD = ("recall 0.7", "recall 0.7, bursts", "recall 0.7, bias 1.5 m")
LATE = ("each to 1 s", "UAV 0.5 s", "film 2 s", "film -1 s")
LATE_HARD = ("each to 1.5 s", "UAV 0.8 s", "film 5 s", "film -3 s, each to 0.7 s")

TWO_BOXES = ("6 m", "4 m", "6 m, -50°")
TWO_BOXES_HARD = ("6 m, 40 %", "4 m, 40 %", "6 m, -50°, bias 1.5 m")
BAYS = ("5 m", "3.5 m", "3.5 m, two strangers")
BAYS_HARD = ("3 m", "3 m, one never found", "3 m, six strangers")

MISSING = ("silent", "frozen", "jump", "lag")
MISSING_HARD = ("silent, silent", "silent, jump", "frozen, drift", "silent from the start")


def messy(label: str, k: int, rng: np.random.Generator) -> Scenario:
    """Seven of ten are ours, and every error is there at an ordinary size.

    Hard: among 18 strangers on four lanes, or seen from far aside.
    """
    ground, strangers = (_lanes(vehicles=6), 18) if "lanes" in label else (road(k), 3)
    pitch_deg = float(label.split()[-1].rstrip("°")) if "°" in label else -90.0
    return session(
        rng,
        ground=ground,
        camera=ScenarioCamera(pitch_deg=pitch_deg),
        flight=ScenarioFlight(height_m=float(rng.uniform(45.0, 60.0)), yaw_sway_deg=8.0),
        gnss=gnss(rng, white=0.4, bias=float(rng.uniform(1.5, 2.5)), tau_s=40.0, height_bias_m=signed(rng, 1.0, 2.0)),
        attitude=slight(rng, compass_bias_deg=signed(rng, 6.0, 12.0)),
        timing=ScenarioTiming(rate_min_hz=1.0, rate_max_hz=2.0, irregular=0.3, loss=0.05),
        detector=ScenarioDetector(miss=0.2, miss_run_s=1.5, size_noise=0.04),
        targets=Targets(lookalikes=strangers),
        faults=_late_each(ground, 0.2, 0.7, rng),
        declared=ScenarioDeclared(focal_share=1.0 + signed(rng, 0.02, 0.04)),
    )


def crowded(label: str, k: int, rng: np.random.Generator) -> Scenario:
    """Five of ours among 20 that look alike on four lanes, of whom some are missed in every frame.

    Hard: among 25, and nearly every third box is missing.
    """
    strangers = 25 if label in CROWDED_HARD else 20
    miss, bursts = 1.0 - float(label.split(",")[0].split()[1]), 2.0 if "bursts" in label else 0.0
    return session(
        rng,
        ground=_lanes(vehicles=5),
        flight=ScenarioFlight(height_m=60.0),
        gnss=gnss(rng, bias=1.5 if "bias" in label else 0.8),
        detector=ScenarioDetector(miss=miss, bursts_per_min=bursts),
        targets=Targets(lookalikes=strangers),
    )


def late(label: str, k: int, rng: np.random.Generator) -> Scenario:
    """Something is older than it says: each vehicle's reports, the UAV's position or the film; hard: more, together."""
    size = {part.split()[0]: float(part.split()[-2]) for part in label.split(", ")}
    ground = road(k % 2)
    uav_lag_s = size.get("UAV", 0.0)
    return session(
        rng,
        ground=ground,
        flight=ScenarioFlight(height_m=50.0, drift_mps=4.0 if uav_lag_s else 0.0, roam_m=12.0 if uav_lag_s else 0.0),
        gnss=gnss(rng),
        attitude=slight(rng),
        timing=ScenarioTiming(
            uav_lag_s=uav_lag_s,
            video_offset_s=size.get("film", 0.0),
            declared_offset="zero" if "film" in size else "exact",
        ),
        faults=_late_each(ground, 0.2, size["each"], rng) if "each" in size else (),
    )


def two_boxes(label: str, k: int, rng: np.random.Generator) -> Scenario:
    """Long vehicles that are found as front and rear for seconds at a time.

    Hard: for more of the time, or with slow errors, seen from aside.
    """
    length, *rest = label.split(", ")
    length_m = float(length.split()[0])
    return session(
        rng,
        ground=road(k, length_m=length_m, width_m=0.38 * length_m, spacing_m=2.0 * length_m),
        camera=ScenarioCamera(pitch_deg=-50.0 if "-50°" in rest else -90.0),
        flight=ScenarioFlight(height_m=float(rng.uniform(45.0, 60.0))),
        gnss=gnss(rng, bias=1.5 if "bias 1.5 m" in rest else 0.8),
        attitude=slight(rng),
        detector=ScenarioDetector(parts=0.4 if "40 %" in rest else 0.25, parts_run_s=float(rng.uniform(1.5, 3.5))),
    )


def bays(label: str, k: int, rng: np.random.Generator) -> Scenario:
    """Vehicles that stand side by side in bays for the whole flight.

    Hard: closer together, among others, or with one that no frame shows.
    """
    apart, *rest = label.split(", ")
    strangers = {"two strangers": 2, "six strangers": 6}.get(rest[0], 0) if rest else 0
    return session(
        rng,
        ground=ScenarioGround(
            kind="bays", vehicles=7, spacing_m=float(apart.split()[0]), length_m=4.2, width_m=1.8, height_m=1.4
        ),
        gnss=gnss(rng, bias=float(rng.uniform(0.4, 0.9))),
        detector=ScenarioDetector(never_found=1 if "one never found" in rest else 0),
        targets=Targets(lookalikes=strangers),
    )


def missing(label: str, k: int, rng: np.random.Generator) -> Scenario:
    """The reports of one vehicle stop, stand still, are 15 m beside it or 3 s late, and strangers drive by.

    Hard: those of two, in two ways, or of one that was never heard.
    """
    start_s = FROM_THE_START_S if "from the start" in label else float(rng.uniform(6.0, 12.0))
    kinds = [part.split()[0] for part in label.split(", ")]
    faults = tuple(
        ScenarioFault(vehicle=int(vehicle), kind=kind, start_s=start_s)  # type: ignore[arg-type]
        for vehicle, kind in zip(rng.choice(7, len(kinds), replace=False), kinds, strict=True)
    )
    return session(
        rng,
        ground=road(k),
        detector=ScenarioDetector(miss=0.05, miss_run_s=1.5),
        targets=Targets(moving=2, lookalikes=2),
        faults=faults,
    )


def _lanes(vehicles: int) -> ScenarioGround:
    return ScenarioGround(kind="straight", vehicles=vehicles, lanes=4, spacing_m=9.0, length_m=4.2, width_m=1.8)


def _late_each(
    ground: ScenarioGround, least_s: float, most_s: float, rng: np.random.Generator
) -> tuple[ScenarioFault, ...]:
    """The reports of each vehicle are late by its own time and dated as if they were not."""
    return tuple(
        ScenarioFault(vehicle=vehicle, kind="lag", start_s=FROM_THE_START_S, size=float(rng.uniform(least_s, most_s)))
        for vehicle in range(ground.vehicles)
    )
