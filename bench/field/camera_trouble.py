"""Families about the camera: fixed to a body that shakes, declared wrongly, or above ground of another height."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from bench.field.ordinary import road, session
from sim.world.error_draws import gnss, signed, slight
from sim.world.scenario import Scenario, ScenarioCamera, ScenarioDeclared, ScenarioFlight, ScenarioTiming, Zoom

SHAKING = (
    "nadir, 50 Hz, rates",
    "nadir, 10 Hz",
    "-60°, 25 Hz",
    "-50°, 4 Hz, rates",
    "-45°, 50 Hz, 15 fps",
    "-30°, 20 Hz, rates, 30 fps",
    "-50°, 10 Hz, pixels",
)
SHAKING_HARD = (
    "nadir, 4 Hz",
    "-50°, 10 Hz",
    "-30°, 4 Hz, 30 fps",
    "-30°, 25 Hz, rates, 15 fps",
    "nadir, no attitude",
    "-30°, 4 Hz, 15 fps, pixels",
    "nadir, no attitude, pixels",
)
WRONG_CAMERAS = ("focal × 0.7", "focal × 1.3", "yaw 30°", "offset 2 s", "distortion", "pitch 5°")
WRONG_CAMERAS_HARD = ("yaw 90°", "yaw 180°", "mirrored", "pitch 15°", "offset 5 s", "focal × 1.3, yaw 30°, -45°")
ZOOM = ("2 then 1", "1.5 then 1", "2")
ZOOM_HARD = ("3 then 1", "2 then 1 then 1.6", "2 then 1, -50°")
UNKNOWN = (
    "70°, nadir, 7",
    "100°, -60°, 9",
    "40°, -75°, 12",
    "60°, -45°, 5, fixed",
    "110°, -40°, 8, 90°",
    "80°, -60°, 3, 180°",
)
UNKNOWN_HARD = (
    "50°, -30°, 10, 270°",
    "120°, -25°, 6, fixed",
    "30°, -85°, 12, 90°",
    "70°, -60°, 7, no attitude",
    "90°, -50°, 4, fixed, 180°",
    "60°, -40°, 3, no attitude",
)
HILLS = ("+10 m", "-10 m", "+20 m, -50°", "-15 m, -60°", "slope 4°", "waves 3 m, -50°")
ALTITUDES = ("+48", "-35", "+20", "+48, -45°", "-35, -45°", "contradict, -45°")
ALTITUDES_HARD = ("+70, 20", "-48, -10", "+35, -15, -35°", "-70, 15, -35°", "contradict, 15", "+30, -50°")
HILLS_HARD = ("+30 m", "+30 m, -45°", "-20 m, -45°", "-20 m, open", "slope 7°, -50°", "waves 6 m, -45°")


def shaking(label: str, k: int, rng: np.random.Generator) -> Scenario:
    """A camera without a gimbal on a body that wobbles by 1-2°.

    Hard: by 2-3.5°, and attitude that comes too seldom or not at all.
    """
    wobble_deg = float(rng.uniform(2.0, 3.5) if label in SHAKING_HARD else rng.uniform(1.0, 2.0))
    view, *parts = label.split(", ")
    rate = [float(part.split()[0]) for part in parts if part.endswith("Hz")]
    fps = [float(part.split()[0]) for part in parts if part.endswith("fps")]
    attitude = slight(
        rng,
        missing="no attitude" in parts,
        rates="rates" in parts,
        noise_deg=float(rng.uniform(0.2, 1.0)),
        wander_deg=float(rng.uniform(0.1, 0.5)),
    )
    return session(
        rng,
        duration_s=30.0,
        fps=fps[0] if fps else 10.0,
        ground=road(k, vehicles=int(rng.integers(5, 9)), area_m=(34.0, 20.0)),
        camera=_lens(rng, view, mount="fixed"),
        flight=ScenarioFlight(
            height_m=float(rng.uniform(36.0, 50.0)), wobble_deg=wobble_deg, wobble_tau_s=float(rng.uniform(0.15, 0.4))
        ),
        gnss=gnss(rng, white=float(rng.uniform(0.2, 0.6)), bias=float(rng.uniform(0.4, 1.2))),
        attitude=attitude,
        timing=ScenarioTiming(attitude_hz=rate[0] if rate else 20.0),
    )


def wrong_camera(label: str, k: int, rng: np.random.Generator) -> Scenario:
    """The mission says a little that is not so; hard: something else altogether."""
    wrong: dict[str, float | bool] = {}
    camera: dict[str, bool] = {}
    view = "nadir"
    for part in label.split(", "):
        word, _, size = part.partition(" ")
        if word == "focal":
            wrong["focal_share"] = float(size.removeprefix("× "))
        elif word in ("yaw", "pitch"):
            # beyond straight down a mount's pitch does not go
            turned = float(size.rstrip("°"))
            wrong[f"{word}_deg"] = turned if word == "pitch" else turned * float(rng.choice((-1.0, 1.0)))
        elif word == "offset":
            wrong["offset_s"] = signed(rng, *2 * (float(size.split()[0]),))
        elif word == "distortion":
            wrong["distortion"] = False
        elif word == "mirrored":
            camera["mirrored"] = True
        else:
            view = word
    return session(
        rng,
        ground=road(k),
        camera=_lens(rng, view, **camera),
        flight=ScenarioFlight(height_m=float(rng.uniform(36.0, 50.0)), yaw_deg=float(rng.uniform(0.0, 360.0))),
        declared=ScenarioDeclared(**wrong),  # type: ignore[arg-type]
    )


def altitudes(label: str, k: int, rng: np.random.Generator) -> Scenario:
    """Vehicles count their altitudes from another level than the UAV, or what they report contradicts itself.

    Hard: the UAV took off on a hill or in a hollow, and no source but the film tells the height.
    """
    first, *rest = label.split(", ")
    view = next((part for part in rest if part.endswith("°")), "nadir")
    above = next((float(part) for part in rest if not part.endswith("°")), 0.0)
    wild = first == "contradict"
    return session(
        rng,
        ground=road(k),
        camera=_lens(rng, view),
        flight=ScenarioFlight(height_m=float(rng.uniform(45.0, 65.0)), takeoff_above_m=above),
        gnss=gnss(
            rng,
            altitude_bias_m=1.5,
            altitude_white_m=100.0 if wild else 0.3,
            altitude_datum_m=0.0 if wild else float(first) + float(rng.normal(0.0, 3.0)),
        ),
    )


def hill(label: str, k: int, rng: np.random.Generator) -> Scenario:
    """Taken off 10-20 m above or below the vehicles, hard 20-30 m, a slope, waves.

    Vehicles report altitudes as receivers do: off by metres, much of it in common with the UAV's.
    """
    first, *rest = label.split(", ")
    ground: dict[str, Any] = {"area_m": (36.0, 20.0)}
    above = 0.0
    if first.startswith("slope"):
        ground |= {"slope_deg": float(first.split()[1].rstrip("°")), "uphill_deg": float(rng.uniform(0.0, 360.0))}
    elif first.startswith("waves"):
        ground |= {"waves_m": float(first.split()[1]), "wavelength_m": float(rng.uniform(60.0, 140.0))}
    else:
        above = float(first.split()[0])
    if "open" in rest:
        ground["kind"] = "open"
    view = next((part for part in rest if part.endswith("°")), "nadir")
    return session(
        rng,
        duration_s=30.0,
        ground=road(k, **ground),
        camera=_lens(rng, view),
        flight=ScenarioFlight(height_m=float(rng.uniform(38.0, 55.0)), takeoff_above_m=above),
        gnss=gnss(
            rng,
            bias=float(rng.uniform(0.4, 1.0)),
            height_bias_m=float(rng.normal(0.0, 1.5)),
            altitude_bias_m=1.5,
            altitude_white_m=0.3,
        ),
    )


def zoom(label: str, k: int, rng: np.random.Generator) -> Scenario:
    """A camera that zooms at once and back again, which nothing reports; hard: by more, twice, or seen from aside."""
    steps, *rest = label.split(", ")
    factors = [float(step) for step in steps.split(" then ")]
    at_s = np.cumsum(rng.uniform(6.0, 9.0, len(factors))).tolist()
    zooms = tuple(Zoom(at_s=at, factor=factor) for at, factor in zip(at_s, factors, strict=True))
    return session(
        rng,
        ground=road(k),
        camera=ScenarioCamera(pitch_deg=float(rest[0].rstrip("°")) if rest else -90.0, zooms=zooms),
        flight=ScenarioFlight(height_m=float(rng.uniform(40.0, 60.0))),
    )


def unknown(label: str, k: int, rng: np.random.Generator) -> Scenario:
    """A camera of which nobody says anything: neither field of view nor which way it looks.

    Hard: with larger errors, seen more from the side, wider and longer, or without the UAV's attitude.
    """
    errors = 1.5 if label in UNKNOWN_HARD else 0.6
    across, view, vehicles, *rest = label.split(", ")
    focal = 960.0 / math.tan(math.radians(float(across.rstrip("°"))) / 2.0)
    turned = next((float(part.rstrip("°")) for part in rest if part.endswith("°")), 0.0)
    return session(
        rng,
        ground=road(k, vehicles=int(vehicles), outside=int(rng.integers(0, 3))),
        camera=ScenarioCamera(
            fx=focal,
            fy=focal,
            pitch_deg=-90.0 if view == "nadir" else float(view.rstrip("°")),
            yaw_deg=turned + float(rng.normal(0.0, 2.0)),
            mount="fixed" if "fixed" in rest else "stabilized",
        ),
        flight=ScenarioFlight(height_m=float(rng.uniform(35.0, 80.0))),
        gnss=gnss(rng, bias=errors, height_bias_m=float(rng.normal(0.0, errors))),
        attitude=replace(slight(rng), gimbal=False, missing="no attitude" in rest),
        declared=ScenarioDeclared(camera=False),
    )


def _lens(rng: np.random.Generator, view: str, **parts: object) -> ScenarioCamera:
    """A camera of some focal length, with a lens that bends a little; ``view`` is nadir or the pitch."""
    focal = float(rng.uniform(1000.0, 1450.0))
    bent = (float(rng.uniform(-0.12, 0.02)), float(rng.uniform(0.0, 0.03)), 0.0005, -0.0005, 0.0)
    pitch = -90.0 if view == "nadir" else float(view.rstrip("°"))
    return ScenarioCamera(fx=focal, fy=focal, distortion=bent, pitch_deg=pitch, **parts)  # type: ignore[arg-type]
