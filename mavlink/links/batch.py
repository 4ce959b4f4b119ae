"""Frames received together over one link, before anything is decoded."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from fastcrc import crc16

from mavlink.protocol.dialect import DEFINITIONS
from mavlink.protocol.framing import SIGNATURE_LENGTH
from mavlink.protocol.packet import MAGIC_V1, MAGIC_V2, Auth, Packet

Claim = tuple[int, int]
"""Number of a source address on its link, and the system id that its frames carry: who they claim to be from."""
Sender = tuple[int, int]
"""Number of a source address, and the system id of its datagrams that are one frame each, or :data:`MIXED`.

A source address can be forged, so each class of datagrams from one address is trusted, and limited, for itself."""
MIXED = 256
"""Means datagrams that are not exactly one frame."""

_mcrf4xx = crc16.mcrf4xx
# message id as in a header → (longest payload, CRC extra)
_TABLE = {
    message_id.to_bytes(3, "little"): (length, bytes([extra])) for message_id, (length, extra) in DEFINITIONS.items()
}


@dataclass(slots=True)
class Batch:
    """Frames in order of arrival: three lists of one length."""

    times_us: list[int] = field(default_factory=list)
    frames: list[bytes] = field(default_factory=list)
    peers: list[int] = field(default_factory=list)
    """Number of each frame's sender on its link."""
    unchecked: set[int] = field(default_factory=set)
    """Indices of frames of unknown messages, whose checksum cannot be verified."""
    mixed: set[int] = field(default_factory=set)
    """Indices of frames that were not alone in their datagram."""
    _claimed: set[Claim] | None = field(default=None, repr=False, compare=False)

    def __len__(self) -> int:
        return len(self.frames)

    def packets(self, link: int, auths: Sequence[Auth] | None = None) -> list[Packet]:
        """The frames as packets of one link, with the results of their signature checks where there are any."""
        if auths is None:
            rows = zip(self.times_us, self.frames, self.peers, strict=True)
            return [Packet(t_us, raw, link, peer) for t_us, raw, peer in rows]
        judged = zip(self.times_us, self.frames, self.peers, auths, strict=True)
        return [Packet(t_us, raw, link, peer, auth) for t_us, raw, peer, auth in judged]

    def claims(self) -> list[Claim]:
        """Source and claimed system id of each frame, in order."""
        return list(zip(self.peers, self._systems(), strict=True))

    def claimed(self) -> set[Claim]:
        """The set of :meth:`claims`, computed once; only valid after all frames were added."""
        if self._claimed is None:
            self._claimed = set(zip(self.peers, self._systems(), strict=True))
        return self._claimed

    def _systems(self) -> list[int]:
        # as system_of has it, without a call for each
        return [raw[5] if raw[0] == MAGIC_V2 else raw[3] for raw in self.frames]

    def senders(self) -> list[Sender]:
        """Source of each frame with its claimed system id, or :data:`MIXED` where it was not alone in its datagram."""
        senders = self.claims()
        for k in self.mixed:
            senders[k] = self.peers[k], MIXED
        return senders


def is_one_frame(data: bytes) -> bool:
    """Tell whether a datagram is exactly one good MAVLink 2 frame of a known message; nearly all are.

    What is not may still hold good frames, which :func:`mavlink.protocol.framing.split` finds.
    """
    size = len(data)
    if size < 12 or data[0] != MAGIC_V2:
        return False
    payload, flags = data[1], data[2]
    definition = _TABLE.get(data[7:10])
    if definition is None or flags > 1 or payload > definition[0] or size != payload + 12 + SIGNATURE_LENGTH * flags:
        return False
    end = payload + 10
    return _mcrf4xx(data[1:end] + definition[1]) == data[end] | data[end + 1] << 8


def system_of(raw: bytes) -> int:
    """System id in a frame's header."""
    return raw[5] if raw[0] == MAGIC_V2 else raw[3]


def looks_like_one_frame(data: bytes) -> bool:
    """Tell whether a datagram has the size that its MAVLink header gives; its checksum may still be wrong."""
    if len(data) < 8:
        return False
    if data[0] == MAGIC_V1:
        return len(data) == data[1] + 8
    return data[0] == MAGIC_V2 and data[2] <= 1 and len(data) == data[1] + 12 + SIGNATURE_LENGTH * data[2]
