"""What a UAV says about its gimbal and its camera."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mavlink.geodesy import R_ENU_NED, quaternion_from_euler, rotation_from_euler, rotation_from_quaternion
from mavlink.history import History
from mavlink.samples import CameraFov, CameraInformation, GimbalAttitude, MountOrientation, VideoStreamInformation
from mavlink.state import CameraReport

__all__ = ["GIMBAL_LOST_S", "CameraReports", "Gimbals"]

GIMBAL_LOST_S = 1.0
YAW_LOCK, YAW_IN_VEHICLE_FRAME, YAW_IN_EARTH_FRAME = 16, 32, 64

Quaternion = tuple[float, float, float, float]


def yaw_is_absolute(flags: int) -> bool:
    """Whether a gimbal's yaw counts from north; older gimbals say it by their yaw lock."""
    if flags & (YAW_IN_VEHICLE_FRAME | YAW_IN_EARTH_FRAME):
        return bool(flags & YAW_IN_EARTH_FRAME)
    return bool(flags & YAW_LOCK)


class Gimbals:
    """Attitudes of the UAV's gimbal by the UAV's boot time in µs; the first device that speaks is the one."""

    def __init__(self) -> None:
        self._history: History[tuple[Quaternion, bool]] = History(size=300)
        self._device: tuple[int, int] | None = None
        self._speaks = False

    def clear(self) -> None:
        """Forgets every attitude, for a UAV that has rebooted."""
        self._history.clear()

    def take_device(self, boot_us: int, sample: GimbalAttitude) -> None:
        """GIMBAL_DEVICE_ATTITUDE_STATUS."""
        device = (sample.component_id, sample.device_id)
        self._device = self._device or device
        if device == self._device and 0.25 < sum(v * v for v in sample.q) < 4.0:
            self._speaks = True
            self._history.add(boot_us, (sample.q, yaw_is_absolute(sample.flags)))

    def take_mount(self, boot_us: int, sample: MountOrientation) -> None:
        """MOUNT_ORIENTATION, used as long as no gimbal device speaks for itself."""
        relative = math.isfinite(sample.yaw)
        yaw = sample.yaw if relative else sample.yaw_absolute
        if not self._speaks and math.isfinite(sample.roll + sample.pitch + yaw):
            self._history.add(boot_us, (quaternion_from_euler(sample.roll, sample.pitch, yaw), not relative))

    def at(self, boot_us: int, body_yaw: float) -> NDArray[np.float64] | None:
        """R_enu_gimbal (3, 3), None when nothing was heard in the last second.

        Args:
            boot_us: the time.
            body_yaw: of the UAV then, NaN unknown.
        """
        before, after = self._history.around(boot_us)
        if before is None or boot_us - before[0] > GIMBAL_LOST_S * 1e6:
            return None
        q, absolute = before[1]
        if after is not None and after[1][1] == absolute and after[0] - before[0] <= GIMBAL_LOST_S * 1e6:
            q = _nlerp(q, after[1][0], (boot_us - before[0]) / (after[0] - before[0]))
        # R_enu_gimbal = R_enu_ned Rz(ψ_body) R(q): roll and pitch from the horizon, yaw from the nose or from north
        R = R_ENU_NED @ rotation_from_quaternion(q)
        if not absolute:
            R = R_ENU_NED @ rotation_from_euler(0.0, 0.0, body_yaw) @ R_ENU_NED @ R
        return R if np.isfinite(R).all() else None


def _nlerp(a: Quaternion, b: Quaternion, s: float) -> Quaternion:
    """Between two rotations, the short way; not normalised, as the rotation matrix does not ask for it."""
    sign = 1.0 if sum(x * y for x, y in zip(a, b, strict=True)) >= 0.0 else -1.0
    w, x, y, z = ((1.0 - s) * p + s * sign * q for p, q in zip(a, b, strict=True))
    return w, x, y, z


class CameraReports:
    """Puts together what several messages say about the camera."""

    def __init__(self) -> None:
        self._information: CameraInformation | None = None
        self._fov: CameraFov | None = None
        self._stream: VideoStreamInformation | None = None
        self._report: CameraReport | None = None

    @property
    def report(self) -> CameraReport | None:
        """The camera, None as long as its picture's size or its field of view is unknown."""
        return self._report

    def take(self, sample: CameraInformation | CameraFov | VideoStreamInformation) -> None:
        """Any of the three messages."""
        if isinstance(sample, CameraInformation):
            self._information = sample
        elif isinstance(sample, CameraFov):
            self._fov = sample
        elif self._stream is None or sample.stream_id <= self._stream.stream_id:
            self._stream = sample
        self._report = self._put_together()

    def _put_together(self) -> CameraReport | None:
        information, stream = self._information, self._stream
        source = stream if stream is not None and stream.width_px and stream.height_px else information
        if source is None or not (source.width_px and source.height_px):
            return None
        width, height = source.width_px, source.height_px
        fx, fy = self._focal_px(width, height)
        if not (math.isfinite(fx) and math.isfinite(fy)):
            return None
        return CameraReport(
            width=width,
            height=height,
            fx=fx,
            fy=fy,
            cx=width / 2.0,
            cy=height / 2.0,
            model=information.model if information else "",
            uri=stream.uri if stream else "",
        )

    def _focal_px(self, width: int, height: int) -> tuple[float, float]:
        """Focal lengths in pixels: by the field of view now, by that of the stream, by lens and sensor.

        f = (w / 2) / tan(hfov / 2)  or  f = w · focal length / sensor width
        """
        fov, stream, lens = self._fov, self._stream, self._information
        if fov is not None and 0.0 < fov.hfov < math.pi:
            fx = width / 2.0 / math.tan(fov.hfov / 2.0)
            return fx, height / 2.0 / math.tan(fov.vfov / 2.0) if 0.0 < fov.vfov < math.pi else fx
        if stream is not None and 0.0 < stream.hfov < math.pi:
            fx = width / 2.0 / math.tan(stream.hfov / 2.0)
            return fx, fx
        if lens is not None:
            fx = width * lens.focal_length_m / lens.sensor_width_m
            return fx, fx  # pixels are square; the sensor's height may belong to another aspect
        return math.nan, math.nan
