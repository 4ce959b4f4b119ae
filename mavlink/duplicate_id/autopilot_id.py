"""The autopilot's hardware id, from AUTOPILOT_VERSION (148): it stays the same for as long as it is the same board."""

from __future__ import annotations

from typing import NamedTuple

from pymavlink.dialects.v20 import ardupilotmega

from mavlink.protocol.packet import Packet

_UNPACKER = ardupilotmega.mavlink_map[ardupilotmega.MAVLINK_MSG_ID_AUTOPILOT_VERSION].unpacker
_UID2_BYTES = 18
"""Length of the last field."""


class HardwareId(NamedTuple):
    """Hardware id in its short and its long form; 0 and empty where not reported (MAVLink 1 has no long one)."""

    uid: int
    uid2: bytes

    def differs(self, other: HardwareId) -> bool:
        """Tell whether these are two boards for certain: a form that both report is different."""
        if self.uid2 and other.uid2:
            return self.uid2 != other.uid2
        return bool(self.uid and other.uid) and self.uid != other.uid

    @property
    def text(self) -> str:
        """The long form, else the short one, in hexadecimal; empty when neither is reported."""
        return self.uid2.hex() or (f"{self.uid:x}" if self.uid else "")


def hardware_id_of(packet: Packet) -> HardwareId:
    """The hardware id in an AUTOPILOT_VERSION packet."""
    _, uid, *rest = _UNPACKER.unpack(packet.payload.ljust(_UNPACKER.size, b"\0"))
    return HardwareId(uid, bytes(rest[-_UID2_BYTES:]).rstrip(b"\0"))
