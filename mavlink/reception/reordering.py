"""How old a signed packet is that is refused because newer ones have come: overtaken on its way, or played again.

A signature's timestamp has to be newer than the last of its stream. A link that changes the order of packets breaks
that, and so does a vehicle that signs for all its radios with one counter, as ArduPilot does: whatever comes over the
slower radio is older than what the faster one has brought, by seconds. What is older than that somebody has kept.

Timestamps alone do not tell, since counters stand still while vehicles drive: what counts is when newer ones came, and
how long ago the vehicle's own clock showed what a packet says.
"""

from __future__ import annotations

from bisect import bisect_left
from collections import deque

from mavlink.protocol.packet import Packet
from mavlink.signing.streams import times_in

__all__ = ["SLOWEST_US", "Overtaken"]

SLOWEST_US = 12_000_000
"""No link is slower; as long as copies are remembered at least."""
_MOST = 64  # streams: components times link ids
_SAMPLES, _EVERY_US = 128, 1_000_000
_TICK_US = 10


class _Stream:
    """When the timestamps of one stream came."""

    __slots__ = ("booted_us", "newest", "samples")

    def __init__(self) -> None:
        self.newest = 0
        self.booted_us: int | None = None
        """When its sender started, Unix µs."""
        self.samples: deque[tuple[int, int]] = deque(maxlen=_SAMPLES)
        """Timestamp and Unix µs of arrival, both rising."""


class Overtaken:
    """Remembers how far the streams of one vehicle have got, for the last two minutes."""

    __slots__ = ("_streams",)

    def __init__(self) -> None:
        self._streams: dict[tuple[int, int], _Stream] = {}

    def good(self, packet: Packet) -> None:
        """Takes a signed packet that was verified and is newer than those before."""
        key = packet.component_id, packet.raw[-13]
        stream = self._streams.get(key)
        if stream is None:
            if len(self._streams) >= _MOST:
                del self._streams[next(iter(self._streams))]
            stream = self._streams[key] = _Stream()
        stream.newest = _timestamp(packet)
        boot_ticks = times_in(packet.raw)[1]
        if boot_ticks >= 0:
            stream.booted_us = packet.t_us - boot_ticks * _TICK_US
        if not stream.samples or packet.t_us - stream.samples[-1][1] >= _EVERY_US:
            stream.samples.append((stream.newest, packet.t_us))

    def age_us(self, packet: Packet) -> int | None:
        """How long ago at least a packet was made; None for a stream that is not known."""
        stream = self._streams.get((packet.component_id, packet.raw[-13]))
        if stream is None:
            return None
        boot_ticks = times_in(packet.raw)[1]
        own_us = packet.t_us - stream.booted_us - boot_ticks * _TICK_US if stream.booted_us and boot_ticks >= 0 else 0
        timestamp, (oldest, since_us) = _timestamp(packet), stream.samples[0]
        if timestamp < oldest:
            # from before anything that is remembered; a counter never runs faster than time but for leaps
            return max(packet.t_us - since_us, (stream.newest - timestamp) * _TICK_US, own_us)
        place = bisect_left(stream.samples, (timestamp,))
        return max(packet.t_us - stream.samples[place][1] if place < len(stream.samples) else 0, own_us)

    def late(self, packet: Packet) -> bool:
        """Whether a packet refused as replayed may have been overtaken by newer ones on its way."""
        age_us = self.age_us(packet)
        return age_us is not None and age_us < SLOWEST_US


def _timestamp(packet: Packet) -> int:
    return int.from_bytes(packet.raw[-12:-6], "little")
