"""A vehicle's log as MAVLink records: what an autopilot would have sent, so that everything else works unchanged.

Positions become GLOBAL_POSITION_INT, their precision GPS_RAW_INT's ``h_acc``, attitudes ATTITUDE, a gimbal's
GIMBAL_DEVICE_ATTITUDE_STATUS, a field of view that changes CAMERA_FOV_STATUS. What the log does not say is sent as
unknown or not at all.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.importing.checks.plausible import MAX_M
from gcs.importing.vehicle_log import AngleTrack, PlaceTrack, VehicleLog, ViewTrack, thinned, whole_places
from mavlink.geodesy import quaternion_from_euler, wrap_pi
from mavlink.protocol.encoder import COPTER, GENERIC, ROVER, MavlinkEncoder

Floats = NDArray[np.float64]
TlogRecord = tuple[int, bytes]
"""Unix µs of arrival and a MAVLink frame."""
_Timed = Iterator[tuple[int, Callable[[MavlinkEncoder], bytes]]]
"""Time on the log's clock, and what packs the message."""

_BOOTED_BEFORE_US = 60_000_000
"""The clock of a vehicle begins this long before its first sample: a boot time of 0 means that there is none."""
_HEARTBEAT_US, _FIX_US, _VIEW_US = 1_000_000, 500_000, 1_000_000
"""Intervals between messages of a kind."""
_PLACE_US, _ANGLE_US = 45_000, 35_000
"""Samples closer together than this are thinned: interpolation makes up for them, and logs have hundreds a second."""
_FASTEST, _MAX_TURN = 300.0, 1e3
"""m/s and rad; more is a damaged number."""
_UNKNOWN_COUNT, _UNKNOWN_PLACE = 255, 2**31 - 1
_YAW_FLAGS = {"north": 64, "nose": 32}
"""GIMBAL_DEVICE_FLAGS_YAW_IN_EARTH_FRAME and _VEHICLE_FRAME."""
_MIN_CHANGE = 0.01
"""Share by which a field of view changes before it is sent."""


def vehicle_records(log: VehicleLog, system_id: int, shift_us: int, *, flies: bool, home_m: float) -> list[TlogRecord]:
    """All messages of a vehicle, in order of time.

    Args:
        system_id: under which it sends.
        shift_us: from the log's clock to Unix time, µs.
        flies: the UAV; else a rover.
        home_m: altitude of the take-off, metres above sea level: a log that has only one of altitude and height gets
            the other by it. NaN unknown.
    """
    tracks = [track.t_us for track in (log.places, log.attitudes, log.gimbal) if len(track)]
    first_us, last_us = min(int(t[0]) for t in tracks), max(int(t[-1]) for t in tracks)
    boot_us = first_us - _BOOTED_BEFORE_US
    # modes are each autopilot's own: neither is told
    kind = COPTER if flies else ROVER
    beat = partial(MavlinkEncoder.heartbeat, kind=kind, autopilot=GENERIC, custom_mode=None)
    messages: list[tuple[int, Callable[[MavlinkEncoder], bytes]]] = [
        *((t_us, beat) for t_us in range(first_us, last_us + 1, _HEARTBEAT_US)),
        *_places(log.places, boot_us, home_m, flies=flies),
        *_attitudes(log.attitudes, boot_us),
        *_gimbal(log.gimbal, boot_us),
        *_view(log.view, boot_us),
    ]
    encoder = MavlinkEncoder(system_id)
    # arrival is at whole milliseconds of boot time, as the wire has them: then no delay is seen
    return [
        (boot_us + _boot_ms(t_us, boot_us) * 1000 + shift_us, pack(encoder))
        for t_us, pack in sorted(messages, key=lambda each: each[0])
        if t_us + shift_us >= 0
    ]


def _boot_ms(t_us: int, boot_us: int) -> int:
    return (t_us - boot_us + 500) // 1000


