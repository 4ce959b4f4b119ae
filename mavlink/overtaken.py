"""Signed packets that newer ones have overtaken: refused like those of a recording, and nobody's attack.

A signature's timestamp has to be newer than the last of its stream. A link that changes the order of packets breaks
that, and so does a vehicle that signs for all its radios with one counter, as ArduPilot does: whatever comes over the
slower radio is older than what the faster one has brought.
"""

from __future__ import annotations

from mavlink.packet import Packet

__all__ = ["Overtaken"]

_MOST = 64  # streams: components times link ids
_BEHIND = 12 * 100_000  # ticks of 10 µs; no longer than copies are remembered, which says as little


class Overtaken:
    """Remembers how far the streams of one vehicle have got."""

    __slots__ = ("_newest", "count")

    def __init__(self) -> None:
        self.count = 0
        """Packets that were overtaken."""
        self._newest: dict[tuple[int, int], int] = {}

    def good(self, packet: Packet) -> None:
        """Takes a signed packet that was verified and is newer than those before."""
        stream = packet.component_id, packet.raw[-13]
        if stream not in self._newest and len(self._newest) >= _MOST:
            del self._newest[next(iter(self._newest))]
        self._newest[stream] = int.from_bytes(packet.raw[-12:-6], "little")

    def late(self, packet: Packet) -> bool:
        """Whether a packet refused as replayed is a few seconds older than the newest of its stream; counts those."""
        newest = self._newest.get((packet.component_id, packet.raw[-13]))
        if newest is None or not 0 < newest - int.from_bytes(packet.raw[-12:-6], "little") < _BEHIND:
            return False
        self.count += 1
        return True
