"""Encoders of a scripted fleet: switched on again, and signing."""

from __future__ import annotations

from typing import Any

from pymavlink.dialects.v20 import ardupilotmega

from mavlink.protocol.dialect import DEFINITIONS
from mavlink.protocol.encoder import MavlinkEncoder
from mavlink.protocol.framing import checksum
from mavlink.protocol.packet import Packet
from mavlink.signing.keys import Key
from mavlink.signing.streams import ticks_of

FIRST_BOOT_MS = 1500
"""Of a vehicle that was just switched on, at its first message."""
SECRET = bytes(range(32))


class RebootedEncoder:
    """Frames of a fleet whose boot clocks begin again."""

    def __init__(self) -> None:
        self._parser: Any = ardupilotmega.MAVLink(None)
        self._encoders: dict[int, MavlinkEncoder] = {}
        self._booted_ms: dict[int, int] = {}

    def with_boot_time_reset(self, raw: bytes) -> bytes:
        (message,) = self._parser.parse_buffer(raw)
        system_id = message.get_srcSystem()
        if hasattr(message, "time_boot_ms"):
            booted_ms = self._booted_ms.setdefault(system_id, message.time_boot_ms - FIRST_BOOT_MS)
            message.time_boot_ms -= booted_ms
        return self._encoders.setdefault(system_id, MavlinkEncoder(system_id)).pack(message)


class ScriptedSigner:
    """Signs frames, with timestamps that follow the clock.

    Args:
        secret: 32 bytes.
    """

    def __init__(self, secret: bytes = SECRET) -> None:
        self._key, self._ticks = Key(secret), 0

    def sign(self, raw: bytes, t_us: int) -> bytes:
        packet = Packet(t_us, raw)
        body = bytes([raw[0], raw[1], raw[2] | 1]) + raw[3 : 10 + raw[1]]
        crc = checksum(body, DEFINITIONS[packet.message_id][1]).to_bytes(2, "little")
        self._ticks = max(self._ticks + 1, ticks_of(t_us))
        covered = body + crc + b"\x01" + self._ticks.to_bytes(6, "little")
        return covered + self._key.signature(covered)