def _places(places: PlaceTrack, boot_us: int, home_m: float, *, flies: bool) -> _Timed:
    above = places.height_m if flies else np.nan_to_num(places.height_m)
    alt = np.where(np.isfinite(places.alt_m), places.alt_m, home_m + above)
    height = np.where(np.isfinite(places.height_m), places.height_m, places.alt_m - home_m)
    with np.errstate(invalid="ignore"):
        known = np.flatnonzero(whole_places(places.lat_deg, places.lon_deg) & (np.abs(alt) < MAX_M))
    fix_us = -_FIX_US + int(places.t_us[0]) if len(places) else 0
    for row in known[thinned(places.t_us[known], _PLACE_US)].tolist():
        t_us = int(places.t_us[row])
        boot_ms = _boot_ms(t_us, boot_us)
        place = float(places.lat_deg[row]), float(places.lon_deg[row]), float(alt[row])
        if 0.0 < places.std_m < MAX_M and t_us - fix_us >= _FIX_US:
            fix_us = t_us
            accuracy = {"satellites": _UNKNOWN_COUNT, "h_acc_m": places.std_m}
            yield t_us, partial(_gps_raw_int, boot_ms * 1000, place, accuracy)
        up = float(height[row]) if abs(height[row]) < MAX_M else 0.0
        v_ned = [v if abs(v) < _FASTEST else math.nan for v in places.v_ned[row].tolist()]
        heading = float(places.heading[row]) % (2.0 * math.pi) if abs(places.heading[row]) < _MAX_TURN else math.nan
        yield t_us, partial(_global_position, boot_ms, place, up, v_ned, heading)


def _gps_raw_int(
    time_us: int, place: tuple[float, float, float], accuracy: dict[str, Any], encoder: MavlinkEncoder
) -> bytes:
    return encoder.gps_raw_int(time_us, *place, **accuracy)


def _global_position(
    boot_ms: int,
    place: tuple[float, float, float],
    above: float,
    v_ned: list[float],
    heading: float,
    encoder: MavlinkEncoder,
) -> bytes:
    return encoder.global_position_int(boot_ms, *place, above, v_ned, heading)


def _attitudes(track: AngleTrack, boot_us: int) -> _Timed:
    for t_us, roll, pitch, yaw in _angles(track):
        message = dialect.MAVLink_attitude_message(_boot_ms(t_us, boot_us), roll, pitch, wrap_pi(yaw), 0.0, 0.0, 0.0)
        yield t_us, partial(_pack, message)


def _gimbal(track: AngleTrack, boot_us: int) -> _Timed:
    flags, nan = _YAW_FLAGS[track.yaw_from], math.nan
    for t_us, *angles in _angles(track):
        q = quaternion_from_euler(*angles)
        message = dialect.MAVLink_gimbal_device_attitude_status_message(
            0, 0, _boot_ms(t_us, boot_us), flags, q, 0.0, 0.0, 0.0, 0, nan, nan, 1
        )
        yield t_us, partial(_pack, message)


def _view(track: ViewTrack, boot_us: int) -> _Timed:
    """Write the field of view where it changes: the mission has the first one."""
    if not len(track) or np.ptp(track.hfov) < _MIN_CHANGE * track.hfov[0]:
        return
    for row in thinned(track.t_us, _VIEW_US).tolist():
        t_us, hfov_deg = int(track.t_us[row]), math.degrees(float(track.hfov[row]))
        message = dialect.MAVLink_camera_fov_status_message(
            _boot_ms(t_us, boot_us), *[_UNKNOWN_PLACE] * 6, [math.nan] * 4, hfov_deg, math.nan
        )
        yield t_us, partial(_pack, message)


def _pack(message: Any, encoder: MavlinkEncoder) -> bytes:  # noqa: ANN401 - the dialect's messages carry no types
    return encoder.pack(message)


def _angles(track: AngleTrack) -> Iterator[tuple[int, float, float, float]]:
    with np.errstate(invalid="ignore"):
        rows = np.flatnonzero((np.abs(track.angles) < _MAX_TURN).all(axis=1))
    for row in rows[thinned(track.t_us[rows], _ANGLE_US)].tolist():
        roll, pitch, yaw = track.angles[row].tolist()
        yield int(track.t_us[row]), roll, pitch, yaw
