"""What the vehicles say: real MAVLink 2 packets in order of arrival, with clocks, delays and losses of their own."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega as dialect

from sim.camera import body_rotation, mount_rotation
from sim.earth import to_geodetic
from sim.scenario import UAV_ID, Scenario
from sim.sensors import Sensors
from sim.world import World, random_stream

__all__ = ["Spoken", "speak", "telemetry_epoch_us"]

FloatArray = NDArray[np.float64]

TALK_FROM_S, TALK_AFTER_S = -2.0, 1.0
"""Telemetry begins before the first frame and ends after the last."""

UAV_ATTITUDE_HZ, UAV_POSITION_HZ, GIMBAL_HZ, GPS_HZ = 20.0, 10.0, 10.0, 2.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Spoken:
    """One packet as it arrives."""

    t_us: int
    """Arrival, Unix time."""
    raw: bytes
    vehicle: int
    """−1 the UAV, else the ground vehicle's index."""


@dataclass(frozen=True, slots=True)
class _Utterance:
    t: float
    message: Any


class _Clock:
    """A vehicle's boot clock: its own zero and its own drift."""

    def __init__(self, scenario: Scenario, vehicle: int) -> None:
        rng = random_stream(scenario, f"clock {vehicle}")
        self.boot_s = float(rng.uniform(40.0, 400.0))
        self.rate = 1.0 + 1e-6 * float(rng.uniform(-scenario.timing.clock_ppm, scenario.timing.clock_ppm))
        self.unix_error_us = int(rng.normal(-300_000.0, 100_000.0))

    def boot_ms(self, t: float) -> int:
        return int(max(0.0, (t + self.boot_s) * self.rate) * 1000.0)


def telemetry_epoch_us(scenario: Scenario) -> int:
    """Unix time of t = 0 on the telemetry's time line."""
    return scenario.start_us


def speak(world: World) -> Iterator[Spoken]:
    """All packets of the flight by time of arrival, lost ones left out (their sequence numbers stay used)."""
    sensors = Sensors(world)
    spoken: list[Spoken] = []
    for vehicle in range(-1, world.scenario.fleet_size):
        utterances = _uav(sensors) if vehicle < 0 else _ugv(sensors, vehicle)
        utterances.sort(key=lambda utterance: utterance.t)
        spoken.extend(_sent(world.scenario, vehicle, utterances))
    spoken.sort(key=lambda packet: (packet.t_us, packet.vehicle))
    yield from spoken


def _sent(scenario: Scenario, vehicle: int, utterances: list[_Utterance]) -> Iterator[Spoken]:
    rng = random_stream(scenario, f"radio {vehicle}")
    system_id = UAV_ID if vehicle < 0 else scenario.ugv_ids[vehicle]
    mav = dialect.MAVLink(None, srcSystem=system_id, srcComponent=1)
    draws = rng.random((len(utterances), 2))
    last_us = 0
    for utterance, (lost, wait) in zip(utterances, draws, strict=True):
        raw = bytes(utterance.message.pack(mav))
        mav.seq = (mav.seq + 1) % 256
        delay = scenario.timing.latency_s - scenario.timing.jitter_s * np.log1p(-wait)
        # one vehicle's packets share a radio and don't overtake each other
        last_us = max(last_us + 1, telemetry_epoch_us(scenario) + round((utterance.t + delay) * 1e6))
        if lost >= scenario.timing.loss:
            yield Spoken(t_us=last_us, raw=raw, vehicle=vehicle)


def _uav(sensors: Sensors) -> list[_Utterance]:
    scenario, clock = sensors.scenario, _Clock(sensors.scenario, -1)
    out = _common(scenario, clock, -1, dialect.MAV_TYPE_QUADROTOR, custom_mode=4)
    t = _times(scenario, UAV_POSITION_HZ, -1, "position")
    reading = sensors.uav(t)
    hdg = np.full(len(t), np.nan) if scenario.attitude.missing else reading.yaw
    out += _positions(scenario, clock, t, reading.p_enu, reading.v_enu, hdg, np.zeros(len(t), dtype=bool), home_m=0.0)
    if scenario.attitude.missing:
        return out
    t = _times(scenario, UAV_ATTITUDE_HZ, -1, "attitude")
    out += _attitudes(clock, t, *_angles(sensors, t))
    if scenario.camera.mount == "stabilized" and scenario.attitude.gimbal:
        t = _times(scenario, GIMBAL_HZ, -1, "gimbal")
        out += _gimbal(scenario, clock, t)
    return out


