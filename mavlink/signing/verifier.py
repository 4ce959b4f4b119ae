"""Verifies frames: MAVLink 2 message signing, with a key for each vehicle.

A frame is verified with the key of its system id and no other, and changes nothing until it is. Then its timestamp has
to be newer than the last of its stream, and no further ahead than
:data:`mavlink.signing.streams.AHEAD`; and something has to prove that the frame was made in the last minute
(:mod:`mavlink.signing.streams`). Rules: https://mavlink.io/en/guide/message_signing.html, which set no limit to
the future: one frame signed by a wrong clock would then lock its vehicle out for as long.

With any key in the ring all systems have to sign. Only listed messages may come unsigned: those of modems, which have
no key. Such a frame is ``OPEN``; messages that describe a vehicle cannot be listed.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection
from dataclasses import replace
from hmac import compare_digest
from typing import Literal

from mavlink.errors import SigningError
from mavlink.protocol.dialect import DEFINITIONS, RADIO_STATUS, SETUP_SIGNING, message_name
from mavlink.protocol.framing import SIGNATURE_LENGTH, checksum
from mavlink.protocol.packet import MAGIC_V1, MAGIC_V2, Auth, Packet
from mavlink.signing.keys import KeyRing
from mavlink.signing.streams import AHEAD, Streams, ticks_of

SIGNED = 0x01
"""The incompatibility flag of signed frames."""
STATE_MESSAGES = frozenset(
    {0, 1, 2, 24, 30, 31, 33, 111, 124, 132, 136, 147, 158, 193, 230, 253, 259, 260, 265, 269, 271, 285}
)
"""Messages that make up a vehicle's state: all that :mod:`mavlink.protocol.decode` decodes, except the modems' own."""
Keyless = Literal["refused", "open"]
_OVERHEAD = 12 + SIGNATURE_LENGTH
_SHORTEST = 8
_KEY_AT = 10  # in SETUP_SIGNING's payload, after its timestamp and target


class Verifier:
    """Verifies the signature of each packet. One for all links; not for several threads at once.

    Args:
        ring: the keys; an empty ring makes everything ``OPEN``.
        unsigned: ids of messages that may come unsigned from any system, none of :data:`STATE_MESSAGES`.
        keyless: how frames of systems without a key are treated while others have one: ``refused`` or ``open``.
        steady_ns: a clock that is never set, for when the computer's is set back.

    Raises:
        SigningError: a message may not come unsigned.
    """

    def __init__(
        self,
        ring: KeyRing,
        *,
        unsigned: Collection[int] = (RADIO_STATUS,),
        keyless: Keyless = "refused",
        streams: Streams | None = None,
        steady_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        listed = min(STATE_MESSAGES.intersection(unsigned), default=None)
        if listed is not None:
            raise SigningError(
                f"{message_name(listed)} ({listed}) describes a vehicle and cannot come unsigned; "
                "take it out of [signing] unsigned"
            )
        self.ring = ring
        self.streams = Streams() if streams is None else streams
        self._keys = tuple(ring.key_of(system_id) for system_id in range(256))
        self._unsigned = frozenset(unsigned)
        self._keyless = Auth.UNSIGNED if ring and keyless == "refused" else Auth.OPEN
        self._steady_ns = steady_ns
        # now = steady clock + offset: from the latest time proven, and never back
        self._offset = self.streams.proven - steady_ns() // 10_000

    def check(self, packet: Packet) -> Auth:
        """Verify a frame that :mod:`mavlink.protocol.framing` accepted.

        For unsigned frames the result depends on the frame alone, for signed ones also on what was accepted before.
        """
        raw = packet.raw
        if len(raw) < _SHORTEST:
            return Auth.BAD
        if raw[0] == MAGIC_V2:
            if raw[2] & SIGNED:
                return self._check_signed(packet.t_us, raw)
            system_id, message_id = raw[5], int.from_bytes(raw[7:10], "little")
        elif raw[0] == MAGIC_V1:
            system_id, message_id = raw[3], raw[5]
        else:
            return Auth.BAD
        if self._keys[system_id] is None and self._keyless is Auth.OPEN:
            return Auth.OPEN
        return Auth.OPEN if message_id in self._unsigned else Auth.UNSIGNED

    def _check_signed(self, t_us: int, raw: bytes) -> Auth:
        system_id = raw[5]
        key = self._keys[system_id]
        if key is None:
            return self._keyless
        if len(raw) != raw[1] + _OVERHEAD:
            return Auth.BAD
        if not compare_digest(key.signature(raw[:-6]), raw[-6:]):
            return Auth.BAD
        timestamp = int.from_bytes(raw[-12:-6], "little")
        now = self._now(t_us)
        if timestamp > now + AHEAD:
            return Auth.FUTURE
        return self.streams.admit(system_id, raw[6], raw[-13], timestamp, now, raw)

    def accept_held(self, system_id: int, t_us: int) -> int:
        """Accept a system whose frames are held, on an operator's order; return how many of its streams were held."""
        return self.streams.accept_held(system_id, self._now(t_us))

    def _now(self, t_us: int) -> int:
        """Ticks when a packet came: max(computer's clock, latest time known before + steady clock since)."""
        wall, steady = ticks_of(t_us), self._steady_ns() // 10_000 + self._offset
        if wall <= steady:
            return steady
        self._offset += wall - steady
        return wall


def without_secret(packet: Packet) -> Packet | None:
    """SETUP_SIGNING as it may be recorded, and never forwarded; None for any other message, to be recorded as it is.

    The key's bytes become 0xFF, the signature is taken off, the checksum is right again
    (https://mavlink.io/en/guide/message_signing.html#logging).
    """
    raw = packet.raw
    if raw[0] != MAGIC_V2 or packet.message_id != SETUP_SIGNING:
        return None
    length, extra = DEFINITIONS[SETUP_SIGNING]
    payload = packet.payload[:_KEY_AT].ljust(_KEY_AT, b"\0").ljust(length, b"\xff")
    frame = bytes([MAGIC_V2, length, raw[2] & ~SIGNED]) + raw[3:10] + payload
    return replace(packet, raw=frame + checksum(frame, extra).to_bytes(2, "little"))
