"""Packets of one vehicle that were rejected for their signature: counted, dated, and reported now and then.

A signature's timestamp has to be newer than the last of its stream. A link that reorders packets breaks that, and so
does a vehicle that signs for all its radios with one counter, as ArduPilot does: whatever comes over the slower radio
is older than what the faster one has brought, by seconds. Anything older than that was recorded and played again.

Timestamps alone do not distinguish the two, since counters may stop while vehicles drive: what counts is when newer
packets came, and how long ago the vehicle's own clock showed the time that a packet carries.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections import Counter, deque

from infra.reporting import ReportGrowth, Throttle
from mavlink.protocol.packet import Auth, Packet
from mavlink.signing.streams import ticks_of, times_in
from mavlink.state import Level

SLOWEST_LINK_US = 12_000_000
"""Delay of the slowest link; packets are remembered as long at least."""
_TICK_US, _TICK_S = 10, 1e-5
"""Resolution of a signature's timestamp."""
_MAX_STREAMS = 64
"""Components times link ids."""
_SAMPLES, _SAMPLE_EVERY_US = 128, 1_000_000
"""Timestamps kept of each stream: two minutes."""

REPORT_AGAIN_US = 30_000_000
"""Interval of reports on what a vehicle does wrong all the time."""
_NEVER_US = -(1 << 62)
_MAX_REPLAYERS = 16
"""Addresses remembered that have played a recording."""
_ALARM_AFTER = 3
"""Rejections are reported from the third on, and again once they have doubled."""
_REORDERED_AFTER, _REORDERED_EVERY_US = 20, 600_000_000
"""Reordered packets are reported from this many on and every ten minutes: two radios last a whole flight."""
_HELD_US = 3_000_000
"""Time within which held packets are one incident, which is reported once it has lasted as long."""
_AUTH_LASTS_US = 10_000_000
"""Time after a rejected packet for which a vehicle's signatures count as not good."""
_REASONS = {
    Auth.UNSIGNED: "no signature",
    Auth.BAD: "bad signature",
    Auth.REPLAYED: "replayed signature",
    Auth.FUTURE: "signature from the future",
}


class _StreamHistory:
    """Arrival of the timestamps of one signed stream."""

    __slots__ = ("booted_us", "newest", "samples")

    def __init__(self) -> None:
        self.newest = 0
        self.booted_us: int | None = None
        """Start of its sender, Unix µs."""
        self.samples: deque[tuple[int, int]] = deque(maxlen=_SAMPLES)
        """Timestamp and Unix µs of arrival, both rising."""


class _PacketAges:
    """Least age of a signed packet, by what its stream has brought in the last two minutes."""

    __slots__ = ("_streams",)

    def __init__(self) -> None:
        self._streams: dict[tuple[int, int], _StreamHistory] = {}

    def add(self, packet: Packet) -> None:
        """Remember a signed packet that was verified and is newer than those before."""
        key = packet.component_id, packet.raw[-13]
        stream = self._streams.get(key)
        if stream is None:
            if len(self._streams) >= _MAX_STREAMS:
                del self._streams[next(iter(self._streams))]
            stream = self._streams[key] = _StreamHistory()
        stream.newest = _timestamp(packet)
        boot_ticks = times_in(packet.raw)[1]
        if boot_ticks >= 0:
            stream.booted_us = packet.t_us - boot_ticks * _TICK_US
        if not stream.samples or packet.t_us - stream.samples[-1][1] >= _SAMPLE_EVERY_US:
            stream.samples.append((stream.newest, packet.t_us))

    def age_us(self, packet: Packet) -> int | None:
        """Least age of a packet; None for an unknown stream."""
        stream = self._streams.get((packet.component_id, packet.raw[-13]))
        if stream is None:
            return None
        boot_ticks = times_in(packet.raw)[1]
        own_us = packet.t_us - stream.booted_us - boot_ticks * _TICK_US if stream.booted_us and boot_ticks >= 0 else 0
        timestamp, (oldest, since_us) = _timestamp(packet), stream.samples[0]
        if timestamp < oldest:
            # older than anything remembered; a counter never runs faster than time but for jumps
            return max(packet.t_us - since_us, (stream.newest - timestamp) * _TICK_US, own_us)
        newer = bisect_left(stream.samples, (timestamp,))
        return max(packet.t_us - stream.samples[newer][1] if newer < len(stream.samples) else 0, own_us)


