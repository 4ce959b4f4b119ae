"""A session as the competitors get it: perfect tracks, the camera's pose as reported, the fleet's state at each frame.

Telemetry goes through the same packets and the same fleet as the product's, and what is known of a frame is what had
arrived by then.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs.fold.camera.direction import mount_of
from gcs.mission.mission import Mission, parse_mission
from mavlink.fleet.fleet import Fleet
from mavlink.protocol.packet import Packet
from mavlink.state import FleetState
from sim.session import frame_times, session_toml
from sim.telemetry.detections import DetectedRows, DetectorModel
from sim.telemetry.vehicle_telemetry import fleet_telemetry
from sim.world.scenario import Scenario
from sim.world.world import World
from vision.camera.camera import camera_pose, ground
from vision.camera.intrinsics import Intrinsics

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

LEVEL_NORTH = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
"""Attitude that is assumed where none is reported: body axes into ENU."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SessionFrame:
    """One frame: m boxes, n vehicles."""

    body: IntArray
    """(m,) perfect track id, −1 for boxes over nothing."""
    truth: IntArray
    """(m,) true system id, 0 none of ours."""
    uv: FloatArray
    """(m, 2) box centres, pixels."""
    heading: FloatArray
    """(m,) of the box, clockwise from image up, NaN unknown."""
    on_ground: FloatArray
    """(m, 2) east and north of the box with the pose at face value, NaN above the horizon."""
    p: FloatArray
    """(n, 3) reported ENU, NaN where unusable."""
    vehicle_heading: FloatArray
    """(n,) clockwise from north, NaN unknown."""
    uav: FloatArray
    """(3,) reported ENU."""
    yaw: float
    """Reported, 0 where none is."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SessionFrames:
    """All frames of a session."""

    ids: IntArray
    """(n,) system ids of the vehicles."""
    fps: float
    center_px: FloatArray
    """(2,) middle of the image."""
    looks: tuple[SessionFrame, ...]


def scene_of(scenario: Scenario) -> SessionFrames:
    """Play a scenario for the competitors; equal to the session that ``write_session`` writes."""
    world = World(scenario)
    mission = parse_mission(session_toml(scenario), scenario.name)
    assert mission.camera is not None
    intrinsics = mission.camera.intrinsics
    assert intrinsics is not None
    fleet = Fleet(mission.uav.system_id, mission.ugv_ids)
    offset = 0.0 if mission.clock.video_offset_s == "auto" else float(mission.clock.video_offset_s)
    detector = DetectorModel(world)
    packets = iter(fleet_telemetry(world))
    ahead = next(packets, None)
    looks = []
    t, stamps_us = frame_times(scenario)
    for now, stamp_us in zip(t.tolist(), stamps_us.tolist(), strict=True):
        while ahead is not None and ahead.t_us <= stamp_us:
            fleet.add_packet(Packet(ahead.t_us, ahead.raw))
            ahead = next(packets, None)
        state = fleet.at(stamp_us - round(offset * 1e6))
        looks.append(_session_frame(detector.detect(now), state, mission, intrinsics))
    return SessionFrames(
        ids=np.array(mission.ugv_ids, np.int64),
        fps=scenario.fps,
        center_px=np.array([intrinsics.cx, intrinsics.cy]),
        looks=tuple(looks),
    )


def _session_frame(rows: DetectedRows, state: FleetState, mission: Mission, intrinsics: Intrinsics) -> SessionFrame:
    uav = state.uav
    R_enu_body = uav.R_enu_body if uav.attitude_valid else LEVEL_NORTH
    pose = camera_pose(mount_of(mission.camera), uav.p_enu, R_enu_body)
    uv = rows.values[:, :2]
    return SessionFrame(
        body=rows.body,
        truth=rows.system_id,
        uv=uv,
        heading=rows.values[:, 6],
        on_ground=ground(intrinsics, pose, uv, float(uav.p_enu[2] - uav.height_m))[:, :2],
        p=np.where(state.valid[:, None], state.p_enu, np.nan),
        vehicle_heading=state.heading,
        uav=uav.p_enu,
        yaw=float(uav.yaw) if uav.attitude_valid else 0.0,
    )
