"""The hard version of every family: the same trouble taken to where information begins to run out."""

from __future__ import annotations

import numpy as np

from bench.field.draws import road, session
from sim.world.error_draws import gnss, hard_errors, signed, slight
from sim.world.scenario import (
    Blackout,
    Scenario,
    ScenarioCamera,
    ScenarioDetector,
    ScenarioFault,
    ScenarioFlight,
    ScenarioGround,
    ScenarioTiming,
    Targets,
)

DENSE = ("straight 4 m", "curved 4 m", "curved 6 m")
CLOSE = (("8, 3 m", 8, 3.0), ("10, 3.5 m", 10, 3.5), ("12, 4 m", 12, 4.0))
TIGHT = ("grid 4 m", "line 4 m", "column 4 m", "wedge 5 m", "triangle 4 m")
TIGHT_BIAS_M = (2.0, 1.5, 1.5, 2.5, 1.5)
MOUNTS = ("-35° fixed, 6°/s", "nadir 20°/s", "-35° fixed, 12°/s")
WIDE = ("12 wide", "look-alikes in the queue", "12 wide and look-alikes")
FAULTS = ("jump", "lag", "drift", "two at once")
BLIND = ("false target", "yaw 6°/s", "equal line", "fixed")
UNLIKE = ("tau 10 s and steps", "slope 5°, oblique", "merged and look-alikes")


def nominal(k: int, rng: np.random.Generator) -> Scenario:
    """Everything wrong at once."""
    errors = hard_errors(rng)
    return session(
        ground=road(k),
        gnss=errors.gnss,
        attitude=errors.attitude,
        timing=errors.timing,
        detector=ScenarioDetector(miss=0.05, flip=0.08, bursts_per_min=2.0, burst_min_s=1.0, burst_max_s=3.0),
        targets=Targets(still=2, moving=2),
    )


def paper_noise(k: int, rng: np.random.Generator) -> Scenario:
    """Nine within 28 m, positions five times a second."""
    kind, sigma, _ = DENSE[k].split()
    road_kind = "straight" if kind == "straight" else "curved"
    ground = ScenarioGround(kind=road_kind, vehicles=9, lanes=2, spacing_m=6.0, bend_deg=35.0)  # type: ignore[arg-type]
    return session(ground=ground, gnss=gnss(rng, white=float(sigma), bias=0.0), attitude=slight(rng))


def corr_gnss(k: int, rng: np.random.Generator) -> Scenario:
    _, n, bias = CLOSE[k]
    ground = road(k, vehicles=n, lanes=3, spacing_m=18.0, lane_changes_per_min=4.0, area_m=(70.0, 38.0))
    return session(ground=ground, flight=ScenarioFlight(height_m=58.0), gnss=gnss(rng, bias=bias), attitude=slight(rng))


def attitude(k: int, rng: np.random.Generator) -> Scenario:
    """As the standard version with three or four vehicles to find the pose by, and the UAV 3 m off."""
    return session(
        ground=road(k, vehicles=3 if k == 0 else 4),
        gnss=gnss(rng, uav_bias_m=3.0, height_bias_m=signed(rng, 1.5, 1.5)),
        attitude=slight(
            rng,
            compass_bias_deg=signed(rng, 10.0, 15.0),
            tilt_pitch_deg=signed(rng, 1.0, 2.0),
            tilt_roll_deg=signed(rng, 1.0, 2.0),
        ),
    )


def timing(k: int, rng: np.random.Generator) -> Scenario:
    late = ScenarioTiming(
        video_offset_s=signed(rng, 0.25, 0.5),
        declared_offset="auto",
        jitter_s=0.3,
        rate_min_hz=1.0,
        rate_max_hz=2.0,
        loss=0.2,
    )
    return session(ground=road(k), gnss=gnss(rng), attitude=slight(rng), timing=late)


def false_positives(k: int, rng: np.random.Generator) -> Scenario:
    """Three or four look-alikes among ours."""
    ground = road(k, spacing_m=11.0, area_m=(56.0, 32.0))
    alike = Targets(lookalikes=3 + k % 2)
    flight = ScenarioFlight(height_m=50.0)
    return session(ground=ground, flight=flight, gnss=gnss(rng, bias=2.0), attitude=slight(rng), targets=alike)


def occlusion(k: int, rng: np.random.Generator) -> Scenario:
    starts = rng.uniform(4.0, 8.0) + np.arange(3) * rng.uniform(8.0, 9.5)
    return session(
        ground=road(k),
        gnss=gnss(rng),
        attitude=slight(rng),
        detector=ScenarioDetector(bursts_per_min=3.0, burst_min_s=2.0, burst_max_s=6.0),
        blackouts=tuple(Blackout(start_s=float(s), stop_s=float(s + rng.uniform(1.0, 3.0))) for s in starts),
    )


def in_out(k: int, rng: np.random.Generator) -> Scenario:
    """Twelve over a wide field; other vehicles of our make that drive in the fleet's queue."""
    if k == 1:
        queue = ScenarioGround(kind="curved", vehicles=7, lanes=2, spacing_m=8.0, bend_deg=35.0)
        errors = gnss(rng, bias=2.0)
        flight, alike = ScenarioFlight(roam_m=26.0), Targets(lookalikes=3)
        return session(ground=queue, flight=flight, gnss=errors, attitude=slight(rng), targets=alike)
    field = ScenarioGround(kind="open", vehicles=12, area_m=(110.0, 60.0))
    alike = Targets(lookalikes=3 if k == 2 else 0)
    return session(ground=field, gnss=gnss(rng, bias=1.0), attitude=slight(rng), targets=alike)


