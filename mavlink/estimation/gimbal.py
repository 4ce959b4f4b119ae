"""The attitude of a UAV's gimbal, from whichever message reports it.

Several messages do, and several gimbals may. The highest in rank of those received lately is used:

    GIMBAL_DEVICE_ATTITUDE_STATUS   the gimbal protocol's own, with the frame of its yaw in its flags
    MOUNT_ORIENTATION               older, angles
    MOUNT_STATUS                    oldest (ArduPilot before 4.3), hundredths of degrees
    CAMERA_FOV_STATUS               the camera's attitude beside its field of view

Roll and pitch count from the horizon in all of them, whatever the lock flags: those describe how the gimbal is driven.
Yaw counts from north ("earth") or from the nose ("vehicle").
"""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from infra.reporting import ReportOnce
from mavlink.estimation.interpolation import Insertion, SampleBuffer
from mavlink.geodesy import (
    R_ENU_NED,
    quaternion_from_euler,
    rotation_from_euler,
    rotation_from_quaternion,
    wrap_pi,
)
from mavlink.protocol.messages import CameraFov, GimbalAttitude, MountOrientation, MountStatus
from mavlink.protocol.packet import Packet

GIMBAL_LOST_S = 1.0
"""An attitude older than this is not used, and no interpolation bridges a longer gap."""
_BUFFER_SIZE = 300
"""Attitudes kept: half a minute at 10 Hz."""
OUTRANKED_US = 3_000_000
"""A message that has not come for this long no longer outranks others."""
_MAX_ANGLE = 2.0 * math.pi
"""rad; no gimbal reports more."""
YAW_LOCK, YAW_IN_VEHICLE_FRAME, YAW_IN_EARTH_FRAME = 16, 32, 64
AGREES = math.radians(20.0)
"""Difference below which two bearings are the same: one of them comes from a compass."""
OVERHEAD = math.sin(math.radians(5.0))
"""Horizontal part of an optical axis below which its bearing means nothing."""

_COMMAND_ACK, _ACCEPTED = 77, 0
_TURNING_COMMANDS = frozenset({195, 197, 198, 201, 205, 1000})
"""DO_SET_ROI_LOCATION, _NONE, _SYSID, DO_SET_ROI, DO_MOUNT_CONTROL, DO_GIMBAL_MANAGER_PITCHYAW."""

NO_ROTATION = "its quaternion is no rotation"

Quaternion = tuple[float, float, float, float]
Frame = Literal["earth", "vehicle"]
GimbalSample = GimbalAttitude | MountOrientation | MountStatus | CameraFov

_QUATERNION_NORM = 0.25, 4.0
"""Squared norms between which a quaternion is a rotation: not exactly 1, as senders round, and not 0."""

_NAMES: dict[type, str] = {
    GimbalAttitude: "GIMBAL_DEVICE_ATTITUDE_STATUS",
    MountOrientation: "MOUNT_ORIENTATION",
    MountStatus: "MOUNT_STATUS",
    CameraFov: "CAMERA_FOV_STATUS",
}
_RANK = list(_NAMES)


def turns_camera(packet: Packet) -> bool:
    """Tell whether a packet acknowledges a command, of whatever sender, that turns the camera."""
    if packet.message_id != _COMMAND_ACK:
        return False
    command, result = packet.payload.ljust(3, b"\0")[:2], packet.payload.ljust(3, b"\0")[2]
    return result == _ACCEPTED and int.from_bytes(command, "little") in _TURNING_COMMANDS


def yaw_frame(flags: int) -> Frame | None:
    """Frame that the yaw of GIMBAL_DEVICE_ATTITUDE_STATUS counts from; None for flags that claim both frames.

    Without either flag the yaw lock decides, as the message's definition specifies for older gimbals.
    """
    vehicle, earth = bool(flags & YAW_IN_VEHICLE_FRAME), bool(flags & YAW_IN_EARTH_FRAME)
    if vehicle and earth:
        return None
    return "earth" if earth or (not vehicle and flags & YAW_LOCK) else "vehicle"


