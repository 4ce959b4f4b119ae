"""Families of one trouble at a time: as far as it goes in ordinary flights, and to where information runs out.

Each function makes the k-th kind of session of its family; what is random comes from the generator. The parts that the
families of the other modules share are here too.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from sim.world.error_draws import gnss, hard_errors, signed, slight, standard_errors
from sim.world.scenario import (
    Blackout,
    Scenario,
    ScenarioAttitude,
    ScenarioCamera,
    ScenarioDetector,
    ScenarioFault,
    ScenarioFlight,
    ScenarioGround,
    ScenarioTiming,
    Targets,
)

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


GROUNDS = ("straight", "curved", "open", "straight 2", "curved 2", "open 2")
VIEWS = (
    "straight 1 m 0°",
    "curved 2 m 90°",
    "straight 3 m 180°",
    "curved 4 m 0°",
    "straight 4 m 90°",
    "curved 1 m 180°",
)
BIASES_M = (0.5, 1.0, 1.5, 2.0, 2.5, 3.0)
FORMATIONS = ("line", "column", "wedge", "grid", "3 + person", "parked")
MOUNTS = ("-45°", "orbit -45°", "climb", "yaw 12°/s", "fixed", "fixed -60°")
CROWDS = (20, 20, 30, 30, 40, 50)
FAULTS = ("silent", "zero", "frozen", "spoof", "silent and back", "frozen and back")
UNLIKE = ("tau 10 s", "tau 600 s", "satellite steps", "slope 3°", "merged boxes", "coarse boxes")

DENSE = ("straight 4 m", "curved 4 m", "curved 6 m")
CLOSE = (("8, 3 m", 8, 3.0), ("10, 3.5 m", 10, 3.5), ("12, 4 m", 12, 4.0))
TIGHT = ("grid 4 m", "line 4 m", "column 4 m", "wedge 5 m", "triangle 4 m")
TIGHT_BIAS_M = (2.0, 1.5, 1.5, 2.5, 1.5)
MOUNTS_HARD = ("-35° fixed, 6°/s", "nadir 20°/s", "-35° fixed, 12°/s")
WIDE = ("12 wide", "look-alikes in the queue", "12 wide and look-alikes")
FAULTS_HARD = ("jump", "lag", "drift", "two at once")
BLIND = ("false target", "yaw 6°/s", "equal line", "fixed")
UNLIKE_HARD = ("tau 10 s and steps", "slope 5°, oblique", "merged and look-alikes")


def nominal(k: int, rng: np.random.Generator) -> Scenario:
    errors = standard_errors(rng)
    return session(rng, ground=road(k), gnss=errors.gnss, attitude=errors.attitude)


def paper_noise(k: int, rng: np.random.Generator) -> Scenario:
    """White noise alone, six in view and one outside, positions ten times a second."""
    kind, sigma, _, yaw = VIEWS[k].split()
    return session(
        rng,
        ground=ScenarioGround(
            kind="straight" if kind == "straight" else "curved", vehicles=6, outside=1, bend_deg=35.0
        ),
        flight=ScenarioFlight(height_m=48.0, yaw_deg=float(yaw.rstrip("°"))),
        gnss=gnss(rng, white=float(sigma), bias=0.0),
        timing=ScenarioTiming(rate_min_hz=10.0, rate_max_hz=10.0),
    )


def corr_gnss(k: int, rng: np.random.Generator) -> Scenario:
    return session(rng, ground=road(k), gnss=gnss(rng, bias=BIASES_M[k]))


def attitude(k: int, rng: np.random.Generator) -> Scenario:
    """Compass 10-15°, tilt 1-2°, the UAV's position and height 1.5 m off."""
    return session(
        rng, ground=road(k), gnss=gnss(rng, uav_bias_m=1.5, height_bias_m=signed(rng, 1.5, 1.5)), attitude=_tilted(rng)
    )


def timing(k: int, rng: np.random.Generator) -> Scenario:
    return session(
        rng,
        ground=road(k),
        gnss=gnss(rng),
        attitude=slight(rng),
        timing=ScenarioTiming(
            video_offset_s=signed(rng, 0.25, 0.5),
            declared_offset="auto",
            jitter_s=float(rng.uniform(0.05, 0.3)),
            rate_min_hz=1.0,
            rate_max_hz=5.0,
            loss=float(rng.uniform(0.05, 0.2)),
        ),
    )


def false_positives(k: int, rng: np.random.Generator) -> Scenario:
    return session(
        rng,
        ground=road(k),
        gnss=gnss(rng),
        attitude=slight(rng),
        targets=Targets(still=2, moving=2, persons=2),
        detector=ScenarioDetector(miss=float(rng.uniform(0.05, 0.15)), clutter=0.3),
    )