def hard_geometry(k: int, rng: np.random.Generator) -> Scenario:
    """Formations at 4-5 m with position errors of half the spacing."""
    formation, spacing, _ = TIGHT[k].split()
    ground = ScenarioGround(
        kind="formation",
        formation=formation,  # type: ignore[arg-type]
        vehicles={"grid": 9, "triangle": 3}.get(formation, 5),
        spacing_m=float(spacing),
    )
    targets = Targets(persons=1 if k == 4 else 0)
    return session(ground=ground, gnss=gnss(rng, bias=TIGHT_BIAS_M[k]), attitude=slight(rng), targets=targets)


def oblique(k: int, rng: np.random.Generator) -> Scenario:
    """A camera fixed to a swaying, turning body at -35°; a nadir view that turns at 20°/s."""
    camera = ScenarioCamera() if k == 1 else ScenarioCamera(mount="fixed", pitch_deg=-35.0)
    flight = ScenarioFlight(height_m=40.0, yaw_rate_dps=(6.0, 20.0, 12.0)[k])
    ground = road(k + 1, vehicles=6, area_m=(24.0, 14.0), spacing_m=7.0)
    targets = Targets(still=1, moving=1)
    return session(
        ground=ground, camera=camera, flight=flight, gnss=gnss(rng, bias=1.0), attitude=slight(rng), targets=targets
    )


def scale(k: int, rng: np.random.Generator) -> Scenario:
    """Fifty close together and ten others of our make."""
    kind = ("straight", "curved")[k % 2]
    ground = ScenarioGround(kind=kind, vehicles=50, lanes=5, spacing_m=7.0, bend_deg=30.0)  # type: ignore[arg-type]
    alike = Targets(lookalikes=10)
    return session(
        ground=ground, flight=ScenarioFlight(height_m=85.0), gnss=gnss(rng), attitude=slight(rng), targets=alike
    )


def no_heading(k: int, rng: np.random.Generator) -> Scenario:
    """A column with errors of 2 m, no heading known."""
    ground = ScenarioGround(kind="formation", formation="column", vehicles=6, spacing_m=(8.0, 9.0, 10.0)[k])
    return session(
        ground=ground,
        flight=ScenarioFlight(height_m=44.0),
        gnss=gnss(rng, bias=2.0),
        attitude=slight(rng, ugv_heading_missing=True),
        detector=ScenarioDetector(heading_missing=True),
    )


def bad_telemetry(k: int, rng: np.random.Generator) -> Scenario:
    start = float(rng.uniform(10.0, 14.0))
    a, b = (int(v) for v in rng.choice(7, 2, replace=False))
    alone = {0: "jump", 1: "lag", 2: "drift"}
    if k in alone:
        faults: tuple[ScenarioFault, ...] = (ScenarioFault(vehicle=a, kind=alone[k], start_s=start),)  # type: ignore[arg-type]
    else:
        faults = (
            ScenarioFault(vehicle=a, kind="jump", start_s=start),
            ScenarioFault(vehicle=b, kind="frozen", start_s=start + 4.0),
        )
    return session(ground=road(k), gnss=gnss(rng), attitude=slight(rng), faults=faults)


def pose_free(k: int, rng: np.random.Generator) -> Scenario:
    yaw = float(rng.uniform(0.0, 360.0))
    errors = {"gnss": gnss(rng, bias=0.8), "attitude": slight(rng, missing=True)}
    if k == 2:
        line = ScenarioGround(kind="formation", formation="line", vehicles=5, spacing_m=6.0)
        return session(ground=line, flight=ScenarioFlight(height_m=48.0, yaw_deg=yaw), **errors)
    flight = ScenarioFlight(height_m=48.0, yaw_deg=yaw, yaw_rate_dps=6.0 if k == 1 else 0.0, tilt_sway_deg=2.5)
    camera = ScenarioCamera(mount="fixed") if k == 3 else ScenarioCamera()
    targets = Targets(moving=1) if k == 0 else Targets()
    return session(ground=road(1, vehicles=6), flight=flight, camera=camera, targets=targets, **errors)


def unmodelled(k: int, rng: np.random.Generator) -> Scenario:
    if k == 0:
        errors = gnss(rng, bias=2.0, tau_s=10.0, steps_per_min=2.0, step_m=2.0)
        return session(ground=road(1), gnss=errors, attitude=slight(rng))
    if k == 1:
        slope = road(0, vehicles=6, slope_deg=5.0, uphill_deg=float(rng.uniform(0.0, 360.0)))
        oblique_camera = ScenarioCamera(pitch_deg=-50.0)
        return session(ground=slope, camera=oblique_camera, gnss=gnss(rng, bias=1.0), attitude=slight(rng))
    return session(
        ground=road(1, lane_width_m=2.4),
        gnss=gnss(rng, bias=1.5),
        attitude=slight(rng),
        detector=ScenarioDetector(merge_lengths=1.2),
        targets=Targets(lookalikes=2),
    )
