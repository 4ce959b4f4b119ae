"""Simulated flights of ten minutes, of which a minute was filmed: tracks, the camera's path, the fleet's reports."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from assoc.clock_search.inputs import CameraPath, FleetLog, film_tracks
from assoc.history import TrackHistory
from assoc.records import Observation
from gcs.fold.evidence import observation_of
from sim.telemetry.detections import DetectorModel
from sim.telemetry.sensors import Sensors
from sim.world.camera import CAMERA_IN_MOUNT, ENU_FROM_NED, body_rotation, mount_rotation
from sim.world.scenario import (
    Gnss,
    Scenario,
    ScenarioAttitude,
    ScenarioCamera,
    ScenarioDetector,
    ScenarioFlight,
    ScenarioGround,
    ScenarioTiming,
    Targets,
)
from sim.world.world import World
from vision.camera.intrinsics import Intrinsics
from vision.detect.detections import Detections
from vision.track.tracker import Tracker
from vision.track.tracks import TrackerParams

__all__ = ["ClockDraw", "draw"]

LOG_S, FPS, EDGE_S = 600.0, 5.0, 20.0
GROUND_Z = 0.45
"""Of the middle of a vehicle, metres."""
REPORTS_LOST = 0.05


@dataclass(frozen=True, slots=True, kw_only=True)
class ClockDraw:
    """One flight; the fleet's clock is right."""

    ground: str
    tracks: TrackHistory
    path: CameraPath
    log: FleetLog

    def without(self, start: float, stop: float) -> ClockDraw:
        """The same without the fleet's reports of a time."""
        kept = (self.log.t < start) | (self.log.t >= stop)
        log = replace(self.log, t=self.log.t[kept], vehicle=self.log.vehicle[kept], p_enu=self.log.p_enu[kept])
        return replace(self, log=log)


def scenario(seed: int) -> Scenario:
    """Two to ten vehicles on roads, in formation or in the open, with errors from slight to large."""
    rng = np.random.default_rng(seed)
    kinds = ("curved", "open", "formation", "straight")
    kind = kinds[int(rng.choice(4, p=[0.4, 0.25, 0.2, 0.15]))]
    rate = float(rng.choice([1.0, 2.0, 5.0]))
    return Scenario(
        seed=seed,
        duration_s=LOG_S,
        fps=FPS,
        ground=ScenarioGround(
            kind=kind,  # type: ignore[arg-type]
            vehicles=int(rng.integers(2, 11)),
            outside=int(rng.integers(0, 4)),
            speed_mps=float(rng.uniform(1.5, 7.0)),
            spacing_m=float(rng.uniform(6.0, 14.0)),
            lanes=int(rng.integers(1, 4)),
            stops_per_min=float(rng.uniform(0.0, 1.0)),
            bend_deg=float(rng.uniform(0.0, 60.0)),
        ),
        flight=ScenarioFlight(
            height_m=float(rng.uniform(35.0, 80.0)),
            sway_m=float(rng.uniform(0.2, 2.0)),
            roam_m=float(rng.choice([0.0, 0.0, 8.0])),
            yaw_deg=float(rng.uniform(-180.0, 180.0)),
        ),
        camera=ScenarioCamera(pitch_deg=float(rng.choice([-90.0, -90.0, -70.0, -50.0]))),
        gnss=Gnss(
            white_m=float(rng.uniform(0.1, 0.8)),
            bias_m=float(rng.uniform(0.2, 1.5)),
            uav_bias_m=float(rng.uniform(0.0, 2.0)),
            height_bias_m=float(rng.normal(0.0, 0.7)),
        ),
        attitude=ScenarioAttitude(
            compass_bias_deg=float(rng.normal(0.0, 4.0)),
            tilt_pitch_deg=float(rng.normal(0.0, 0.7)),
            tilt_roll_deg=float(rng.normal(0.0, 0.7)),
        ),
        timing=ScenarioTiming(rate_min_hz=rate, rate_max_hz=rate),
        detector=ScenarioDetector(miss=float(rng.uniform(0.0, 0.15)), clutter=float(rng.choice([0.0, 0.1, 0.5]))),
        targets=Targets(still=int(rng.integers(0, 3)), moving=int(rng.integers(0, 2))),
    )


def draw(seed: int, film_s: float, *, heading_known: bool) -> ClockDraw:
    """A flight.

    Args:
        seed: of everything.
        film_s: length of the film, somewhere in it.
        heading_known: the UAV reports its heading.
    """
    made = scenario(seed)
    world, rng = World(made), np.random.default_rng(seed + 1_000_000)
    start = float(rng.uniform(EDGE_S, LOG_S - film_s - EDGE_S))
    return ClockDraw(
        ground=made.ground.kind,
        tracks=_film(world, start, film_s),
        path=_path(world, start, film_s, heading_known=heading_known),
        log=_log(world, start, rng),
    )


def _film(world: World, start: float, film_s: float) -> TrackHistory:
    camera, model = world.scenario.camera, DetectorModel(world)
    lens = Intrinsics(width=camera.width, height=camera.height, fx=camera.fx, fy=camera.fy, cx=camera.cx, cy=camera.cy)
    tracker = Tracker(TrackerParams(frame_size=(camera.width, camera.height)))

    def frame(k: int) -> tuple[float, Observation]:
        t_us = round(k / FPS * 1e6)
        cx, cy, w, h, angle, score, heading = model.detect(start + k / FPS).values.T
        boxes = Detections(cx=cx, cy=cy, w=w, h=h, angle=angle, score=score, heading=heading)
        return k / FPS, observation_of(t_us, boxes, tracker.update(boxes, t_us), lens)

    return film_tracks(map(frame, range(int(film_s * FPS))), film_s)


def _path(world: World, start: float, film_s: float, *, heading_known: bool) -> CameraPath:
    made, sensors = world.scenario, Sensors(world)
    t = np.arange(start - EDGE_S, start + film_s + EDGE_S, 0.1)
    yaws = sensors.uav(t, "attitude").yaw if heading_known else np.zeros(len(t))
    mount = mount_rotation(made) @ CAMERA_IN_MOUNT
    camera = made.camera
    return CameraPath(
        t=t - start,
        R_enu_cam=np.stack([ENU_FROM_NED @ body_rotation(float(yaw), 0.0, 0.0) @ mount for yaw in yaws]),
        p_enu=sensors.uav(t, "position").p_enu,
        ground_z=GROUND_Z,
        px_rad=1.0 / camera.fx,
        heading_known=heading_known,
        half_view=(0.5 * camera.width / camera.fx, 0.5 * camera.height / camera.fy),
    )


def _log(world: World, start: float, rng: np.random.Generator) -> FleetLog:
    made, sensors = world.scenario, Sensors(world)
    times, vehicles, places = [], [], []
    for vehicle in range(made.fleet_size):
        t = np.arange(-2.0, LOG_S + 1.0, 1.0 / made.timing.rate_min_hz) + 0.1 * vehicle
        t = t[rng.random(len(t)) >= REPORTS_LOST]
        times.append(t - start)
        vehicles.append(np.full(len(t), vehicle))
        places.append(sensors.ugv(vehicle, t).p_enu[:, :2])
    return FleetLog(
        n=made.fleet_size, t=np.concatenate(times), vehicle=np.concatenate(vehicles), p_enu=np.concatenate(places)
    )
