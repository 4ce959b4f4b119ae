"""Streams of MAVLink messages from readings: each a generator of (seconds, message) in time order."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega as dialect

from sim.world.camera import mount_rotation
from sim.world.earth import to_geodetic
from sim.world.scenario import Scenario
from sim.world.world import random_stream

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Stream = Iterator[tuple[float, Any]]

COPTER_GUIDED, ROVER_AUTO = 4, 10
"""ArduPilot's custom modes: Guided of Copter, Auto of Rover."""


class BootClock:
    """A vehicle's boot clock: its own zero and its own drift; and how far its idea of Unix time is off."""

    def __init__(self, scenario: Scenario, vehicle: int) -> None:
        rng = random_stream(scenario, f"clock {vehicle}")
        self.boot_s = float(rng.uniform(40.0, 400.0))
        self.rate = 1.0 + 1e-6 * float(rng.uniform(-scenario.timing.clock_ppm, scenario.timing.clock_ppm))
        self.unix_error_us = int(rng.normal(-300_000.0, 100_000.0))

    def boot_ms(self, t: float) -> int:
        """Milliseconds since boot at t seconds after the first frame."""
        return int(max(0.0, (t + self.boot_s) * self.rate) * 1000.0)


def heartbeats(t: FloatArray, vehicle: int) -> Stream:
    """HEARTBEAT of an armed copter in GUIDED (vehicle −1) or an armed rover in AUTO."""
    kind, mode = (
        (dialect.MAV_TYPE_QUADROTOR, COPTER_GUIDED) if vehicle < 0 else (dialect.MAV_TYPE_GROUND_ROVER, ROVER_AUTO)
    )
    flags = dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | dialect.MAV_MODE_FLAG_SAFETY_ARMED
    message = dialect.MAVLink_heartbeat_message(
        kind, dialect.MAV_AUTOPILOT_ARDUPILOTMEGA, flags, mode, dialect.MAV_STATE_ACTIVE, 3
    )
    for now in t.tolist():
        yield now, message


def system_times(scenario: Scenario, clock: BootClock, t: FloatArray) -> Stream:
    """SYSTEM_TIME, whose Unix time is off by a constant."""
    for now in t.tolist():
        unix_us = scenario.start_us + round(now * 1e6) + clock.unix_error_us
        yield now, dialect.MAVLink_system_time_message(unix_us, clock.boot_ms(now))


def texts(t: FloatArray) -> Stream:
    """STATUSTEXT now and then."""
    for number, now in enumerate(t.tolist()):
        text = f"Reached waypoint #{number + 1}".encode()
        yield now, dialect.MAVLink_statustext_message(dialect.MAV_SEVERITY_INFO, text)


def positions(
    scenario: Scenario,
    clock: BootClock,
    t: FloatArray,
    p_enu: FloatArray,
    v_enu: FloatArray,
    heading: FloatArray,
    zeroed: NDArray[np.bool_],
    extra_relative_m: float,
) -> Stream:
    """GLOBAL_POSITION_INT of readings (k, ...); heading NaN is sent as unknown, zeroed rows as all zeros."""
    lat, lon, alt = _whole_degrees(scenario, p_enu)
    relative = np.rint((p_enu[:, 2] + extra_relative_m) * 1e3)
    v = np.rint(v_enu * 100.0)
    with np.errstate(invalid="ignore"):
        cdeg = np.rint(np.degrees(heading) * 100.0) % 36000
    rows = np.stack([lat, lon, alt, relative, v[:, 1], v[:, 0], -v[:, 2]], axis=-1)
    rows[zeroed] = 0
    hdg = np.where(np.isfinite(heading), cdeg, 65535)
    for now, row, head in zip(t.tolist(), rows.astype(np.int64).tolist(), hdg.astype(int).tolist(), strict=True):
        yield now, dialect.MAVLink_global_position_int_message(clock.boot_ms(now), *row, head)


def fixes(
    scenario: Scenario,
    clock: BootClock,
    t: FloatArray,
    p_enu: FloatArray,
    v_enu: FloatArray,
    zeroed: NDArray[np.bool_],
) -> Stream:
    """GPS_RAW_INT of readings (k, ...): a 3D fix with 14 satellites, none where zeroed."""
    lat, lon, alt = _whole_degrees(scenario, p_enu)
    speed = np.rint(np.hypot(v_enu[:, 0], v_enu[:, 1]) * 100.0)
    course = np.rint(np.degrees(np.arctan2(v_enu[:, 0], v_enu[:, 1])) * 100.0) % 36000
    rows = np.stack([lat, lon, alt, np.full(len(t), 80), np.full(len(t), 120), speed, course], axis=-1)
    rows[zeroed] = 0
    for now, row, bad in zip(t.tolist(), rows.astype(np.int64).tolist(), zeroed.tolist(), strict=True):
        fix, satellites = (dialect.GPS_FIX_TYPE_NO_FIX, 0) if bad else (dialect.GPS_FIX_TYPE_3D_FIX, 14)
        yield now, dialect.MAVLink_gps_raw_int_message(clock.boot_ms(now) * 1000, fix, *row, satellites)


