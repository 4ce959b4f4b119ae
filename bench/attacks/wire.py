"""Packets, written by pymavlink alone: an oracle that shares nothing with the station's own reader and writer."""

from __future__ import annotations

import time
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

ROVER: Final = 10
COPTER: Final = 2
AUTOPILOT: Final = 3
"""MAV_AUTOPILOT_ARDUPILOTMEGA."""
NO_AUTOPILOT: Final = 8
"""MAV_AUTOPILOT_INVALID: a camera, a gimbal, a companion computer."""
SIGNING_EPOCH_S: Final = 1_420_070_400
"""2015-01-01 UTC, when the count of signing stamps begins."""
V2: Final = 0xFD
ACTIVE: Final = 4
ARMED: Final = 128 | 1
MANUAL_INPUT: Final = 64


def ticks_now(ahead_s: float = 0.0) -> int:
    """The signing stamp of this moment: units of 10 µs."""
    return int((time.time() + ahead_s - SIGNING_EPOCH_S) * 1e5)


class ComponentEncoder:
    """One component of one system, with its own sequence counter.

    Args:
        system_id: 1..255.
        component_id: 1 for an autopilot.
        key: 32 bytes to sign with, None unsigned.
        stamp: first signing stamp; each packet takes one more, as a clock that does not advance makes it.
        link_id: of the signatures.
        version: 1 for MAVLink 1.
    """

    def __init__(
        self,
        system_id: int,
        component_id: int = 1,
        *,
        key: bytes | None = None,
        stamp: int = 0,
        link_id: int = 0,
        version: int = 2,
    ) -> None:
        self._mav = dialect.MAVLink(None, srcSystem=system_id, srcComponent=component_id)
        self._version = version
        self.system_id, self.component_id = system_id, component_id
        if key is not None:
            signing = self._mav.signing
            signing.secret_key, signing.sign_outgoing, signing.link_id = key, True, link_id
            signing.timestamp = stamp

    @property
    def stamp(self) -> int:
        """The signing stamp of the next packet."""
        return int(self._mav.signing.timestamp)

    @stamp.setter
    def stamp(self, value: int) -> None:
        self._mav.signing.timestamp = value

    def pack(self, message: Any) -> bytes:  # noqa: ANN401 - pymavlink has no types
        """The bytes of a message of the dialect."""
        raw = bytes(message.pack(self._mav, force_mavlink1=self._version == 1))
        self._mav.seq = (self._mav.seq + 1) % 256
        return raw

    def heartbeat(self, kind: int = ROVER, autopilot: int = AUTOPILOT, *, marked: bool = False) -> bytes:
        """HEARTBEAT; a marked one differs in a flag unrelated to the mode, so that senders can be counted."""
        flags = ARMED | MANUAL_INPUT if marked else ARMED
        return self.pack(dialect.MAVLink_heartbeat_message(kind, autopilot, flags, 0, ACTIVE, 3))

    def position(
        self, boot_ms: int, place: tuple[float, float, float, float], speed: tuple[float, float], heading: float
    ) -> bytes:
        """GLOBAL_POSITION_INT.

        Args:
            boot_ms: time since boot.
            place: latitude and longitude, degrees; altitude and height above home, metres.
            speed: north and east, m/s.
            heading: degrees.
        """
        lat, lon, alt, height = place
        return self.pack(
            dialect.MAVLink_global_position_int_message(
                boot_ms % (1 << 32), round(lat * 1e7), round(lon * 1e7), round(alt * 1e3), round(height * 1e3),
                round(speed[0] * 100), round(speed[1] * 100), 0, round(heading * 100) % 36000,
            )
        )  # fmt: skip

    def attitude(self, boot_ms: int, yaw: float) -> bytes:
        """ATTITUDE, level; yaw in radians, -π..π."""
        return self.pack(dialect.MAVLink_attitude_message(boot_ms % (1 << 32), 0.0, 0.0, yaw, 0.0, 0.0, 0.0))

    def gps(self, boot_ms: int, place: tuple[float, float, float, float]) -> bytes:
        """GPS_RAW_INT with a 3D fix."""
        lat, lon, alt, _ = place
        return self.pack(
            dialect.MAVLink_gps_raw_int_message(
                boot_ms * 1000, 3, round(lat * 1e7), round(lon * 1e7), round(alt * 1e3), 80, 120, 200, 0, 14
            )
        )

    def status(self) -> bytes:
        """SYS_STATUS of a healthy vehicle."""
        sensors = 0x0120_FC0F
        return self.pack(
            dialect.MAVLink_sys_status_message(sensors, sensors, sensors, 300, 12_100, 900, 80, 0, 0, 0, 0, 0, 0)
        )

    def time(self, unix_us: int, boot_ms: int) -> bytes:
        """SYSTEM_TIME."""
        return self.pack(dialect.MAVLink_system_time_message(unix_us, boot_ms))

    def text(self, severity: int, text: str) -> bytes:
        return self.pack(dialect.MAVLink_statustext_message(severity, text.encode()))

    def parameter(self, value: float) -> bytes:
        """PARAM_VALUE: traffic without a position."""
        return self.pack(dialect.MAVLink_param_value_message(b"RATE", value, 9, 1, 0))

    def command(self, target: int, command: int, *params: float) -> bytes:
        """COMMAND_LONG to a system's autopilot."""
        values = [*params, *[0.0] * (7 - len(params))]
        return self.pack(dialect.MAVLink_command_long_message(target, 1, command, 0, *values))


def redated(raw: bytes, shift_us: int) -> bytes:
    """A recorded frame as it would be now: the Unix time in SYSTEM_TIME is moved, everything else stays."""
    system_time = dialect.MAVLINK_MSG_ID_SYSTEM_TIME
    if raw[0] != V2 or int.from_bytes(raw[7:10], "little") != system_time:
        return raw
    mav = dialect.MAVLink(None, srcSystem=raw[5], srcComponent=raw[6])
    message = mav.decode(bytearray(raw))
    mav.seq = raw[4]
    unix_us = message.time_unix_usec + shift_us if message.time_unix_usec else 0
    return bytes(dialect.MAVLink_system_time_message(unix_us, message.time_boot_ms).pack(mav))
