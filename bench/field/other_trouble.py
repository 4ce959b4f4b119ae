"""Families about what is reported: spoofed for the whole flight, of another film, or with errors of other kinds."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from bench.field.ordinary import FROM_THE_START_S, road, session
from sim.world.error_draws import gnss, slight
from sim.world.scenario import (
    Gnss,
    Scenario,
    ScenarioCamera,
    ScenarioDetector,
    ScenarioFault,
    ScenarioFlight,
    ScenarioGround,
    ScenarioTiming,
    Targets,
)

SMOOTH = ("1 Hz", "2 Hz", "5 Hz", "10 Hz", "20 Hz", "50 Hz", "mixed")
SMOOTH_HARD = (
    "1 Hz, -45°",
    "5 Hz, -45°, rough boxes",
    "10 Hz, rough pose",
    "20 Hz, rough boxes, rough pose",
    "50 Hz, -30°, late",
    "20 Hz, -30°, seldom attitude",
    "mixed, -45°, rough boxes, late",
)
SPOOFERS = ("own errors", "copy", "delay 0.5 s", "one from outside", "open, own errors", "open, copy")
SPOOFERS_HARD = ("bias 1.5 m", "copy, bias 1.5 m", "delay 1.5 s", "two of one", "two pairs", "formation")
FILMS = ("another road", "curved, straight", "open, curved", "straight, open", "oblique", "more in the film")
FILMS_HARD = ("same line", "three vehicles", "no attitude", "bias 2 m", "grids", "look-alikes", "another drive")
OTHER_ERRORS = ("walk", "steps", "sine 10 s", "sine 200 s", "Laplace", "outliers", "rough boxes", "late", "uneven")
OTHER_ERRORS_HARD = ("mixed 1", "mixed 2", "mixed 3", "mixed 4", "mixed 5", "mixed 6")


def smooth(k: int, rng: np.random.Generator) -> Scenario:
    """Reports of autopilots' filters, whose errors are slow and hardly noisy, as often as autopilots send them."""
    return session(
        rng,
        ground=road(k),
        flight=ScenarioFlight(height_m=float(rng.uniform(38.0, 55.0))),
        gnss=_filtered(rng),
        timing=_rates(SMOOTH[k]),
    )


def smooth_hard(k: int, rng: np.random.Generator) -> Scenario:
    """The same beside boxes, poses and clocks that are far noisier than the reports."""
    rate, *rest = SMOOTH_HARD[k].split(", ")
    timing, pitch = _rates(rate), -90.0
    detector, errors, attitude = ScenarioDetector(), _filtered(rng), slight(rng)
    for word in rest:
        if word.endswith("°"):
            pitch = float(word.rstrip("°"))
        elif word == "rough boxes":
            detector = ScenarioDetector(size_noise=float(rng.uniform(0.08, 0.12)))
        elif word == "rough pose":
            errors = replace(errors, uav_white_m=float(rng.uniform(0.3, 0.5)))
        elif word == "late":
            timing = replace(timing, jitter_s=float(rng.uniform(0.1, 0.2)))
        else:
            timing = replace(timing, attitude_hz=float(rng.uniform(5.0, 8.0)))
    return session(
        rng,
        ground=road(k),
        camera=ScenarioCamera(pitch_deg=pitch),
        flight=ScenarioFlight(height_m=float(rng.uniform(38.0, 55.0))),
        gnss=errors,
        attitude=attitude,
        timing=timing,
        detector=detector,
    )


def _filtered(rng: np.random.Generator) -> Gnss:
    wander = {"bias": float(rng.uniform(0.3, 1.0)), "tau_s": float(rng.uniform(20.0, 60.0))}
    return gnss(rng, white=float(rng.uniform(0.01, 0.04)), bias_kind="filtered", **wander)


def _rates(label: str) -> ScenarioTiming:
    if label == "mixed":
        return ScenarioTiming(rate_min_hz=1.0, rate_max_hz=50.0)
    hz = float(label.split()[0])
    return ScenarioTiming(rate_min_hz=hz, rate_max_hz=hz)