def attitudes(
    clock: BootClock, t: FloatArray, yaw: FloatArray, pitch: FloatArray, roll: FloatArray, rates: FloatArray
) -> Stream:
    """ATTITUDE of angles (k,) in radians and body rates (k, 3) about roll, pitch and yaw axes in rad/s."""
    turned = (yaw + np.pi) % (2.0 * np.pi) - np.pi
    rows = np.column_stack([roll, pitch, turned, rates]).tolist()
    for now, row in zip(t.tolist(), rows, strict=True):
        yield now, dialect.MAVLink_attitude_message(clock.boot_ms(now), *row)


def gimbal(scenario: Scenario, clock: BootClock, t: FloatArray) -> Stream:
    """GIMBAL_DEVICE_ATTITUDE_STATUS: the nominal mount angles, roll and pitch to the horizon, yaw to the nose."""
    q = _quaternion(mount_rotation(scenario))
    flags = dialect.GIMBAL_DEVICE_FLAGS_ROLL_LOCK | dialect.GIMBAL_DEVICE_FLAGS_PITCH_LOCK
    flags |= dialect.GIMBAL_DEVICE_FLAGS_YAW_IN_VEHICLE_FRAME
    nan = float("nan")
    for now in t.tolist():
        boot_ms = clock.boot_ms(now)
        yield (
            now,
            dialect.MAVLink_gimbal_device_attitude_status_message(
                0, 0, boot_ms, flags, q, 0.0, 0.0, 0.0, 0, nan, nan, 1
            ),
        )


def camera(scenario: Scenario, video_port: int) -> tuple[Any, ...]:
    """CAMERA_FOV_STATUS, and VIDEO_STREAM_INFORMATION of MPEG-TS that goes to a UDP port; 0: there is no video."""
    lens, nan = scenario.camera, float("nan")
    hfov, vfov = (
        2.0 * math.degrees(math.atan(0.5 * size / f)) for size, f in ((lens.width, lens.fx), (lens.height, lens.fy))
    )
    view = dialect.MAVLink_camera_fov_status_message(0, 0, 0, 0, 0, 0, 0, [nan] * 4, hfov, vfov)
    if not video_port:
        return (view,)
    stream = dialect.MAVLink_video_stream_information_message(
        *(1, 1, dialect.VIDEO_STREAM_TYPE_MPEG_TS, dialect.VIDEO_STREAM_STATUS_FLAGS_RUNNING),
        *(scenario.fps, lens.width, lens.height, 0, 0, round(hfov), b"main", str(video_port).encode()),
    )
    return view, stream


def _whole_degrees(scenario: Scenario, p_enu: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    lat, lon, alt = to_geodetic(p_enu, scenario.latitude_deg, scenario.longitude_deg, scenario.altitude_m)
    return np.rint(lat * 1e7), np.rint(lon * 1e7), np.rint(alt * 1e3)


def _quaternion(R: FloatArray) -> list[float]:
    """w, x, y, z of a rotation matrix, w ≥ 0."""
    # the quaternion is the eigenvector of the largest eigenvalue of K (Bar-Itzhack 2000, doi:10.2514/2.4654)
    K = np.array(
        [
            [R[0, 0] + R[1, 1] + R[2, 2], R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]],
            [R[2, 1] - R[1, 2], R[0, 0] - R[1, 1] - R[2, 2], R[1, 0] + R[0, 1], R[2, 0] + R[0, 2]],
            [R[0, 2] - R[2, 0], R[1, 0] + R[0, 1], R[1, 1] - R[0, 0] - R[2, 2], R[2, 1] + R[1, 2]],
            [R[1, 0] - R[0, 1], R[2, 0] + R[0, 2], R[2, 1] + R[1, 2], R[2, 2] - R[0, 0] - R[1, 1]],
        ]
    )
    q = np.linalg.eigh(K)[1][:, -1]
    return [float(x) for x in (q if q[0] >= 0.0 else -q)]