def _ugv(sensors: Sensors, vehicle: int) -> list[_Utterance]:
    scenario, clock = sensors.scenario, _Clock(sensors.scenario, vehicle)
    rng = random_stream(scenario, f"rate {vehicle}")
    rate = float(rng.uniform(scenario.timing.rate_min_hz, scenario.timing.rate_max_hz))
    out = _common(scenario, clock, vehicle, dialect.MAV_TYPE_GROUND_ROVER, custom_mode=10)
    t = _times(scenario, rate, vehicle, "position")
    reading = sensors.ugv(vehicle, t)
    hdg = np.full(len(t), np.nan) if scenario.attitude.ugv_heading_missing else reading.heading
    home = -scenario.gnss.altitude_quirk_m
    out += _positions(scenario, clock, t, reading.p_enu, reading.v_enu, hdg, reading.zeroed, home_m=home)
    if not scenario.attitude.ugv_heading_missing:
        out += _attitudes(clock, t, reading.heading, np.zeros(len(t)), np.zeros(len(t)))
    silent = sensors.silent(vehicle, np.array([u.t for u in out]))
    return [utterance for utterance, mute in zip(out, silent, strict=True) if not mute]


def _angles(sensors: Sensors, t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    reading = sensors.uav(t)
    return reading.yaw, reading.pitch, reading.roll


def _times(scenario: Scenario, rate_hz: float, vehicle: int, what: str) -> FloatArray:
    """Sample times with a phase of the vehicle's own."""
    phase = random_stream(scenario, f"phase {vehicle} {what}").random()
    count = int((scenario.duration_s + TALK_AFTER_S - TALK_FROM_S) * rate_hz)
    return np.asarray(TALK_FROM_S + (np.arange(count) + phase) / rate_hz)


def _common(scenario: Scenario, clock: _Clock, vehicle: int, kind: int, custom_mode: int) -> list[_Utterance]:
    """Heartbeats, system time and the occasional text."""
    mode = dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | dialect.MAV_MODE_FLAG_SAFETY_ARMED
    heartbeat = dialect.MAVLink_heartbeat_message(
        kind, dialect.MAV_AUTOPILOT_ARDUPILOTMEGA, mode, custom_mode, dialect.MAV_STATE_ACTIVE, 3
    )
    out = [_Utterance(float(t), heartbeat) for t in _times(scenario, 1.0, vehicle, "heartbeat")]
    for t in _times(scenario, 1.0, vehicle, "time"):
        unix_us = telemetry_epoch_us(scenario) + round(float(t) * 1e6) + clock.unix_error_us
        out.append(_Utterance(float(t), dialect.MAVLink_system_time_message(unix_us, clock.boot_ms(float(t)))))
    for number, t in enumerate(_times(scenario, 1.0 / 15.0, vehicle, "text")):
        text = f"Reached waypoint #{number + 1}".encode()
        out.append(_Utterance(float(t), dialect.MAVLink_statustext_message(dialect.MAV_SEVERITY_INFO, text)))
    return out


def _positions(
    scenario: Scenario,
    clock: _Clock,
    t: FloatArray,
    p_enu: FloatArray,
    v_enu: FloatArray,
    heading: FloatArray,
    zeroed: NDArray[np.bool_],
    home_m: float,
) -> list[_Utterance]:
    """GLOBAL_POSITION_INT at every sample, GPS_RAW_INT now and then; heading NaN is sent as unknown."""
    lat, lon, alt = to_geodetic(p_enu, scenario.latitude_deg, scenario.longitude_deg, scenario.altitude_m)
    lat_e7 = np.where(zeroed, 0, np.rint(lat * 1e7)).astype(np.int64)
    lon_e7 = np.where(zeroed, 0, np.rint(lon * 1e7)).astype(np.int64)
    alt_mm = np.where(zeroed, 0, np.rint(alt * 1e3)).astype(np.int64)
    relative_mm = np.where(zeroed, 0, np.rint((p_enu[:, 2] - home_m) * 1e3)).astype(np.int64)
    v_cms = np.where(zeroed[:, None], 0, np.rint(v_enu * 100.0)).astype(np.int64)
    with np.errstate(invalid="ignore"):
        cdeg = np.rint(np.degrees(heading) * 100.0) % 36000
    hdg = np.where(np.isfinite(heading), cdeg, 65535).astype(np.int64)
    out: list[_Utterance] = []
    raw_every = max(1, round(len(t) / max(t[-1] - t[0], 1e-9) / GPS_HZ)) if len(t) > 1 else 1
    speed, course = np.hypot(v_cms[:, 0], v_cms[:, 1]), np.degrees(np.arctan2(v_cms[:, 0], v_cms[:, 1])) % 360.0
    for k, now in enumerate(t.tolist()):
        ms = clock.boot_ms(now)
        position = dialect.MAVLink_global_position_int_message(
            ms, int(lat_e7[k]), int(lon_e7[k]), int(alt_mm[k]), int(relative_mm[k]),
            int(v_cms[k, 1]), int(v_cms[k, 0]), int(-v_cms[k, 2]), int(hdg[k]),
        )  # fmt: skip
        out.append(_Utterance(now, position))
        if k % raw_every == 0:
            fix = dialect.GPS_FIX_TYPE_NO_FIX if zeroed[k] else dialect.GPS_FIX_TYPE_3D_FIX
            raw = dialect.MAVLink_gps_raw_int_message(
                ms * 1000, fix, int(lat_e7[k]), int(lon_e7[k]), int(alt_mm[k]), 80, 120,
                int(speed[k]), round(float(course[k]) * 100.0) % 36000, 0 if zeroed[k] else 14,
            )  # fmt: skip
            out.append(_Utterance(now, raw))
    return out


def _attitudes(clock: _Clock, t: FloatArray, yaw: FloatArray, pitch: FloatArray, roll: FloatArray) -> list[_Utterance]:
    turned = (yaw + np.pi) % (2.0 * np.pi) - np.pi
    rate = np.gradient(yaw, t) if len(t) > 1 else np.zeros(len(t))
    message: Callable[..., Any] = dialect.MAVLink_attitude_message
    return [
        _Utterance(float(s), message(clock.boot_ms(float(s)), float(r), float(p), float(y), 0.0, 0.0, float(w)))
        for s, r, p, y, w in zip(t, roll, pitch, turned, rate, strict=True)
    ]


def _gimbal(scenario: Scenario, clock: _Clock, t: FloatArray) -> list[_Utterance]:
    """The mount's nominal angles: roll and pitch to the horizon, yaw to the nose, as the gimbal believes them."""
    q = _quaternion(mount_rotation(scenario) @ body_rotation(0.0, 0.0, 0.0))
    flags = dialect.GIMBAL_DEVICE_FLAGS_ROLL_LOCK | dialect.GIMBAL_DEVICE_FLAGS_PITCH_LOCK
    flags |= dialect.GIMBAL_DEVICE_FLAGS_YAW_IN_VEHICLE_FRAME
    nan = float("nan")
    return [
        _Utterance(
            float(s),
            dialect.MAVLink_gimbal_device_attitude_status_message(
                0, 0, clock.boot_ms(float(s)), flags, q, 0.0, 0.0, 0.0, 0, nan, nan, 1
            ),
        )
        for s in t
    ]


def _quaternion(R: FloatArray) -> list[float]:
    """w, x, y, z of a rotation matrix, w ≥ 0."""
    # with K = 4 q qᵀ − 1 built from R, q is the eigenvector of the largest eigenvalue (Bar-Itzhack 2000)
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