def occlusion(k: int, rng: np.random.Generator) -> Scenario:
    bursts = ScenarioDetector(bursts_per_min=4.0, burst_min_s=1.0, burst_max_s=4.0)
    return session(rng, ground=road(k), detector=bursts)


def in_out(k: int, rng: np.random.Generator) -> Scenario:
    """The UAV roams about the fleet, or the fleet drives about a field wider than the frame."""
    flight = ScenarioFlight() if k % 3 == 2 else ScenarioFlight(roam_m=26.0)
    return session(rng, ground=road(k, area_m=(90.0, 50.0)), flight=flight)


def hard_geometry(k: int, rng: np.random.Generator) -> Scenario:
    """Formations at 5-8 m that move as one body; three vehicles and a person taken for one; a car park."""
    errors = {"gnss": gnss(rng, bias=0.6), "attitude": slight(rng)}
    if FORMATIONS[k] == "3 + person":
        few = ScenarioGround(kind="open", vehicles=3, area_m=(30.0, 16.0))
        return session(rng, ground=few, targets=Targets(persons=1), flight=ScenarioFlight(height_m=39.0), **errors)
    if FORMATIONS[k] == "parked":
        return session(rng, ground=ScenarioGround(kind="parked", vehicles=7, spacing_m=6.0), **errors)
    ground = ScenarioGround(
        kind="formation",
        formation=("line", "column", "wedge", "grid")[k],
        vehicles=9 if k == 3 else 5,
        spacing_m=float(rng.uniform(5.0, 8.0)),
    )
    return session(rng, ground=ground, flight=ScenarioFlight(height_m=48.0), **errors)


def oblique(k: int, rng: np.random.Generator) -> Scenario:
    """Oblique, turning, climbing and fixed cameras."""
    camera = {0: ScenarioCamera(pitch_deg=-45.0), 1: ScenarioCamera(pitch_deg=-45.0), 4: ScenarioCamera(mount="fixed")}
    camera[5] = ScenarioCamera(mount="fixed", pitch_deg=-60.0)
    flight = {
        1: ScenarioFlight(height_m=45.0, yaw_rate_dps=6.0),
        2: ScenarioFlight(climb_mps=1.0),
        3: ScenarioFlight(yaw_rate_dps=12.0),
    }
    area = (30.0, 18.0)
    return session(
        rng,
        ground=road(k, vehicles=6, area_m=area),
        camera=camera.get(k, ScenarioCamera()),
        flight=flight.get(k, ScenarioFlight(height_m=45.0)),
    )


def scale(k: int, rng: np.random.Generator) -> Scenario:
    n = CROWDS[k]
    ground = ScenarioGround(kind=("straight", "curved")[k % 2], vehicles=n, lanes=4, spacing_m=8.0, bend_deg=30.0)
    return session(rng, ground=ground, flight=ScenarioFlight(height_m=35.0 + n))


def no_heading(k: int, rng: np.random.Generator) -> Scenario:
    return session(
        rng,
        ground=road(k),
        gnss=gnss(rng),
        attitude=slight(rng, ugv_heading_missing=True),
        detector=ScenarioDetector(heading_missing=True),
    )


def bad_telemetry(k: int, rng: np.random.Generator) -> Scenario:
    """One vehicle's reports stop, are at 0/0, do not change or are those of another vehicle, from about 12 s on."""
    kind = FAULTS[k].split()[0]
    start = float(rng.uniform(10.0, 14.0))
    stop = start + 10.0 if FAULTS[k].endswith("back") or kind == "zero" else 1e9
    vehicle, other = (int(v) for v in rng.choice(7, 2, replace=False))
    faults = (ScenarioFault(vehicle=vehicle, kind=kind, start_s=start, stop_s=stop, other=other),)  # type: ignore[arg-type]
    return session(rng, ground=road(k), faults=faults)


def pose_free(k: int, rng: np.random.Generator) -> Scenario:
    """The UAV reports its position and neither attitude nor gimbal."""
    flight = ScenarioFlight(height_m=48.0, yaw_deg=float(rng.uniform(0.0, 360.0)))
    return session(rng, ground=road(k), gnss=gnss(rng), attitude=slight(rng, missing=True), flight=flight)


