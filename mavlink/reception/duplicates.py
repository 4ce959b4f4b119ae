"""Packets that come twice: a router or a second radio hands on what another link has brought already."""

from __future__ import annotations

from mavlink.protocol.packet import Packet

__all__ = ["TIMED", "Copies"]

_MEMORY_US = 12_000_000  # links that are ten seconds late exist
_MOST = 4096  # of each half: a flood must not cost memory
TIMED = frozenset({2, 30, 31, 32, 33, 111, 259, 260, 265, 271, 285})
"""Messages that say when they were made. Of others the same bytes may be new, once the sequence number has come round
again."""


class Copies:
    """Remembers one vehicle's packets, byte for byte, for twelve to twenty-four seconds."""

    __slots__ = ("_before", "_now", "_since_us")

    def __init__(self) -> None:
        self._now: dict[int, tuple[int, int, int]] = {}
        self._before: dict[int, tuple[int, int, int]] = {}
        self._since_us = 0

    def first(self, packet: Packet) -> tuple[int, int, int] | None:
        """When and where the same packet came first, as (t_us, link, peer); None for a new one."""
        key = hash(packet.raw)
        seen = self._now.get(key) or self._before.get(key)
        if seen is None:
            return None
        sure = packet.message_id in TIMED or packet.signed or seen[1:] != (packet.link, packet.peer)
        return seen if sure else None

    def add(self, packet: Packet) -> None:
        """Remembers a new packet."""
        if not 0 <= packet.t_us - self._since_us < _MEMORY_US or len(self._now) >= _MOST:
            self._before, self._now, self._since_us = self._now, {}, packet.t_us
        self._now[hash(packet.raw)] = (packet.t_us, packet.link, packet.peer)
