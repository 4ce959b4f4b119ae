"""Packets that come twice: a router or a second radio hands on what another link has brought already."""

from __future__ import annotations

from mavlink.packet import Packet

__all__ = ["UNTIMED", "Copies"]

_MEMORY_US = 12_000_000  # links that are ten seconds late exist
_MOST = 50_000
# HEARTBEAT, BATTERY_STATUS, MOUNT_STATUS, STATUSTEXT, VIDEO_STREAM_INFORMATION say no time: with a sequence number that
# has come round again, the same bytes may be a new message.
UNTIMED = frozenset({0, 109, 147, 158, 166, 253, 269})


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
        if seen is None or (packet.message_id in UNTIMED and seen[1:] == (packet.link, packet.peer)):
            return None
        return seen

    def add(self, packet: Packet) -> None:
        """Remembers a new packet."""
        if not 0 <= packet.t_us - self._since_us < _MEMORY_US or len(self._now) >= _MOST:
            self._before, self._now, self._since_us = self._now, {}, packet.t_us
        self._now[hash(packet.raw)] = (packet.t_us, packet.link, packet.peer)
