"""Frames of the few messages that a fleet needs, made quickly: a struct, a checksum, and a signature on request."""

from __future__ import annotations

import hashlib
from struct import Struct
from typing import Final

from fastcrc import crc16

from mavlink.protocol.dialect import DEFINITIONS

__all__ = ["ATTITUDE", "GPS", "HEARTBEAT", "POSITION", "TEXT", "SenderEncoder"]

HEARTBEAT, GPS, ATTITUDE, POSITION, TEXT = 0, 24, 30, 33, 253
"""Message ids."""
_BODY: Final = {
    HEARTBEAT: Struct("<IBBBBB"),
    GPS: Struct("<QiiiHHHHBB"),
    ATTITUDE: Struct("<Iffffff"),
    POSITION: Struct("<IiiiihhhH"),
    TEXT: Struct("<B50s"),
}
"""Payloads of the messages above, fields in MAVLink's wire order."""
_V1, _V2, _STAMP, _CRC = Struct("<BBBBBB"), Struct("<BBBBBBBHB"), Struct("<BIH"), Struct("<H")
"""Headers of MAVLink 1 and 2, the signature's link and time stamp, and the checksum."""
_SIGNING_EPOCH_US = 1_420_070_400_000_000
"""Unix time of 2015-01-01, from which MAVLink signatures count their time."""


class SenderEncoder:
    """One sender's frames, numbered and signed as its autopilot would.

    Args:
        system_id: 1..255.
        version: MAVLink 1 or 2; 1 cannot be signed.
        key: 32 bytes to sign with.
        link_id: of the signatures.
    """

    def __init__(self, system_id: int, *, version: int = 2, key: bytes | None = None, link_id: int = 0) -> None:
        self._system_id, self._version, self._link_id = system_id, version, link_id
        self._key = key if version == 2 else None
        self._seq = 0
        self._stamp = 0

    def frame(self, t_us: int, message_id: int, *values: float | bytes) -> bytes:
        """The next frame, made at Unix time ``t_us``; values in the order on the wire, without extensions."""
        body = _BODY[message_id].pack(*values)
        seq, self._seq = self._seq, (self._seq + 1) & 0xFF
        if self._version == 1:
            raw = _V1.pack(0xFE, len(body), seq, self._system_id, 1, message_id) + body
        else:
            # trailing zeros are cut off by every autopilot, the first byte never
            body = body[:1] + body[1:].rstrip(b"\0")
            flags = 1 if self._key else 0
            raw = _V2.pack(0xFD, len(body), flags, 0, seq, self._system_id, 1, message_id, 0) + body
        raw += _CRC.pack(crc16.mcrf4xx(raw[1:] + bytes([DEFINITIONS[message_id][1]])))
        return raw + self._signature(raw, t_us) if self._key else raw

    def _signature(self, raw: bytes, t_us: int) -> bytes:
        assert self._key is not None
        # ticks of 10 µs since 2015, one more than the last at least
        self._stamp = max(self._stamp + 1, (t_us - _SIGNING_EPOCH_US) // 10)
        stamp = _STAMP.pack(self._link_id, self._stamp & 0xFFFFFFFF, self._stamp >> 32)
        return stamp + hashlib.sha256(self._key + raw + stamp).digest()[:6]