def spoofers(k: int, rng: np.random.Generator) -> Scenario:
    """One vehicle reports another's place from the first second to the last."""
    label = SPOOFERS[k]
    ground = road(k, outside=1) if "outside" in label else road(2 if "open" in label else k % 2)
    delay = 0.5 if "delay" in label else 0.0
    liar, other = (int(v) for v in rng.choice(ground.vehicles, 2, replace=False))
    if ground.outside:
        liar = ground.vehicles
    faults = (_lie("copy" if "copy" in label else "spoof", liar, other, delay),)
    return session(rng, ground=ground, faults=faults)


def spoofers_hard(k: int, rng: np.random.Generator) -> Scenario:
    """The same with wider errors, longer delays, two spoofers, or where neighbours drive alike."""
    label = SPOOFERS_HARD[k]
    ground = road(k % 2)
    if label == "formation":
        ground = ScenarioGround(kind="formation", formation="wedge", vehicles=7, spacing_m=8.0)
    a, b, c, d = (int(v) for v in rng.choice(ground.vehicles, 4, replace=False))
    kind = "copy" if "copy" in label else "spoof"
    pairs = {"two of one": ((a, b), (c, b)), "two pairs": ((a, b), (c, d))}.get(label, ((a, b),))
    faults = tuple(_lie(kind, liar, other, 1.5 if "delay" in label else 0.0) for liar, other in pairs)
    errors = gnss(rng, bias=1.5) if "bias" in label else gnss(rng)
    return session(rng, ground=ground, gnss=errors, faults=faults)


def _lie(kind: str, liar: int, other: int, delay_s: float) -> ScenarioFault:
    return ScenarioFault(vehicle=liar, kind=kind, start_s=FROM_THE_START_S, other=other, size=delay_s)  # type: ignore[arg-type]


def unrelated(k: int, rng: np.random.Generator) -> Scenario:
    """Telemetry of one flight; :func:`unrelated_film` is what is seen with it."""
    label = FILMS[k]
    kinds = {"curved, straight": 1, "open, curved": 2, "straight, open": 0}
    camera = ScenarioCamera(pitch_deg=-50.0) if label == "oblique" else ScenarioCamera()
    return session(rng, ground=road(kinds.get(label, k % 3)), camera=camera)


def unrelated_film(k: int, flown: Scenario, rng: np.random.Generator) -> Scenario:
    """Another flight with the same camera."""
    label = FILMS[k]
    kinds = {"curved, straight": 0, "open, curved": 1, "straight, open": 2}
    ground = road(kinds.get(label, k % 3), vehicles=12 if "more" in label else int(rng.integers(5, 9)))
    return _another(flown, ground, rng)


def unrelated_hard(k: int, rng: np.random.Generator) -> Scenario:
    """Telemetry of few, of formations, with wide errors or without attitude, to which much else nearly fits."""
    label = FILMS_HARD[k]
    ground = {
        "same line": ScenarioGround(kind="formation", formation="line", vehicles=5, spacing_m=7.0),
        "grids": ScenarioGround(kind="formation", formation="grid", vehicles=9, spacing_m=7.0),
        "three vehicles": road(k, vehicles=3),
    }.get(label, road(k))
    errors = gnss(rng, bias=2.0) if "bias" in label else gnss(rng)
    return session(rng, ground=ground, gnss=errors, attitude=slight(rng, missing="no attitude" in label))


def unrelated_film_hard(k: int, flown: Scenario, rng: np.random.Generator) -> Scenario:
    """Another flight of the same kind with the same camera, or from the same place over the same road."""
    if FILMS_HARD[k] == "another drive":
        return replace(flown, seed=int(rng.integers(2**31)))
    alike = Targets(lookalikes=4) if FILMS_HARD[k] == "look-alikes" else Targets()
    return replace(_another(flown, flown.ground, rng), targets=alike)


def _another(flown: Scenario, ground: ScenarioGround, rng: np.random.Generator) -> Scenario:
    """Another flight: another seed, height, speed and direction of the road."""
    flight = ScenarioFlight(height_m=float(rng.uniform(34.0, 48.0)), yaw_deg=float(rng.uniform(0.0, 360.0)))
    turned = float((flight.yaw_deg + rng.uniform(45.0, 135.0)) % 360.0)
    ground = replace(ground, road_deg=turned, speed_mps=float(rng.uniform(2.5, 6.0)))
    return replace(flown, seed=int(rng.integers(2**31)), ground=ground, flight=flight)


