"""Flights of the published experiments, seen through perfect tracks, and windows of consecutive frames cut from them.

One array per quantity. The world, the true boxes and the UAV's own telemetry come from the simulator. Reports of the
ground vehicles carry no noise yet: each experiment adds its own. ENU metres, radians, pixels; F frames of a flight, T
of a window, B bodies, m boxes, n reporting vehicles. The boxes of a window are shuffled, so that their order is
arbitrary. Unit noise depends on the window alone: every noise level and every method sees the same draws, scaled.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from sim.telemetry.sensors import Sensors
from sim.world.boxes import in_image, true_boxes
from sim.world.scenario import (
    Gnss,
    Scenario,
    ScenarioAttitude,
    ScenarioCamera,
    ScenarioDetector,
    ScenarioFlight,
    ScenarioGround,
    Targets,
)
from sim.world.world import World

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

FPS = 10.0
CAMERA = ScenarioCamera()
FLIP, FRONT_NOISE_DEG = 0.04, 3.0
"""The front classifier: share of boxes turned about, and the angle noise of the boxes."""
COMPASS_DEG = 2.0
"""1σ over flights of the error of the UAV's reported yaw."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FilmedFlight:
    """One flight of F frames."""

    fps: float
    uv: FloatArray
    """(F, B, 2) measured box centres, pixels."""
    front: FloatArray
    """(F, B) front of the box as the classifier has it, clockwise from image up."""
    length_px: FloatArray
    """(F, B) length of the box."""
    seen: BoolArray
    """(F, B) in view."""
    vehicle: IntArray
    """(B,) index of the vehicle, −1 for what is not ours."""
    p_enu: FloatArray
    """(F, n, 3) true positions of the vehicles that report."""
    heading: FloatArray
    """(F, n) true headings."""
    speed: FloatArray
    """(F, n) m/s."""
    report_error: FloatArray
    """(F, n, 2) what the receivers' own error model adds; the experiments with white noise leave it out."""
    uav_enu: FloatArray
    """(F, 3) reported position of the UAV."""
    uav_yaw: FloatArray
    """(F,) its reported yaw."""


def paper_road(road: str, yaw_deg: float, seed: int) -> Scenario:
    """Six vehicles in view and one outside, more than 1 m/s, lane changes."""
    rng = np.random.default_rng([seed, 612])
    return Scenario(
        name=f"paper-{road}",
        seed=seed,
        duration_s=28.0,
        fps=FPS,
        ground=ScenarioGround(
            kind="straight" if road == "straight" else "curved",
            vehicles=6,
            outside=1,
            speed_mps=6.0,
            spacing_m=18.0,
            lanes=2,
            bend_deg=50.0,
            bend_length_m=80.0,
            lane_changes_per_min=5.0,
            stops_per_min=0.0,
        ),
        flight=ScenarioFlight(height_m=70.0, yaw_deg=yaw_deg),
        camera=CAMERA,
        gnss=Gnss(white_m=0.0, bias_m=0.0),
        attitude=ScenarioAttitude(compass_bias_deg=float(rng.normal(0.0, COMPASS_DEG))),
        detector=ScenarioDetector(angle_noise_deg=FRONT_NOISE_DEG, flip=FLIP),
    )


def false_box_road(kind: str, seed: int) -> Scenario:
    """Six vehicles and a seventh box: a look-alike that drives among them, or something beside the road."""
    base = paper_road("curved", 0.0, seed)
    targets = Targets(lookalikes=1) if kind == "look-alike" else Targets(still=1)
    return replace(base, name=f"false-{kind}", ground=replace(base.ground, outside=0), targets=targets)


def field(seed: int) -> Scenario:
    """Three vehicles on open ground and a person, from 39 m, with receivers that wander by 1.5 m."""
    base = paper_road("straight", 0.0, seed)
    return replace(
        base,
        name="field",
        ground=ScenarioGround(kind="open", vehicles=3, speed_mps=2.0, area_m=(30.0, 20.0), length_m=1.1, width_m=0.8),
        flight=ScenarioFlight(height_m=39.0),
        gnss=Gnss(white_m=0.2, bias_m=1.5, tau_s=60.0),
        targets=Targets(persons=1),
    )