class PacketRejections:
    """Counts the packets of one vehicle that its signatures forbid to use."""

    def __init__(self) -> None:
        self.unsigned = 0
        """Number of packets without a verified signature, where a key is set."""
        self.bad_signature = 0
        """Number of packets whose signature was made with another key, replayed, or from the future."""
        self.replayed = 0
        """Packets among these of a recording that is played again."""
        self.held = 0
        """Number of packets with a right signature, where nothing proves that they are made now."""
        self._ages = _PacketAges()
        self._counts: Counter[Auth] = Counter()
        self._count_reports: dict[Auth, ReportGrowth] = {}
        self._replayers: dict[tuple[int, int], int] = {}  # channels that played a recording, and when last
        self._reordered = 0
        self._reordered_reports, self._held_reports = Throttle(_REORDERED_EVERY_US), Throttle(REPORT_AGAIN_US)
        self._verified_us = self._rejected_us = self._held_us = self._held_since_us = _NEVER_US
        self._lag_s = math.nan

    def note_verified(self, t_us: int) -> None:
        """Note that a verified packet came."""
        self._verified_us = t_us

    def note_signed(self, packet: Packet) -> None:
        """Note the timestamp of an accepted packet that carries a signature."""
        self._ages.add(packet)

    def is_recent(self, first_us: int, t_us: int) -> bool:
        """Tell whether a packet whose first copy came at ``first_us`` may still be on its way over another link."""
        return t_us - first_us < SLOWEST_LINK_US

    def add(self, packet: Packet, *, sender_last_us: int | None) -> tuple[Level, str]:
        """Count a rejected packet that is no duplicate.

        Args:
            packet: its ``auth`` is above ``GOOD``.
            sender_last_us: when an accepted packet came last over the same channel, None never.

        Returns:
            What an operator should know, an empty text for nothing.
        """
        if packet.auth is Auth.REPLAYED:
            if self._is_reordered(packet):
                return "warning", self._reordered_text(packet.t_us)
            self.replayed += 1
        self._rejected_us = packet.t_us
        if packet.auth is Auth.HELD:
            self.held += 1
            return "warning", self._held_text(packet)
        if packet.auth is Auth.UNSIGNED:
            self.unsigned += 1
        else:
            self.bad_signature += 1
        self._counts[packet.auth] += 1
        growth = ReportGrowth(first=_ALARM_AFTER, rest=REPORT_AGAIN_US, every=REPORT_AGAIN_US)
        reports = self._count_reports.setdefault(packet.auth, growth)
        if not reports.due(self._counts[packet.auth], packet.t_us):
            return "info", ""
        text = f"{self._counts[packet.auth]} packets refused, {_REASONS[packet.auth]}"
        return "alarm", text + (self._replay_text(packet, sender_last_us) if packet.auth is Auth.REPLAYED else "")

    def signatures_good(self, t_us: int) -> bool:
        """Tell whether packets were verified and none rejected in the seconds before a Unix time in µs."""
        return t_us - self._verified_us < _AUTH_LASTS_US <= t_us - self._rejected_us

    def held_s(self, t_us: int) -> float:
        """Delay of timestamps, s, while every packet is held; else NaN."""
        held = t_us - self._held_us < _HELD_US <= t_us - self._verified_us
        return self._lag_s if held else math.nan

    def _is_reordered(self, packet: Packet) -> bool:
        """Tell whether a packet that is not newer than others was overtaken, over a channel without recordings."""
        channel, age_us = (packet.link, packet.peer), self._ages.age_us(packet)
        recent = age_us is not None and age_us < SLOWEST_LINK_US
        if not recent:
            if channel not in self._replayers and len(self._replayers) >= _MAX_REPLAYERS:
                del self._replayers[next(iter(self._replayers))]
            self._replayers[channel] = packet.t_us
        return recent and packet.t_us - self._replayers.get(channel, _NEVER_US) >= SLOWEST_LINK_US

    def _held_text(self, packet: Packet) -> str:
        t_us = packet.t_us
        if t_us - self._held_us >= _HELD_US:
            self._held_since_us = t_us
        self._held_us = t_us
        self._lag_s = (ticks_of(t_us) - _timestamp(packet)) * _TICK_S
        if t_us - self._held_since_us < _HELD_US or not self._held_reports.due("", t_us):
            return ""
        return f"signatures {_duration_text(self._lag_s)} behind, nothing proves that its packets are made now: held"

    def _replay_text(self, packet: Packet, sender_last_us: int | None) -> str:
        """Text about a recording that is played."""
        age_us = self._ages.age_us(packet)
        recorded = "before this flight" if age_us is None else f"at least {_duration_text(age_us * 1e-6)} ago"
        own = sender_last_us is not None and packet.t_us - sender_last_us < _AUTH_LASTS_US
        return f": a recording made {recorded} is played" + (", from the address of the vehicle itself" if own else "")

    def _reordered_text(self, t_us: int) -> str:
        self._reordered += 1
        number = self._reordered
        if number < _REORDERED_AFTER or not self._reordered_reports.due("", t_us):
            return ""
        return f"{number} signed packets came after newer ones and are refused: out of order, or over a slower radio"


def _timestamp(packet: Packet) -> int:
    return int.from_bytes(packet.raw[-12:-6], "little")


def _duration_text(seconds: float) -> str:
    """Whole seconds or minutes."""
    return f"{seconds:.0f} s" if seconds < 100.0 else f"{seconds / 60.0:.0f} min"
