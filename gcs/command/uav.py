"""State of the UAV that commands need to know, by its own packets."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable

from gcs.command.mav_cmd import GeoPoint
from mavlink.estimation.gimbal import Gimbals, GimbalSample
from mavlink.geodesy import LocalFrame, wrap_pi
from mavlink.protocol.decode import decode
from mavlink.protocol.messages import (
    Attitude,
    CameraFov,
    GimbalAttitude,
    GlobalPosition,
    Heartbeat,
    MountOrientation,
    MountStatus,
    StatusText,
)
from mavlink.protocol.modes import is_vehicle, kind_name, mode_name
from mavlink.protocol.packet import Packet

_ACK, _GIMBAL_MANAGERS, _GIMBAL_MANAGER_STATUS = 77, (280, 281), 281
_IN_PROGRESS = 5
_CAMERA_TYPE = 30
_FRESH_S = 3.0
_AXIS_S = 1.0
"""A gimbal that was silent for this long may look elsewhere."""
_TEXTS = 40


class Uav:
    """The newest state of one vehicle. One thread takes packets, another reads.

    Args:
        gimbal: that carries the camera, as :class:`mavlink.estimation.gimbal.Gimbals` has it.
        clock: seconds, monotonic.
    """

    def __init__(self, gimbal: int = 0, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._beat: Heartbeat | None = None
        self._position: tuple[float, GlobalPosition] | None = None
        self._texts: deque[tuple[float, str]] = deque(maxlen=_TEXTS)
        self._progress: dict[int, int] = {}
        self._nose: tuple[float, float] | None = None
        self._gimbals = Gimbals(gimbal)
        self._axis: tuple[float, tuple[float, float, float]] | None = None
        self.camera_component = 1
        """Component of the first camera that sends heartbeats, the autopilot's without one."""
        self.gimbal_component = 1
        """Component of the newest gimbal manager that sent, the autopilot's without one."""
        self.gimbal_holder: tuple[int, int] | None = None
        """System and component in primary control of the gimbal, (0, 0) for none, None while it is not reported."""

    def receive(self, packet: Packet) -> None:
        """Take in an accepted packet of the UAV."""
        if packet.message_id == _ACK:
            payload = packet.payload.ljust(4, b"\0")
            if payload[2] == _IN_PROGRESS:
                self._progress[int.from_bytes(payload[:2], "little")] = payload[3]
            return
        if packet.message_id in _GIMBAL_MANAGERS:
            self.gimbal_component = packet.component_id
            if packet.message_id == _GIMBAL_MANAGER_STATUS:
                payload = packet.payload.ljust(11, b"\0")
                self.gimbal_holder = (payload[9], payload[10])
            return
        sample = decode(packet)
        if isinstance(sample, GimbalAttitude | MountOrientation | MountStatus | CameraFov):
            self._add_gimbal_report(sample)
        elif isinstance(sample, Heartbeat):
            self._add_heartbeat(sample)
        elif isinstance(sample, StatusText):
            self._texts.append((self._clock(), sample.text))
        elif isinstance(sample, GlobalPosition) and packet.component_id == 1:
            self._position = (self._clock(), sample)
        elif isinstance(sample, Attitude) and packet.component_id == 1:
            self._nose = (self._clock(), sample.yaw)

    def _add_heartbeat(self, sample: Heartbeat) -> None:
        if is_vehicle(sample.type, sample.autopilot):
            self._beat = sample
        elif sample.type == _CAMERA_TYPE and self.camera_component == 1:
            self.camera_component = sample.component_id

    def _add_gimbal_report(self, sample: GimbalSample) -> None:
        """Direction of the gimbal, by its newest report."""
        now_s, nose = self._clock(), self.nose
        self._gimbals.add(round(now_s * 1e6), sample, nose)
        R_enu_gimbal = self._gimbals.at(round(now_s * 1e6), nose)
        if R_enu_gimbal is not None:
            east, north, up = R_enu_gimbal[:, 0].tolist()
            self._axis = (now_s, (east, north, up))

    @property
    def kind(self) -> str:
        """Vehicle type in a word, empty before the first heartbeat."""
        return kind_name(self._beat.type) if self._beat is not None else ""

    @property
    def autopilot(self) -> int:
        """MAV_AUTOPILOT, 0 before the first heartbeat."""
        return self._beat.autopilot if self._beat is not None else 0

    @property
    def mode(self) -> str:
        """Flight mode in a word, empty before the first heartbeat."""
        beat = self._beat
        return mode_name(beat.type, beat.autopilot, beat.base_mode, beat.custom_mode) if beat is not None else ""

    @property
    def alt_m(self) -> float:
        """Height above sea level now, NaN when unknown or old."""
        sample = self._fresh
        return sample.alt_m if sample is not None else math.nan

    @property
    def ground_m(self) -> float:
        """Height above sea level of the ground at its home, NaN when unknown or old."""
        sample = self._fresh
        return sample.alt_m - sample.relative_alt_m if sample is not None else math.nan

    @property
    def nose(self) -> float:
        """Direction of its nose from north, radians, NaN when unknown or old."""
        held = self._nose
        return held[1] if held is not None and self._clock() - held[0] <= _FRESH_S else math.nan

    @property
    def axis(self) -> tuple[float, float, float] | None:
        """Reported direction of its gimbal: east, north, up, of length 1; None when unknown or old."""
        held = self._axis
        return held[1] if held is not None and self._clock() - held[0] <= _AXIS_S else None

    def direction_to(self, place: GeoPoint) -> tuple[float, float, float] | None:
        """Direction from it to a place on the ground: east, north, up, of length 1; None when its own is not known."""
        sample = self._fresh
        if sample is None:
            return None
        frame = LocalFrame(sample.lat_deg, sample.lon_deg, sample.alt_m)
        east, north, up = frame.to_enu_point(place.lat_deg, place.lon_deg, self.ground_m)
        length = math.hypot(east, north, up)
        return (east / length, north / length, up / length) if length else None

    def off_rad(self, place: GeoPoint) -> float:
        """Angle between where its gimbal reports to look and a place on the ground, NaN when unknown."""
        axis, way = self.axis, self.direction_to(place)
        if axis is None or way is None:
            return math.nan
        return math.acos(max(-1.0, min(1.0, sum(a * b for a, b in zip(axis, way, strict=True)))))

    def angles_to(self, place: GeoPoint) -> tuple[float, float, float] | None:
        """Pitch from the horizon, yaw from north and yaw from the nose to a place; radians, None when unknown."""
        way, nose = self.direction_to(place), self.nose
        if way is None or math.isnan(nose):
            return None
        east, north, up = way
        yaw = math.atan2(east, north)
        return math.atan2(up, math.hypot(east, north)), yaw, wrap_pi(yaw - nose)

    @property
    def _fresh(self) -> GlobalPosition | None:
        held = self._position
        if held is None or self._clock() - held[0] > _FRESH_S or not (held[1].lat_deg or held[1].lon_deg):
            return None
        return held[1]

    def texts_since(self, since_s: float) -> tuple[str, ...]:
        """Texts that it sent since a moment of the clock."""
        return tuple(text for at_s, text in list(self._texts) if at_s >= since_s)

    def take_progress(self, command: int) -> int:
        """Percent that the last answer "in progress" to a command reported, 255 for none; returned once."""
        return self._progress.pop(command, 255)