@lru_cache(maxsize=48)
def film(scenario: Scenario) -> FilmedFlight:
    """Fly and measure; equal scenarios give equal films."""
    world = World(scenario)
    sensors = Sensors(world)
    t = np.arange(scenario.frame_count) / scenario.fps
    rng = np.random.default_rng([scenario.seed, 9])
    uv, front, length, seen = _boxes(world, t, rng)
    n = scenario.fleet_size
    tracks = [world.track_of(i, t) for i in range(n)]
    xy = np.stack([track[0] for track in tracks], axis=1)
    velocity = np.stack([track[1] for track in tracks], axis=1)
    reported = np.stack([sensors.ugv(i, t).p_enu for i in range(n)], axis=1)
    uav = sensors.uav(t, "paper")
    return FilmedFlight(
        fps=scenario.fps,
        uv=uv,
        front=front,
        length_px=length,
        seen=seen,
        vehicle=np.concatenate([np.arange(n), np.full(uv.shape[1] - n, -1)]),
        p_enu=np.concatenate([xy, np.zeros((len(t), n, 1))], axis=2),
        heading=np.stack([track[2] for track in tracks], axis=1),
        speed=np.linalg.norm(velocity, axis=2),
        report_error=reported[..., :2] - xy,
        uav_enu=uav.p_enu,
        uav_yaw=uav.yaw,
    )


def _boxes(
    world: World, t: FloatArray, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray, FloatArray, BoolArray]:
    """Measured centres, fronts, lengths and what is in view."""
    detector = world.scenario.detector
    views = [world.view(float(now)) for now in t]
    boxes = [true_boxes(view, world.bodies(float(now))) for view, now in zip(views, t, strict=True)]
    seen = np.stack([in_image(view, box) for view, box in zip(views, boxes, strict=True)])
    uv = np.stack([np.stack([box.cx, box.cy], axis=-1) for box in boxes])
    uv = uv + rng.normal(0.0, detector.pixel_noise, uv.shape)
    # heading = angle + π/2
    front = np.stack([box.angle for box in boxes]) + 0.5 * np.pi
    front = front + rng.normal(0.0, np.radians(detector.angle_noise_deg), front.shape)
    front = front + np.pi * (rng.random(front.shape) < detector.flip)
    return uv, front, np.stack([box.w for box in boxes]), seen


SLOWEST_MPS = 1.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Window(FilmedFlight):
    """T frames of a flight in which the same m boxes are seen; positions without white noise."""

    start: int
    """First frame in the flight."""
    unit: FloatArray
    """(T, n, 8) unit normal draws: three for the position, one for the heading, and another set of these four."""

    def positions(self, sigma_m: float, *, second: bool = False) -> FloatArray:
        """(T, n, 3) reports with white noise of σ metres per axis; ``second`` takes draws of their own."""
        first = 4 if second else 0
        return np.asarray(self.p_enu + sigma_m * self.unit[..., first : first + 3])

    def headings(self, sigma_deg: float) -> FloatArray:
        """(T, n) reported headings with white noise of σ degrees."""
        return np.asarray(self.heading + np.radians(sigma_deg) * self.unit[..., 3])


def windows(
    film: FilmedFlight,
    frames: int,
    seed: int,
    *,
    boxes: int,
    visible: int,
    wander: bool = False,
) -> list[Window]:
    """All windows of a flight that fit the experiment, one after the other.

    Args:
        film: The flight.
        frames: T.
        seed: Of the noise.
        boxes: m that must be seen, the same in every frame.
        visible: The first ``visible`` vehicles must be among them.
        wander: Add the receivers' own errors to the reports.

    Returns:
        Windows in which no visible vehicle drives slower than 1 m/s (walking robots of ``wander`` may).
    """
    found = []
    for start in range(0, len(film.uv) - frames + 1, frames):
        part = slice(start, start + frames)
        seen = film.seen[part]
        slow = not wander and bool(np.any(film.speed[part, :visible] <= SLOWEST_MPS))
        constant = bool(np.all(seen == seen[0])) and int(np.sum(seen[0])) == boxes and bool(np.all(seen[0, :visible]))
        if constant and not slow:
            found.append(_window(film, part, np.flatnonzero(seen[0]), seed, wander))
    return found


def _window(film: FilmedFlight, part: slice, rows: IntArray, seed: int, wander: bool) -> Window:
    rng = np.random.default_rng([seed, part.start, part.stop])
    order = rng.permutation(rows)
    p = film.p_enu[part].copy()
    if wander:
        p[..., :2] += film.report_error[part]
    boxes = {name: getattr(film, name)[part, order] for name in ("uv", "front", "length_px", "seen")}
    others = ("heading", "speed", "report_error", "uav_enu", "uav_yaw")
    return Window(
        start=part.start,
        fps=film.fps,
        vehicle=film.vehicle[order],
        p_enu=p,
        unit=rng.normal(0.0, 1.0, (*p.shape[:2], 8)),
        **boxes,
        **{name: getattr(film, name)[part] for name in others},
    )