def unmodelled(k: int, rng: np.random.Generator) -> Scenario:
    """Errors that no position filter expects: correlation times, jumps of the fix, slopes, boxes round two vehicles."""
    errors = {
        0: gnss(rng, bias=1.5, tau_s=10.0),
        1: gnss(rng, bias=1.5, tau_s=600.0),
        2: gnss(rng, steps_per_min=2.0, step_m=1.5),
    }
    ground = {3: road(k, slope_deg=3.0, uphill_deg=float(rng.uniform(0.0, 360.0))), 4: road(1, lane_width_m=2.4)}
    detector = {
        4: ScenarioDetector(merge_lengths=1.15),
        5: ScenarioDetector(pixel_noise=4.0, angle_noise_deg=8.0, flip=0.05),
    }
    return session(
        rng, ground=ground.get(k, road(k)), gnss=errors.get(k, gnss(rng)), detector=detector.get(k, ScenarioDetector())
    )


def nominal_hard(k: int, rng: np.random.Generator) -> Scenario:
    """Everything wrong at once."""
    errors = hard_errors(rng)
    return session(
        rng,
        ground=road(k),
        gnss=errors.gnss,
        attitude=errors.attitude,
        timing=errors.timing,
        detector=ScenarioDetector(miss=0.05, flip=0.08, bursts_per_min=2.0, burst_min_s=1.0, burst_max_s=3.0),
        targets=Targets(still=2, moving=2),
    )


def paper_noise_hard(k: int, rng: np.random.Generator) -> Scenario:
    """Nine within 28 m, positions five times a second."""
    kind, sigma, _ = DENSE[k].split()
    road_kind = "straight" if kind == "straight" else "curved"
    ground = ScenarioGround(kind=road_kind, vehicles=9, lanes=2, spacing_m=6.0, bend_deg=35.0)  # type: ignore[arg-type]
    return session(rng, ground=ground, gnss=gnss(rng, white=float(sigma), bias=0.0))


def corr_gnss_hard(k: int, rng: np.random.Generator) -> Scenario:
    _, n, bias = CLOSE[k]
    ground = road(k, vehicles=n, lanes=3, spacing_m=18.0, lane_changes_per_min=4.0, area_m=(70.0, 38.0))
    return session(rng, ground=ground, flight=ScenarioFlight(height_m=58.0), gnss=gnss(rng, bias=bias))


def attitude_hard(k: int, rng: np.random.Generator) -> Scenario:
    """The standard version with three or four vehicles to find the pose by, and the UAV 3 m off."""
    return session(
        rng,
        ground=road(k, vehicles=3 if k == 0 else 4),
        gnss=gnss(rng, uav_bias_m=3.0, height_bias_m=signed(rng, 1.5, 1.5)),
        attitude=_tilted(rng),
    )


def timing_hard(k: int, rng: np.random.Generator) -> Scenario:
    late = ScenarioTiming(
        video_offset_s=signed(rng, 0.25, 0.5),
        declared_offset="auto",
        jitter_s=0.3,
        rate_min_hz=1.0,
        rate_max_hz=2.0,
        loss=0.2,
    )
    return session(rng, ground=road(k), timing=late)


def false_positives_hard(k: int, rng: np.random.Generator) -> Scenario:
    """Three or four look-alikes among ours."""
    ground = road(k, spacing_m=11.0, area_m=(56.0, 32.0))
    alike = Targets(lookalikes=3 + k % 2)
    flight = ScenarioFlight(height_m=50.0)
    return session(rng, ground=ground, flight=flight, gnss=gnss(rng, bias=2.0), targets=alike)


def occlusion_hard(k: int, rng: np.random.Generator) -> Scenario:
    starts = rng.uniform(4.0, 8.0) + np.arange(3) * rng.uniform(8.0, 9.5)
    return session(
        rng,
        ground=road(k),
        gnss=gnss(rng),
        attitude=slight(rng),
        detector=ScenarioDetector(bursts_per_min=3.0, burst_min_s=2.0, burst_max_s=6.0),
        blackouts=tuple(Blackout(start_s=float(s), stop_s=float(s + rng.uniform(1.0, 3.0))) for s in starts),
    )


def in_out_hard(k: int, rng: np.random.Generator) -> Scenario:
    """Twelve over a wide field; other vehicles of our make that drive in the fleet's queue."""
    if k == 1:
        queue = ScenarioGround(kind="curved", vehicles=7, lanes=2, spacing_m=8.0, bend_deg=35.0)
        errors = gnss(rng, bias=2.0)
        flight, alike = ScenarioFlight(roam_m=26.0), Targets(lookalikes=3)
        return session(rng, ground=queue, flight=flight, gnss=errors, targets=alike)
    field = ScenarioGround(kind="open", vehicles=12, area_m=(110.0, 60.0))
    alike = Targets(lookalikes=3 if k == 2 else 0)
    return session(rng, ground=field, gnss=gnss(rng, bias=1.0), targets=alike)