def other_errors(k: int, rng: np.random.Generator) -> Scenario:
    """One part at a time errs otherwise than in the other families."""
    label = OTHER_ERRORS[k]
    errors: dict[str, dict[str, Any]] = {
        "walk": {"bias_kind": "walk", "bias": 0.8, "tau_s": 30.0},
        "steps": {"bias_kind": "steps", "bias": 1.0, "tau_s": 15.0},
        "sine 10 s": {"bias_kind": "sine", "bias": 1.0, "tau_s": 10.0},
        "sine 200 s": {"bias_kind": "sine", "bias": 1.0, "tau_s": 200.0},
        "Laplace": {"white_kind": "laplace", "white": 1.0},
        "outliers": {"white_kind": "outliers", "white": 0.6},
    }
    detector, timing = ScenarioDetector(), ScenarioTiming()
    if label == "rough boxes":
        detector = ScenarioDetector(size_noise=float(rng.uniform(0.04, 0.08)), miss=0.1, miss_run_s=0.5)
    elif label == "late":
        timing = ScenarioTiming(latency_s=0.3, jitter_s=0.15, uav_lag_s=float(rng.uniform(0.1, 0.25)))
    elif label == "uneven":
        timing = ScenarioTiming(frame_jitter_s=0.02, frame_loss=0.2, irregular=0.9, rate_min_hz=1.0, rate_max_hz=3.0)
    return session(rng, ground=road(k), gnss=gnss(rng, **errors.get(label, {})), detector=detector, timing=timing)


def other_errors_hard(k: int, rng: np.random.Generator) -> Scenario:
    """Every part errs otherwise at once, drawn again for each session."""
    bias = Gnss(
        white_m=float(rng.uniform(0.3, 1.5)),
        white_kind=str(rng.choice(("normal", "laplace", "outliers"))),  # type: ignore[arg-type]
        bias_m=float(rng.uniform(0.5, 2.0)),
        bias_kind=str(rng.choice(("gauss-markov", "walk", "steps", "sine"))),  # type: ignore[arg-type]
        tau_s=float(np.exp(rng.uniform(np.log(10.0), np.log(200.0)))),
        uav_bias_m=float(rng.uniform(0.3, 2.5)),
        height_bias_m=float(rng.normal(0.0, 1.0)),
        altitude_bias_m=float(rng.uniform(0.0, 3.0)),
        altitude_white_m=0.3,
    )
    timing = ScenarioTiming(
        latency_s=float(rng.uniform(0.03, 0.3)),
        jitter_s=float(rng.uniform(0.01, 0.15)),
        rate_min_hz=1.0,
        rate_max_hz=float(rng.uniform(2.0, 5.0)),
        irregular=float(rng.uniform(0.0, 0.9)),
        loss=float(rng.uniform(0.0, 0.15)),
        frame_jitter_s=0.01,
        frame_loss=float(rng.uniform(0.0, 0.2)),
        uav_lag_s=float(rng.uniform(0.0, 0.25)),
    )
    detector = ScenarioDetector(
        pixel_noise=float(rng.uniform(0.5, 2.5)),
        size_noise=float(rng.uniform(0.01, 0.06)),
        angle_noise_deg=float(rng.uniform(2.0, 8.0)),
        flip=float(rng.uniform(0.0, 0.06)),
        miss=float(rng.uniform(0.02, 0.12)),
        miss_run_s=float(rng.uniform(0.1, 0.8)),
        clutter=float(rng.uniform(0.0, 0.3)),
    )
    focal = float(rng.uniform(900.0, 1500.0))
    return session(
        rng,
        ground=road(k, vehicles=int(rng.integers(4, 10)), speed_mps=float(rng.uniform(1.5, 6.0))),
        camera=ScenarioCamera(fx=focal, fy=focal, distortion=(float(rng.uniform(-0.15, 0.02)), 0.02, 0.0, 0.0, 0.0)),
        flight=ScenarioFlight(height_m=float(rng.uniform(34.0, 55.0)), yaw_deg=float(rng.uniform(0.0, 360.0))),
        gnss=bias,
        attitude=slight(rng, wander_deg=float(rng.uniform(0.0, 0.5)), noise_deg=float(rng.uniform(0.2, 1.0))),
        timing=timing,
        detector=detector,
        targets=Targets(still=1, moving=int(rng.integers(0, 2)), lookalikes=int(rng.integers(0, 2))),
    )
