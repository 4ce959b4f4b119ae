"""Signs the frames that this program makes itself, and no others."""

from __future__ import annotations

from mavlink.errors import SigningError
from mavlink.protocol.dialect import DEFINITIONS
from mavlink.protocol.framing import checksum
from mavlink.protocol.packet import MAGIC_V2
from mavlink.signing.keys import Key
from mavlink.signing.streams import ticks_of
from mavlink.signing.verifier import SIGNED


class Signer:
    """Signatures for one receiver. An autopilot knows one key, its own, and accepts only what is signed with that.

    The timestamp follows the clock, or a sender that was silent for a minute would be rejected, and grows by at least
    one with each frame.

    Args:
        newest: the last timestamp used before, in ticks; 0: only the clock counts.
    """

    def __init__(self, key: Key, *, newest: int = 0) -> None:
        self._key = key
        self.newest = newest

    def sign(self, frame: bytes, t_us: int, link_id: int = 0) -> bytes:
        """A frame with its signature.

        Args:
            frame: unsigned, MAVLink 2, of a known message, made here.
            t_us: Unix µs now.
            link_id: 0..255, one for each link that is sent on: frames overtake each other between links.

        Raises:
            SigningError: MAVLink 1 cannot be signed; a frame that carries a signature is another program's.
        """
        if frame[0] != MAGIC_V2:
            raise SigningError("a MAVLink 1 frame cannot be signed; send MAVLink 2")
        if frame[2] & SIGNED:
            raise SigningError("the frame is signed already; frames of others are never signed again")
        message_id = frame[7] | frame[8] << 8 | frame[9] << 16
        if message_id not in DEFINITIONS:
            raise SigningError(f"message {message_id} is unknown, its checksum cannot be made")
        self.newest = max(ticks_of(t_us), self.newest + 1)
        # the checksum covers the flag
        flagged = frame[:2] + bytes([frame[2] | SIGNED]) + frame[3 : 10 + frame[1]]
        crc = checksum(flagged, DEFINITIONS[message_id][1]).to_bytes(2, "little")
        covered = flagged + crc + bytes([link_id]) + self.newest.to_bytes(6, "little")
        return covered + self._key.signature(covered)
