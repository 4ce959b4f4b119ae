"""Packet → sample: pure, and the only place where the units of the wire are known.

Payloads are unpacked by the dialect's own formats, without its message objects. MAVLink 2 leaves out trailing zero
bytes; they are put back, so fields that the sender cut off read 0. Definitions: https://mavlink.io/en/messages/
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega

from infra.plain_text import plain
from mavlink.geodesy import euler_from_quaternion
from mavlink.protocol.messages import (
    Attitude,
    BatteryStatus,
    CameraFov,
    CameraInformation,
    CameraSettings,
    DistanceSensor,
    FilterStatus,
    GimbalAttitude,
    GlobalPosition,
    GpsRaw,
    Heartbeat,
    MountOrientation,
    MountStatus,
    RadioStatus,
    Sample,
    SecondGps,
    SensorHealth,
    StatusText,
    SystemTime,
    TerrainReport,
    TimeSync,
    VideoStreamInformation,
)
from mavlink.protocol.packet import MAGIC_V2, Packet

_RAD = math.pi / 180.0

_Head = tuple[int, int, int]
_Values = tuple[Any, ...]
# EKF_STATUS_FLAGS and ESTIMATOR_STATUS_FLAGS share these
_ON_EARTH = 16
_EKF_UNINITIALIZED, _EKF_GLITCH, _ESTIMATOR_GLITCH = 1024, 32768, 1024
_MAX_RATIO, _MAX_ACCURACY_M = 1e3, 1e5
"""Largest test ratio and accuracy that mean something."""
# MAV_SYS_STATUS_SENSOR
_GPS, _AHRS, _ARMING = 1 << 5, 1 << 21, 1 << 28
_SENSORS = {
    "gyroscope": 1 << 0 | 1 << 17,
    "accelerometer": 1 << 1 | 1 << 18,
    "compass": 1 << 2 | 1 << 19,
    "barometer": 1 << 3,
    "airspeed sensor": 1 << 4,
    "rangefinder": 1 << 8,
    "motor outputs": 1 << 15,
    "fence of its own": 1 << 20,
    "log": 1 << 24,
    "battery": 1 << 25,
    "proximity sensor": 1 << 26,
    "propulsion": 1 << 30,
}
"""Sensors that a vehicle cannot do without; no remote control, which a fleet that drives by itself has not."""


def clean_text(raw: bytes) -> str:
    """Text of a message: cut at the first NUL, bad UTF-8 and control characters replaced by U+FFFD."""
    return plain(raw.split(b"\0", 1)[0].decode("utf-8", "replace"))


def _heartbeat(head: _Head, v: _Values) -> Heartbeat:
    custom_mode, kind, autopilot, base_mode, status, _ = v
    return Heartbeat(*head, kind, autopilot, base_mode, custom_mode, status)


def _system_time(head: _Head, v: _Values) -> SystemTime:
    return SystemTime(*head, v[0], v[1])


def _timesync(head: _Head, v: _Values) -> TimeSync:
    return TimeSync(*head, v[0], v[1])


def _attitude(head: _Head, v: _Values) -> Attitude:
    return Attitude(*head, *v)


def _attitude_quaternion(head: _Head, v: _Values) -> Attitude:
    boot_ms, w, x, y, z, p, q, r = v[:8]
    return Attitude(*head, boot_ms, *euler_from_quaternion(w, x, y, z), p, q, r)


def _global_position(head: _Head, v: _Values) -> GlobalPosition:
    boot_ms, lat, lon, alt, relative_alt, vx, vy, vz, hdg = v
    return GlobalPosition(
        *head,
        boot_ms,
        lat * 1e-7,
        lon * 1e-7,
        alt * 1e-3,
        relative_alt * 1e-3,
        vx * 0.01 if -32768 < vx < 32767 else math.nan,
        vy * 0.01 if -32768 < vy < 32767 else math.nan,
        vz * 0.01 if -32768 < vz < 32767 else math.nan,
        hdg * 0.01 * _RAD if hdg <= 36000 else math.nan,
    )


def _hdop(eph: int) -> float:
    return eph * 0.01 if 0 < eph < 65535 else math.nan


def _gps_raw(head: _Head, v: _Values) -> GpsRaw:
    fix_us, lat, lon, alt, eph, _, speed, course, fix_type, satellites, _, h_acc, v_acc, *_ = v
    return GpsRaw(
        *head,
        fix_type,
        lat * 1e-7,
        lon * 1e-7,
        alt * 1e-3,
        _hdop(eph),
        satellites if satellites < 255 else -1,
        h_acc * 1e-3 if 0 < h_acc < 0xFFFFFFFF else math.nan,
        v_acc * 1e-3 if 0 < v_acc < 0xFFFFFFFF else math.nan,
        fix_us,
        speed * 0.01 if speed < 65535 else math.nan,
        course * 0.01 * _RAD if course <= 36000 else math.nan,
    )


def _second_gps(head: _Head, v: _Values) -> SecondGps:
    eph, fix_type, satellites = v[5], v[9], v[10]
    return SecondGps(*head, fix_type, _hdop(eph), satellites if satellites < 255 else -1)


def _ratio(value: float) -> float:
    """A ratio of 0 or more, bounded, since it becomes metres; 0 for NaN."""
    return min(value, _MAX_RATIO) if value > 0.0 else 0.0


def _ekf_status(head: _Head, v: _Values) -> FilterStatus:
    velocity, position, _, compass, _, flags, *_ = v
    started, aided = not flags & _EKF_UNINITIALIZED and flags != 0, bool(flags & _ON_EARTH)
    ratios = _ratio(position), _ratio(velocity), _ratio(compass)
    return FilterStatus(*head, *ratios, math.nan, started, aided, bool(flags & _EKF_GLITCH))


def _estimator_status(head: _Head, v: _Values) -> FilterStatus:
    _, velocity, position, _, compass, _, _, accuracy, _, flags = v
    ratios, aided = (_ratio(position), _ratio(velocity), _ratio(compass)), bool(flags & _ON_EARTH)
    accuracy_m = min(accuracy, _MAX_ACCURACY_M) if accuracy > 0.0 else math.nan
    return FilterStatus(*head, *ratios, accuracy_m, flags != 0, aided, bool(flags & _ESTIMATOR_GLITCH))


def _sys_status(head: _Head, v: _Values) -> SensorHealth:
    present, enabled, health, _, millivolts, *_ = v
    used = present & enabled
    gps, estimate, arming = (bool(health & bit) if used & bit else None for bit in (_GPS, _AHRS, _ARMING))
    unhealthy = tuple(f"{name} unhealthy" for name, bits in _SENSORS.items() if used & bits & ~health)
    return SensorHealth(*head, gps, estimate, arming, unhealthy, _volts((millivolts,)), v[12])


def _volts(cells_mv: tuple[int, ...]) -> float:
    """Sum of what is known of the cells, NaN where nothing is; 0 is sent for cells that are not measured."""
    total = sum(cell for cell in cells_mv if cell != 65535)
    return total * 1e-3 if total else math.nan


def _battery(head: _Head, v: _Values) -> BatteryStatus:
    battery_id, function, _, charge, left_s, state = v[14:20]
    known_s = float(left_s) if left_s > 0 else math.nan  # 0 is sent where it is not reckoned
    return BatteryStatus(*head, battery_id, function, _volts(v[3:13] + v[20:24]), charge, state, known_s)


def _distance(head: _Head, v: _Values) -> DistanceSensor:
    _, least, most, distance, _, _, orientation, _, *_, quality = v
    return DistanceSensor(*head, least * 0.01, most * 0.01, distance * 0.01, orientation, quality)


def _terrain(head: _Head, v: _Values) -> TerrainReport:
    _, _, _, height, spacing, _, _ = v
    return TerrainReport(*head, height, spacing)


def _gimbal(head: _Head, v: _Values) -> GimbalAttitude:
    boot_ms, w, x, y, z, _, _, _, _, flags, *_, device_id = v
    return GimbalAttitude(*head, boot_ms, flags, (w, x, y, z), device_id)


def _mount(head: _Head, v: _Values) -> MountOrientation:
    boot_ms, roll, pitch, yaw, yaw_absolute = v
    return MountOrientation(*head, boot_ms, roll * _RAD, pitch * _RAD, yaw * _RAD, yaw_absolute * _RAD)


def _mount_status(head: _Head, v: _Values) -> MountStatus:
    pitch, roll, yaw = (angle * 0.01 * _RAD for angle in v[:3])
    return MountStatus(*head, roll, pitch, yaw)


def _given(value: float) -> float:
    """NaN for 0, which means a field that the sender left out."""
    return value if value != 0.0 else math.nan


def _camera_information(head: _Head, v: _Values) -> CameraInformation:
    _, _, focal, sensor_w, sensor_h, flags, width, height, _ = v[:9]
    gimbal_id, device_id = v[-2:]
    vendor, model = bytes(v[9:41]), bytes(v[41:73])
    return CameraInformation(
        *head,
        clean_text(vendor),
        clean_text(model),
        _given(focal * 1e-3),
        _given(sensor_w * 1e-3),
        _given(sensor_h * 1e-3),
        width,
        height,
        flags,
        gimbal_id,
        device_id,
    )


def _camera_settings(head: _Head, v: _Values) -> CameraSettings:
    _, _, zoom, _, device_id = v
    return CameraSettings(*head, zoom, device_id)


def _place(lat: int, lon: int) -> tuple[float, float]:
    """Degrees; NaN for what the sender marks as unknown or as beyond the horizon."""
    return (lat * 1e-7, lon * 1e-7) if max(abs(lat), abs(lon)) <= 1_800_000_000 else (math.nan, math.nan)


def _camera_fov(head: _Head, v: _Values) -> CameraFov:
    boot_ms, lat, lon, _, lat_middle, lon_middle, _, w, x, y, z, hfov, vfov, device_id = v
    return CameraFov(
        *head,
        boot_ms,
        (w, x, y, z),
        _given(hfov * _RAD),
        _given(vfov * _RAD),
        _place(lat, lon),
        _place(lat_middle, lon_middle),
        device_id,
    )


def _video_stream(head: _Head, v: _Values) -> VideoStreamInformation:
    rate, _, _, width, height, rotation, hfov, stream_id, _, kind, name, uri, encoding, device_id = v
    return VideoStreamInformation(
        *head,
        stream_id,
        clean_text(name),
        clean_text(uri),
        _given(rate),
        width,
        height,
        _given(hfov * _RAD),
        rotation,
        device_id,
        kind,
        encoding,
    )


def _statustext(head: _Head, v: _Values) -> StatusText:
    return StatusText(*head, v[0], clean_text(v[1]), v[2], v[3])


def _radio(head: _Head, v: _Values) -> RadioStatus:
    errors, corrected, rssi, remote_rssi, tx_buffer, noise, remote_noise = v
    return RadioStatus(*head, rssi, remote_rssi, noise, remote_noise, tx_buffer, errors, corrected)


_MAKERS: dict[int, Callable[[_Head, _Values], Sample]] = {
    ardupilotmega.MAVLINK_MSG_ID_HEARTBEAT: _heartbeat,
    ardupilotmega.MAVLINK_MSG_ID_SYS_STATUS: _sys_status,
    ardupilotmega.MAVLINK_MSG_ID_SYSTEM_TIME: _system_time,
    ardupilotmega.MAVLINK_MSG_ID_GPS_RAW_INT: _gps_raw,
    ardupilotmega.MAVLINK_MSG_ID_ATTITUDE: _attitude,
    ardupilotmega.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: _attitude_quaternion,
    ardupilotmega.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: _global_position,
    ardupilotmega.MAVLINK_MSG_ID_RADIO_STATUS: _radio,
    ardupilotmega.MAVLINK_MSG_ID_TIMESYNC: _timesync,
    ardupilotmega.MAVLINK_MSG_ID_GPS2_RAW: _second_gps,
    ardupilotmega.MAVLINK_MSG_ID_DISTANCE_SENSOR: _distance,
    ardupilotmega.MAVLINK_MSG_ID_TERRAIN_REPORT: _terrain,
    ardupilotmega.MAVLINK_MSG_ID_BATTERY_STATUS: _battery,
    ardupilotmega.MAVLINK_MSG_ID_MOUNT_STATUS: _mount_status,
    ardupilotmega.MAVLINK_MSG_ID_RADIO: _radio,
    ardupilotmega.MAVLINK_MSG_ID_EKF_STATUS_REPORT: _ekf_status,
    ardupilotmega.MAVLINK_MSG_ID_ESTIMATOR_STATUS: _estimator_status,
    ardupilotmega.MAVLINK_MSG_ID_STATUSTEXT: _statustext,
    ardupilotmega.MAVLINK_MSG_ID_CAMERA_INFORMATION: _camera_information,
    ardupilotmega.MAVLINK_MSG_ID_CAMERA_SETTINGS: _camera_settings,
    ardupilotmega.MAVLINK_MSG_ID_MOUNT_ORIENTATION: _mount,
    ardupilotmega.MAVLINK_MSG_ID_VIDEO_STREAM_INFORMATION: _video_stream,
    ardupilotmega.MAVLINK_MSG_ID_CAMERA_FOV_STATUS: _camera_fov,
    ardupilotmega.MAVLINK_MSG_ID_GIMBAL_DEVICE_ATTITUDE_STATUS: _gimbal,
}


def _decoder(message_id: int) -> tuple[Callable[[_Head, _Values], Sample], struct.Struct, int]:
    unpacker: struct.Struct = ardupilotmega.mavlink_map[message_id].unpacker
    return _MAKERS[message_id], unpacker, unpacker.size


_DECODERS = {message_id: _decoder(message_id) for message_id in _MAKERS}


def decode(packet: Packet) -> Sample | None:
    """The message in a packet in SI units, None for one that this program does not use."""
    raw = packet.raw
    if raw[0] == MAGIC_V2:
        message_id, start = raw[7] | raw[8] << 8 | raw[9] << 16, 10
        head = (packet.t_us, raw[5], raw[6])
    else:
        message_id, start = raw[5], 6
        head = (packet.t_us, raw[3], raw[4])
    decoder = _DECODERS.get(message_id)
    if decoder is None:
        return None
    make, unpacker, size = decoder
    payload = raw[start : start + raw[1]]
    return make(head, unpacker.unpack(payload if len(payload) == size else payload.ljust(size, b"\0")))