def hard_geometry_hard(k: int, rng: np.random.Generator) -> Scenario:
    """Formations at 4-5 m with position errors of half the spacing."""
    formation, spacing, _ = TIGHT[k].split()
    ground = ScenarioGround(
        kind="formation",
        formation=formation,  # type: ignore[arg-type]
        vehicles={"grid": 9, "triangle": 3}.get(formation, 5),
        spacing_m=float(spacing),
    )
    targets = Targets(persons=1 if k == 4 else 0)
    return session(rng, ground=ground, gnss=gnss(rng, bias=TIGHT_BIAS_M[k]), targets=targets)


def oblique_hard(k: int, rng: np.random.Generator) -> Scenario:
    """A camera fixed to a swaying, turning body at -35°; a nadir view that turns at 20°/s."""
    camera = ScenarioCamera() if k == 1 else ScenarioCamera(mount="fixed", pitch_deg=-35.0)
    flight = ScenarioFlight(height_m=40.0, yaw_rate_dps=(6.0, 20.0, 12.0)[k])
    ground = road(k + 1, vehicles=6, area_m=(24.0, 14.0), spacing_m=7.0)
    targets = Targets(still=1, moving=1)
    return session(rng, ground=ground, camera=camera, flight=flight, gnss=gnss(rng, bias=1.0), targets=targets)


def scale_hard(k: int, rng: np.random.Generator) -> Scenario:
    """Fifty close together and ten others of our make."""
    kind = ("straight", "curved")[k % 2]
    ground = ScenarioGround(kind=kind, vehicles=50, lanes=5, spacing_m=7.0, bend_deg=30.0)  # type: ignore[arg-type]
    alike = Targets(lookalikes=10)
    return session(rng, ground=ground, flight=ScenarioFlight(height_m=85.0), targets=alike)


def no_heading_hard(k: int, rng: np.random.Generator) -> Scenario:
    """A column with errors of 2 m, no heading known."""
    ground = ScenarioGround(kind="formation", formation="column", vehicles=6, spacing_m=(8.0, 9.0, 10.0)[k])
    return session(
        rng,
        ground=ground,
        flight=ScenarioFlight(height_m=44.0),
        gnss=gnss(rng, bias=2.0),
        attitude=slight(rng, ugv_heading_missing=True),
        detector=ScenarioDetector(heading_missing=True),
    )


def bad_telemetry_hard(k: int, rng: np.random.Generator) -> Scenario:
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
    return session(rng, ground=road(k), faults=faults)


def pose_free_hard(k: int, rng: np.random.Generator) -> Scenario:
    yaw = float(rng.uniform(0.0, 360.0))
    errors = {"gnss": gnss(rng, bias=0.8), "attitude": slight(rng, missing=True)}
    if k == 2:
        line = ScenarioGround(kind="formation", formation="line", vehicles=5, spacing_m=6.0)
        return session(rng, ground=line, flight=ScenarioFlight(height_m=48.0, yaw_deg=yaw), **errors)
    flight = ScenarioFlight(height_m=48.0, yaw_deg=yaw, yaw_rate_dps=6.0 if k == 1 else 0.0, tilt_sway_deg=2.5)
    camera = ScenarioCamera(mount="fixed") if k == 3 else ScenarioCamera()
    targets = Targets(moving=1) if k == 0 else Targets()
    return session(rng, ground=road(1, vehicles=6), flight=flight, camera=camera, targets=targets, **errors)


def unmodelled_hard(k: int, rng: np.random.Generator) -> Scenario:
    if k == 0:
        errors = gnss(rng, bias=2.0, tau_s=10.0, steps_per_min=2.0, step_m=2.0)
        return session(rng, ground=road(1), gnss=errors)
    if k == 1:
        slope = road(0, vehicles=6, slope_deg=5.0, uphill_deg=float(rng.uniform(0.0, 360.0)))
        oblique_camera = ScenarioCamera(pitch_deg=-50.0)
        return session(rng, ground=slope, camera=oblique_camera, gnss=gnss(rng, bias=1.0))
    return session(
        rng,
        ground=road(1, lane_width_m=2.4),
        gnss=gnss(rng, bias=1.5),
        detector=ScenarioDetector(merge_lengths=1.2),
        targets=Targets(lookalikes=2),
    )


def _tilted(rng: np.random.Generator) -> ScenarioAttitude:
    return slight(
        rng,
        compass_bias_deg=signed(rng, 10.0, 15.0),
        tilt_pitch_deg=signed(rng, 1.0, 2.0),
        tilt_roll_deg=signed(rng, 1.0, 2.0),
    )