class Gimbals:
    """Attitudes of the UAV's gimbal by the UAV's boot time in µs.

    Args:
        chosen: the gimbal to use, by device id 1-6 or component id. 0: the one that CAMERA_INFORMATION names, else the
            first that reports.
    """

    def __init__(self, chosen: int = 0) -> None:
        self._chosen = chosen
        self._buffer: SampleBuffer[tuple[Quaternion, Frame]] = SampleBuffer(size=_BUFFER_SIZE)
        self._device = chosen
        self._camera_gimbal = 0
        self._source: type | None = None
        self._newest_us: dict[type, int] = {}
        self._fov_frame: Frame = "earth"
        self._reports = ReportOnce()

    def clear(self) -> None:
        """Remove every attitude, for a UAV whose boot times started again."""
        self._buffer.clear()
        self._newest_us.clear()

    def set_camera_gimbal(self, gimbal_id: int) -> None:
        """Set the gimbal that a camera reports to be mounted on; 0 for none."""
        self._camera_gimbal = gimbal_id

    def add(self, boot_us: int, sample: GimbalSample, body_yaw: float) -> list[str]:
        """Keep an attitude.

        Args:
            boot_us: when it held.
            body_yaw: of the UAV then, NaN unknown.

        Returns:
            What an operator should know: another source, another gimbal, an invalid attitude. Each once.
        """
        if isinstance(sample, GimbalAttitude) and not self._is_ours(sample.device_id or sample.component_id):
            other = sample.device_id or sample.component_id
            return self._reports.new([f"gimbal {other} reports too and is not used: [camera] gimbal chooses"])
        if isinstance(sample, MountOrientation | MountStatus) and self._chosen not in (0, sample.component_id):
            return []
        name = _NAMES[type(sample)]
        attitude = self._attitude(sample, body_yaw)
        if attitude is None:
            return []
        if isinstance(attitude, str):
            return self._reports.new([f"{name} not used: {attitude}"])
        if self._outranked(boot_us, type(sample)):
            return []
        self._newest_us[type(sample)] = boot_us
        texts = []
        if self._source is not type(sample):
            self._source = type(sample)
            self._buffer.clear()
            texts = self._reports.new([f"gimbal attitude from {name}"])
        if self._buffer.add(boot_us, attitude) is Insertion.TOO_LATE:
            texts += self._reports.new([f"{name} not used: its times are seconds before those of earlier ones"])
        return texts

    @property
    def newest(self) -> tuple[int, tuple[Quaternion, Frame]] | None:
        """The newest attitude, its quaternion and frame, and its time."""
        return self._buffer.newest

    def at(self, boot_us: int, body_yaw: float) -> NDArray[np.float64] | None:
        """R_enu_gimbal (3, 3), None when no attitude came in the last second.

        Args:
            body_yaw: of the UAV then, NaN unknown.
        """
        before, after = self._buffer.around(boot_us)
        if before is None or boot_us - before[0] > GIMBAL_LOST_S * 1e6:
            return None
        q, frame = before[1]
        if after is not None and after[1][1] == frame and after[0] - before[0] <= GIMBAL_LOST_S * 1e6:
            q = _nlerp(q, after[1][0], (boot_us - before[0]) / (after[0] - before[0]))
        # R_enu_gimbal = R_enu_ned Rz(ψ_body) R(q): roll and pitch from the horizon, yaw from the nose or from north
        turn = rotation_from_euler(0.0, 0.0, body_yaw) if frame == "vehicle" else np.eye(3)
        R = R_ENU_NED @ turn @ rotation_from_quaternion(q)
        return R if np.isfinite(R).all() else None

    def _is_ours(self, device: int) -> bool:
        """Tell whether a gimbal device is the one in use: the first, unless another is chosen or carries the camera."""
        if not self._chosen and (not self._device or (device == self._camera_gimbal and device != self._device)):
            self._device = device
            self._buffer.clear()
        return device == self._device

    def _outranked(self, boot_us: int, kind: type) -> bool:
        better = _RANK[: _RANK.index(kind)]
        return any(boot_us - self._newest_us.get(other, -OUTRANKED_US) < OUTRANKED_US for other in better)

    def _attitude(self, sample: GimbalSample, body_yaw: float) -> tuple[Quaternion, Frame] | str | None:
        """Quaternion and frame, the reason why there is none, or None when the message has none."""
        if isinstance(sample, GimbalAttitude):
            frame = yaw_frame(sample.flags)
            if frame is None:
                return "by its flags yaw counts from the nose and from north"
            return (sample.q, frame) if _is_rotation(sample.q) else NO_ROTATION
        if isinstance(sample, CameraFov):
            return self._camera_attitude(sample, body_yaw)
        relative = isinstance(sample, MountStatus) or math.isfinite(sample.yaw)
        yaw = sample.yaw if isinstance(sample, MountStatus) or relative else sample.yaw_absolute
        angles = (sample.roll, sample.pitch, yaw)
        if not all(map(math.isfinite, angles)):
            return None
        if max(map(abs, angles)) > _MAX_ANGLE:
            return "an angle beyond 360°"
        return quaternion_from_euler(*angles), "vehicle" if relative else "earth"

    def _camera_attitude(self, sample: CameraFov, body_yaw: float) -> tuple[Quaternion, Frame] | str | None:
        """The gimbal's frame by CAMERA_FOV_STATUS, which names none: the place at the image's centre decides.

        ArduPilot up to 4.5 counts yaw from the nose, later versions count from north.
        """
        if any(map(math.isnan, sample.q)) or not any(sample.q):
            return None
        if not _is_rotation(sample.q):
            return NO_ROTATION
        axis = rotation_from_quaternion(sample.q)[:, 0]
        bearing = _bearing(sample.camera, sample.centre)
        if math.isfinite(bearing) and math.hypot(axis[0], axis[1]) > OVERHEAD:
            turn = wrap_pi(bearing - math.atan2(axis[1], axis[0]))
            if abs(turn) < AGREES:
                self._fov_frame = "earth"
            elif abs(wrap_pi(turn - body_yaw)) < AGREES:
                self._fov_frame = "vehicle"
            elif math.isfinite(body_yaw):
                return "its attitude does not look at the place that it gives for the image's middle"
        return sample.q, self._fov_frame


def _is_rotation(q: Quaternion) -> bool:
    return _QUATERNION_NORM[0] < sum(v * v for v in q) < _QUATERNION_NORM[1]


def _bearing(camera: tuple[float, float], centre: tuple[float, float]) -> float:
    """Direction from one place (latitude, longitude in degrees) to another nearby, from north; NaN where either is
    unknown or both are the same."""
    north, east = centre[0] - camera[0], (centre[1] - camera[1]) * math.cos(math.radians(camera[0]))
    return math.atan2(east, north) if north or east else math.nan


def _nlerp(a: Quaternion, b: Quaternion, s: float) -> Quaternion:
    """Interpolate two rotations the short way; not normalised, since the rotation matrix does not need it."""
    sign = 1.0 if sum(x * y for x, y in zip(a, b, strict=True)) >= 0.0 else -1.0
    w, x, y, z = ((1.0 - s) * p + s * sign * q for p, q in zip(a, b, strict=True))
    return w, x, y, z
