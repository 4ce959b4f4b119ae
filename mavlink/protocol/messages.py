"""Decoded messages in SI units: one frozen record per message kind.

Angles in radians, yaw and headings clockwise from north, velocities in north-east-down as the wire has them.
NaN is unknown. All begin with the time of arrival and the sender. Records are made by position, not by keyword, because
that happens thousands of times a second; those that come most often are tuples, which are made fastest.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple


@dataclass(frozen=True, slots=True)
class _Sample:
    t_us: int
    """Unix µs of arrival."""
    system_id: int
    component_id: int


@dataclass(frozen=True, slots=True)
class Heartbeat(_Sample):
    """HEARTBEAT (0)."""

    type: int
    """MAV_TYPE."""
    autopilot: int
    """MAV_AUTOPILOT, 8 for anything that is none."""
    base_mode: int
    custom_mode: int
    status: int
    """MAV_STATE; independent of armed."""

    @property
    def armed(self) -> bool:
        """True if the motors may turn."""
        return bool(self.base_mode & 128)


@dataclass(frozen=True, slots=True)
class SystemTime(_Sample):
    """SYSTEM_TIME (2)."""

    unix_us: int
    """Unix time by the vehicle's own clock, 0 unknown; often off by a second, so never relied on."""
    boot_ms: int


@dataclass(frozen=True, slots=True)
class TimeSync(_Sample):
    """TIMESYNC (111)."""

    tc1_ns: int
    """0 in a request."""
    ts1_ns: int


class Attitude(NamedTuple):
    """ATTITUDE (30) or ATTITUDE_QUATERNION (31)."""

    t_us: int
    """Unix µs of arrival."""
    system_id: int
    component_id: int
    boot_ms: int
    roll: float
    pitch: float
    yaw: float
    roll_rate: float
    """Body rates, rad/s."""
    pitch_rate: float
    yaw_rate: float


class GlobalPosition(NamedTuple):
    """GLOBAL_POSITION_INT (33), not checked yet: it may hold 0/0 and impossible values."""

    t_us: int
    """Unix µs of arrival."""
    system_id: int
    component_id: int
    boot_ms: int
    lat_deg: float
    lon_deg: float
    alt_m: float
    """Altitude above sea level."""
    relative_alt_m: float
    """Height above home."""
    v_north: float
    v_east: float
    v_down: float
    heading: float
    """Heading of the nose, 0..2π, NaN unknown."""


@dataclass(frozen=True, slots=True)
class GpsRaw(_Sample):
    """GPS_RAW_INT (24)."""

    fix_type: int
    """GPS_FIX_TYPE: 0 no receiver, 1 no fix, 2 2D, 3 3D, 4 DGPS, 5 RTK float, 6 RTK fixed."""
    lat_deg: float
    lon_deg: float
    alt_m: float
    hdop: float
    satellites: int
    """−1 when unknown."""
    h_acc_m: float
    """1σ horizontal accuracy."""
    v_acc_m: float
    fix_us: int
    """Time of the fix: µs since boot on most autopilots, Unix time on some, 0 unknown."""
    speed: float
    """Over ground, m/s, NaN unknown."""
    course: float
    """Over ground, clockwise from north, rad, NaN unknown."""


@dataclass(frozen=True, slots=True)
class SecondGps(_Sample):
    """GPS2_RAW (124): what a second receiver makes of its satellites."""

    fix_type: int
    hdop: float
    satellites: int


@dataclass(frozen=True, slots=True)
class FilterStatus(_Sample):
    """EKF_STATUS_REPORT (193) or ESTIMATOR_STATUS (230): how well an autopilot's filter and its sensors agree."""

    position_ratio: float
    """Horizontal innovation over what the filter allows: from 1 on the measurement is rejected. So are the others."""
    velocity_ratio: float
    compass_ratio: float
    accuracy_m: float
    """1σ of the horizontal position, NaN unknown."""
    started: bool
    aided: bool
    """An absolute position, mostly from a satellite receiver, corrects the estimate."""
    glitch: bool
    """The filter reports a glitch of its receiver."""


@dataclass(frozen=True, slots=True)
class SensorHealth(_Sample):
    """SYS_STATUS (1): whether sensors in use are healthy by the autopilot's report, None where not in use."""

    gps: bool | None
    estimate: bool | None
    """Health of attitude and position (AHRS)."""
    arming: bool | None
    """True if it could be armed."""
    unhealthy: tuple[str, ...]
    """Other sensors that are in use and not healthy, in words."""
    voltage_v: float
    """Voltage of its first battery."""
    charge_percent: int
    """Charge of the battery, −1 unknown; not checked yet."""


@dataclass(frozen=True, slots=True)
class BatteryStatus(_Sample):
    """BATTERY_STATUS (147)."""

    battery_id: int
    function: int
    """MAV_BATTERY_FUNCTION: 4 a payload's."""
    voltage_v: float
    charge_percent: int
    """−1 unknown; not checked yet."""
    state: int
    """MAV_BATTERY_CHARGE_STATE: 2 low, 3 critical, 4 emergency, 5 failed, 6 unhealthy; all else is well."""
    left_s: float
    """Time until it is empty by the autopilot's reckoning, NaN unknown."""


