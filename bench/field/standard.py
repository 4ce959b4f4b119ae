"""The standard version of every family: one thing goes wrong at a time, as far as it does in ordinary flights.

Each function makes the k-th kind of session of its family; what is random comes from the generator.
"""

from __future__ import annotations

import numpy as np

from bench.field.draws import road, session
from sim.world.error_draws import gnss, signed, slight, standard_errors
from sim.world.scenario import (
    Scenario,
    ScenarioCamera,
    ScenarioDetector,
    ScenarioFault,
    ScenarioFlight,
    ScenarioGround,
    ScenarioTiming,
    Targets,
)

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


def nominal(k: int, rng: np.random.Generator) -> Scenario:
    errors = standard_errors(rng)
    return session(ground=road(k), gnss=errors.gnss, attitude=errors.attitude)


def paper_noise(k: int, rng: np.random.Generator) -> Scenario:
    """White noise alone, six in view and one outside, positions ten times a second."""
    kind, sigma, _, yaw = VIEWS[k].split()
    return session(
        ground=ScenarioGround(
            kind="straight" if kind == "straight" else "curved", vehicles=6, outside=1, bend_deg=35.0
        ),
        flight=ScenarioFlight(height_m=48.0, yaw_deg=float(yaw.rstrip("°"))),
        gnss=gnss(rng, white=float(sigma), bias=0.0),
        attitude=slight(rng),
        timing=ScenarioTiming(rate_min_hz=10.0, rate_max_hz=10.0),
    )


def corr_gnss(k: int, rng: np.random.Generator) -> Scenario:
    return session(ground=road(k), gnss=gnss(rng, bias=BIASES_M[k]), attitude=slight(rng))


def attitude(k: int, rng: np.random.Generator) -> Scenario:
    """Compass 10-15°, tilt 1-2°, the UAV's position and height 1.5 m off."""
    return session(
        ground=road(k),
        gnss=gnss(rng, uav_bias_m=1.5, height_bias_m=signed(rng, 1.5, 1.5)),
        attitude=slight(
            rng,
            compass_bias_deg=signed(rng, 10.0, 15.0),
            tilt_pitch_deg=signed(rng, 1.0, 2.0),
            tilt_roll_deg=signed(rng, 1.0, 2.0),
        ),
    )


def timing(k: int, rng: np.random.Generator) -> Scenario:
    return session(
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
        ground=road(k),
        gnss=gnss(rng),
        attitude=slight(rng),
        targets=Targets(still=2, moving=2, persons=2),
        detector=ScenarioDetector(miss=float(rng.uniform(0.05, 0.15)), clutter=0.3),
    )


def occlusion(k: int, rng: np.random.Generator) -> Scenario:
    bursts = ScenarioDetector(bursts_per_min=4.0, burst_min_s=1.0, burst_max_s=4.0)
    return session(ground=road(k), gnss=gnss(rng), attitude=slight(rng), detector=bursts)


def in_out(k: int, rng: np.random.Generator) -> Scenario:
    """The UAV roams about the fleet, or the fleet drives about a field wider than the frame."""
    flight = ScenarioFlight() if k % 3 == 2 else ScenarioFlight(roam_m=26.0)
    return session(ground=road(k, area_m=(90.0, 50.0)), flight=flight, gnss=gnss(rng), attitude=slight(rng))


def hard_geometry(k: int, rng: np.random.Generator) -> Scenario:
    """Formations at 5-8 m that move as one body; three vehicles and a person taken for one; a car park."""
    errors = {"gnss": gnss(rng, bias=0.6), "attitude": slight(rng)}
    if FORMATIONS[k] == "3 + person":
        few = ScenarioGround(kind="open", vehicles=3, area_m=(30.0, 16.0))
        return session(ground=few, targets=Targets(persons=1), flight=ScenarioFlight(height_m=39.0), **errors)
    if FORMATIONS[k] == "parked":
        return session(ground=ScenarioGround(kind="parked", vehicles=7, spacing_m=6.0), **errors)
    ground = ScenarioGround(
        kind="formation",
        formation=("line", "column", "wedge", "grid")[k],
        vehicles=9 if k == 3 else 5,
        spacing_m=float(rng.uniform(5.0, 8.0)),
    )
    return session(ground=ground, flight=ScenarioFlight(height_m=48.0), **errors)


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
        ground=road(k, vehicles=6, area_m=area),
        camera=camera.get(k, ScenarioCamera()),
        flight=flight.get(k, ScenarioFlight(height_m=45.0)),
        gnss=gnss(rng),
        attitude=slight(rng),
    )


def scale(k: int, rng: np.random.Generator) -> Scenario:
    n = CROWDS[k]
    ground = ScenarioGround(kind=("straight", "curved")[k % 2], vehicles=n, lanes=4, spacing_m=8.0, bend_deg=30.0)
    return session(ground=ground, flight=ScenarioFlight(height_m=35.0 + n), gnss=gnss(rng), attitude=slight(rng))


def no_heading(k: int, rng: np.random.Generator) -> Scenario:
    return session(
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
    return session(ground=road(k), gnss=gnss(rng), attitude=slight(rng), faults=faults)


def pose_free(k: int, rng: np.random.Generator) -> Scenario:
    """The UAV reports its position and neither attitude nor gimbal."""
    flight = ScenarioFlight(height_m=48.0, yaw_deg=float(rng.uniform(0.0, 360.0)))
    return session(ground=road(k), gnss=gnss(rng), attitude=slight(rng, missing=True), flight=flight)


def unmodelled(k: int, rng: np.random.Generator) -> Scenario:
    """What no position filter expects: other correlation times, jumps of the fix, slopes, boxes round two vehicles."""
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
        ground=ground.get(k, road(k)),
        gnss=errors.get(k, gnss(rng)),
        attitude=slight(rng),
        detector=detector.get(k, ScenarioDetector()),
    )
