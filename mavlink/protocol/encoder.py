"""Makes MAVLink frames: SI units in, bytes out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega

COPTER, ROVER, GCS = 2, 10, 6
"""MAV_TYPE values."""
GENERIC, ARDUPILOT, NO_AUTOPILOT = 0, 3, 8
"""MAV_AUTOPILOT values."""

_ARMED, _CUSTOM_MODE = 128, 1
_STATE_ACTIVE = 4
_UINT16_MAX, _INT16_MAX = 65535, 32767


class MavlinkEncoder:
    """One MAVLink sender with its own sequence counter.

    Angles in radians, yaw clockwise from north, velocities north-east-down in m/s, times in milliseconds since boot.

    Args:
        system_id: 1..255.
        component_id: 1 is the autopilot.
        version: of MAVLink, 2 or 1.
        key: 32 bytes to sign with (MAVLink 2 only).
    """

    def __init__(self, system_id: int, component_id: int = 1, *, version: int = 2, key: bytes | None = None) -> None:
        self._mav: Any = ardupilotmega.MAVLink(None, srcSystem=system_id, srcComponent=component_id)
        self._version = version
        if key is not None:
            self._mav.signing.secret_key = key
            self._mav.signing.sign_outgoing = True
            self._mav.signing.timestamp = 1

    def pack(self, message: Any) -> bytes:  # noqa: ANN401  (the dialect's messages carry no types)
        """Any message of the dialect as a frame."""
        frame: bytes = message.pack(self._mav, force_mavlink1=self._version == 1)
        self._mav.seq = (self._mav.seq + 1) % 256
        return frame

    def heartbeat(
        self,
        kind: int = ROVER,
        *,
        autopilot: int = ARDUPILOT,
        custom_mode: int | None = 0,
        armed: bool = True,
        status: int = _STATE_ACTIVE,
    ) -> bytes:
        """HEARTBEAT; without a custom mode where that is None."""
        base_mode = (0 if custom_mode is None else _CUSTOM_MODE) | (_ARMED if armed else 0)
        mode = custom_mode or 0
        return self.pack(ardupilotmega.MAVLink_heartbeat_message(kind, autopilot, base_mode, mode, status, 3))

    def system_time(self, boot_ms: int, unix_us: int) -> bytes:
        """SYSTEM_TIME; unix_us 0 before the vehicle knows."""
        return self.pack(ardupilotmega.MAVLink_system_time_message(unix_us, boot_ms))

    def timesync(self, tc1_ns: int, ts1_ns: int) -> bytes:
        """TIMESYNC; tc1 0 asks."""
        return self.pack(ardupilotmega.MAVLink_timesync_message(tc1_ns, ts1_ns))

    def attitude(
        self, boot_ms: int, roll: float, pitch: float, yaw: float, rates: Sequence[float] = (0.0, 0.0, 0.0)
    ) -> bytes:
        """ATTITUDE."""
        return self.pack(ardupilotmega.MAVLink_attitude_message(boot_ms, roll, pitch, yaw, *rates))

    def global_position_int(
        self,
        boot_ms: int,
        lat_deg: float,
        lon_deg: float,
        alt_m: float,
        relative_alt_m: float = 0.0,
        v_ned: Sequence[float] = (0.0, 0.0, 0.0),
        heading: float = math.nan,
    ) -> bytes:
        """GLOBAL_POSITION_INT; NaN of heading and velocity is sent as unknown."""
        cdeg = _UINT16_MAX if math.isnan(heading) else round(math.degrees(heading) * 100.0) % 36000
        return self.pack(
            ardupilotmega.MAVLink_global_position_int_message(
                boot_ms,
                round(lat_deg * 1e7),
                round(lon_deg * 1e7),
                round(alt_m * 1e3),
                round(relative_alt_m * 1e3),
                *(_INT16_MAX if math.isnan(v) else max(-32767, min(32766, round(v * 100.0))) for v in v_ned),
                cdeg,
            )
        )

    def gps_raw_int(
        self,
        time_us: int,
        lat_deg: float,
        lon_deg: float,
        alt_m: float,
        *,
        fix_type: int = 3,
        satellites: int = 12,
        hdop: float = math.nan,
        h_acc_m: float = 0.0,
    ) -> bytes:
        """GPS_RAW_INT; h_acc_m 0 and a NaN hdop are sent as unknown."""
        eph = _UINT16_MAX if math.isnan(hdop) else round(hdop * 100.0)
        place = (round(lat_deg * 1e7), round(lon_deg * 1e7), round(alt_m * 1e3))
        return self.pack(
            ardupilotmega.MAVLink_gps_raw_int_message(
                time_us,
                fix_type,
                *place,
                eph,
                _UINT16_MAX,
                _UINT16_MAX,
                _UINT16_MAX,
                satellites,
                h_acc=round(h_acc_m * 1e3),
            )
        )

    def statustext(self, text: str, severity: int = 6, text_id: int = 0, chunk: int = 0) -> bytes:
        """STATUSTEXT of at most 50 bytes."""
        return self.pack(
            ardupilotmega.MAVLink_statustext_message(severity, text.encode()[:50], id=text_id, chunk_seq=chunk)
        )