@dataclass(frozen=True, slots=True)
class DistanceSensor(_Sample):
    """DISTANCE_SENSOR (132)."""

    min_m: float
    """Ranges that are not between these two are none."""
    max_m: float
    distance_m: float
    orientation: int
    """MAV_SENSOR_ORIENTATION: 25 down."""
    quality: int
    """Percent; 0 unknown, 1 an invalid range."""


@dataclass(frozen=True, slots=True)
class TerrainReport(_Sample):
    """TERRAIN_REPORT (136): the autopilot's place on its own map of the terrain."""

    current_height_m: float
    """Height of the vehicle above the ground."""
    spacing_m: int
    """Spacing of the map's grid, 0 where there is none."""


@dataclass(frozen=True, slots=True)
class GimbalAttitude(_Sample):
    """GIMBAL_DEVICE_ATTITUDE_STATUS (285)."""

    boot_ms: int
    flags: int
    q: tuple[float, float, float, float]
    """w, x, y, z; what its yaw is relative to is in the flags."""
    device_id: int


@dataclass(frozen=True, slots=True)
class MountOrientation(_Sample):
    """MOUNT_ORIENTATION (265)."""

    boot_ms: int
    roll: float
    """Relative to the horizon."""
    pitch: float
    yaw: float
    """Relative to the vehicle's nose."""
    yaw_absolute: float
    """Relative to north."""


@dataclass(frozen=True, slots=True)
class MountStatus(_Sample):
    """MOUNT_STATUS (158), of ArduPilot before 4.3."""

    roll: float
    """Relative to the horizon."""
    pitch: float
    yaw: float
    """Relative to the vehicle's nose."""
    boot_ms: int = 0
    """Boot time: the message has none."""


@dataclass(frozen=True, slots=True)
class CameraInformation(_Sample):
    """CAMERA_INFORMATION (259)."""

    vendor: str
    model: str
    focal_length_m: float
    """NaN or 0 unknown; not checked yet, like all lengths and angles of cameras."""
    sensor_width_m: float
    sensor_height_m: float
    width_px: int
    """0 unknown."""
    height_px: int
    flags: int
    gimbal_id: int
    """Gimbal that carries the camera: a device id 1-6 or a component id, 0 unknown."""
    device_id: int
    """1-6 of a camera whose messages its autopilot sends, 0 of one that sends its own."""


@dataclass(frozen=True, slots=True)
class CameraSettings(_Sample):
    """CAMERA_SETTINGS (260)."""

    zoom_percent: float
    """Percent of the camera's whole range, 0..100, NaN unknown."""
    device_id: int


@dataclass(frozen=True, slots=True)
class CameraFov(_Sample):
    """CAMERA_FOV_STATUS (271)."""

    boot_ms: int
    q: tuple[float, float, float, float]
    """Camera, w, x, y, z; what its yaw is relative to is not defined. NaN unknown."""
    hfov: float
    """NaN unknown."""
    vfov: float
    camera: tuple[float, float]
    """Latitude and longitude of the camera in degrees, NaN unknown."""
    centre: tuple[float, float]
    """Place of the ground at the image's centre."""
    device_id: int


@dataclass(frozen=True, slots=True)
class VideoStreamInformation(_Sample):
    """VIDEO_STREAM_INFORMATION (269)."""

    stream_id: int
    name: str
    uri: str
    frame_rate: float
    width_px: int
    height_px: int
    hfov: float
    """NaN unknown."""
    rotation_deg: int
    """Rotation of the image, clockwise."""
    device_id: int
    type: int = 0
    """VIDEO_STREAM_TYPE: 0 RTSP, 1 RTP over UDP, 2 MPEG over TCP, 3 MPEG-TS over UDP."""
    encoding: int = 0
    """VIDEO_STREAM_ENCODING: 0 unknown, 1 H.264, 2 H.265."""


@dataclass(frozen=True, slots=True)
class StatusText(_Sample):
    """STATUSTEXT (253), control characters replaced. It is never markup."""

    severity: int
    """MAV_SEVERITY: 0 emergency .. 7 debug."""
    text: str
    text_id: int
    """Number of a longer text of which this is one piece; 0: it is a whole text."""
    chunk: int


@dataclass(frozen=True, slots=True)
class RadioStatus(_Sample):
    """RADIO_STATUS (109) or RADIO (166): a modem's report on both ends of its link."""

    rssi: int
    """Device units; 255 unknown."""
    remote_rssi: int
    noise: int
    remote_noise: int
    tx_buffer: int
    """Free share of the send buffer, percent."""
    errors: int
    corrected: int


Sample = (
    Heartbeat
    | SystemTime
    | TimeSync
    | Attitude
    | GlobalPosition
    | GpsRaw
    | FilterStatus
    | SecondGps
    | SensorHealth
    | BatteryStatus
    | GimbalAttitude
    | MountOrientation
    | MountStatus
    | CameraInformation
    | CameraSettings
    | CameraFov
    | VideoStreamInformation
    | StatusText
    | RadioStatus
    | DistanceSensor
    | TerrainReport
)
"""Everything that :func:`mavlink.protocol.decode.decode` can return."""
