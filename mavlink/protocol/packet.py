"""One MAVLink frame as it arrived, with the time it arrived at."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum

MAGIC_V1 = 0xFE
MAGIC_V2 = 0xFD
BOOT_MS_AT = {2: 8, 30: 0, 31: 0, 32: 0, 33: 0}
"""Offset in the payload of SYSTEM_TIME, ATTITUDE, ATTITUDE_QUATERNION, LOCAL_POSITION_NED and GLOBAL_POSITION_INT."""


class Auth(IntEnum):
    """Result of verifying a frame's signature; above ``GOOD`` the frame is recorded and counted, and never used."""

    OPEN = 0
    """No key is set for its sender, or the message may come unsigned: nothing proves its sender."""
    GOOD = 1
    UNSIGNED = 2
    """Keys are set, and the frame carries no signature (MAVLink 1, or one taken off), or its sender has no key."""
    BAD = 3
    """The signature was not made with the sender's key."""
    REPLAYED = 4
    """The signature is right and not newer than the last of its stream."""
    FUTURE = 5
    """The signature is right and its time too far ahead."""
    HELD = 6
    """The signature is right, and nothing proves that the frame was made now, not recorded and replayed."""


@dataclass(frozen=True, slots=True)
class Packet:
    """A raw frame, MAVLink 1 or 2, exactly as received.

    The properties read header bytes only: they are right for frames that :mod:`mavlink.protocol.framing` accepted.
    """

    t_us: int
    """Unix µs of arrival."""
    raw: bytes
    """The frame from its magic byte to the last byte of its checksum or signature."""
    link: int = 0
    """Index of the link it came over."""
    peer: int = 0
    """Number of the sender's address on that link, from 1; 0 where there is none, as in a log."""
    auth: Auth = Auth.OPEN
    """Result of verifying its signature."""
    record: int = field(default=-1, compare=False)
    """Running number of its record in the flight's log, -1 where it is not in one or that is not known."""

    @property
    def seq(self) -> int:
        """Sequence number 0..255, one counter per sender and channel."""
        return self.raw[4] if self.raw[0] == MAGIC_V2 else self.raw[2]

    @property
    def system_id(self) -> int:
        """System id of the sender, 0..255."""
        return self.raw[5] if self.raw[0] == MAGIC_V2 else self.raw[3]

    @property
    def component_id(self) -> int:
        """Component id of the sender, 0..255."""
        return self.raw[6] if self.raw[0] == MAGIC_V2 else self.raw[4]

    @property
    def message_id(self) -> int:
        """Message id: 24 bits in MAVLink 2, 8 in MAVLink 1."""
        raw = self.raw
        return raw[7] | raw[8] << 8 | raw[9] << 16 if raw[0] == MAGIC_V2 else raw[5]

    @property
    def signed(self) -> bool:
        """True if a signature follows the checksum; ``auth`` is the result of verifying it."""
        return self.raw[0] == MAGIC_V2 and bool(self.raw[2] & 1)

    @property
    def boot_ms(self) -> int:
        """Milliseconds since its vehicle was switched on, where the message carries them in a known place; else 0."""
        place = BOOT_MS_AT.get(self.message_id)
        if place is None:
            return 0
        start = 10 if self.raw[0] == MAGIC_V2 else 6
        return int.from_bytes(self.raw[start + place : start + min(place + 4, self.raw[1])], "little")

    @property
    def payload(self) -> bytes:
        """Payload as sent: in MAVLink 2 trailing zero bytes are left out by the sender."""
        start = 10 if self.raw[0] == MAGIC_V2 else 6
        return self.raw[start : start + self.raw[1]]
