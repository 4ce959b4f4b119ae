"""Reception of one vehicle: over which channels, how often, with what loss, and which are duplicates.

A channel is one network address on one link. Several channels may bring the same packets (two radios, a router), so a
packet counts as new once, and each channel is known by how far it is behind the others.
"""

from __future__ import annotations

import math
from enum import Enum
from typing import NamedTuple

from mavlink.protocol.packet import Auth, Packet
from mavlink.reception.packet_loss import SEQUENCE_LATE, PacketLoss
from mavlink.reception.rejected_packets import PacketRejections
from mavlink.state import ChannelStatus, Level

_MAX_CHANNELS = 16
"""Per vehicle; forged addresses must not cost memory."""
_LATE_US = 2_000_000
"""A channel whose duplicates come this long after the first copy is late."""
_LATE_REMEMBERED_US = 60_000_000
"""Time for which that holds: duplicates of time-stamped messages may be rare."""
_BEHIND_US = 500_000
"""A channel this far behind another describes the vehicle's past."""
_CURRENT_CHANNEL_US = 3_000_000
"""A channel that was up to date this recently is preferred to one that is behind: three heartbeats."""
_FIRST_COPIES = 10
"""A channel with this many first copies in a row has no duplicates: what looks like one is a heartbeat whose sequence
number has come round."""

_DUPLICATE_MEMORY_US = 12_000_000
"""Least time for which packets are remembered: links that are ten seconds late exist."""
_MAX_REMEMBERED = 4096
"""Packets in each half of that memory: a flood must not cost memory."""
_TIME_STAMPED = frozenset({2, 30, 31, 32, 33, 111, 259, 260, 265, 271, 285})
"""Ids of messages that carry the time they were made at. Of others the same bytes may be new, once the sequence number
has come round."""

_UNUSED_US = 10_000_000
"""A channel that is this much older than the newest packet counts no more in the loss: the vehicle has another now."""
_RATE_WINDOW_US = 2_000_000
"""Rates are measured over this: short enough to follow a change, two heartbeats long."""

_RUN_AHEAD, _RUN_BEHIND = 16, 8
"""Steps forward (losses) and back (reordering) that still continue a run of sequence numbers."""
_RUN_US = 3_000_000
"""A run ends after this much silence."""
_MAX_RUNS = 4
"""Runs followed on one channel: the vehicle's and those of impostors."""


class SenderKey(NamedTuple):
    """The source of a packet: what distinguishes senders of one system id."""

    link: int
    peer: int
    run: int
    """Number of the run of sequence numbers on that channel: two senders behind one address count separately."""
    component: int = 0


class ChannelLag(Enum):
    """Delay of a channel's messages behind the vehicle's own clock."""

    UNKNOWN = "none of its messages carries a time"
    CURRENT = "up to date"
    BEHIND = "half a second behind or more"


class Arrival(NamedTuple):
    """Arrival of one new packet."""

    sender: SenderKey
    late: bool
    """True if its channel is seconds behind another that brings the same packets."""
    lag: ChannelLag
    """Lag of its channel, by the message before."""


class _SequenceRuns:
    """Index of the counter on one channel that a packet belongs to: two senders there count independently."""

    __slots__ = ("_next", "_runs")

    def __init__(self) -> None:
        self._runs: list[list[int]] = []  # number, last sequence number, Unix µs of the last packet
        self._next = 0

    def add(self, seq: int, t_us: int) -> int:
        """Number of the run that this packet continues, a new one when it continues none."""
        best, best_step = None, _RUN_AHEAD + _RUN_BEHIND
        for run in self._runs:
            step = (seq - run[1] + _RUN_BEHIND) & 0xFF  # 0 .. _RUN_BEHIND + _RUN_AHEAD: continues the run
            step = abs(step - _RUN_BEHIND - 1) if step <= _RUN_BEHIND + _RUN_AHEAD else 0x100
            if step < best_step and abs(t_us - run[2]) < _RUN_US:
                best, best_step = run, step
                if step == 0:
                    break
        if best is None:
            return self._begin(seq, t_us)
        if (seq - best[1]) & 0xFF < SEQUENCE_LATE:
            best[1] = seq
        best[2] = t_us
        return best[0]

    def _begin(self, seq: int, t_us: int) -> int:
        if len(self._runs) >= _MAX_RUNS:
            self._runs.remove(min(self._runs, key=lambda run: run[2]))
        self._next += 1
        self._runs.append([self._next, seq, t_us])
        return self._next


class _RateMeter:
    """Counts arrivals in windows that begin and end with one: a steady sender's rate comes out exactly."""

    __slots__ = ("_count", "_hz", "_since_us", "last_us")

    def __init__(self) -> None:
        self.last_us = 0
        """Unix µs of the newest arrival, 0 never."""
        self._since_us = 0
        self._count = 0
        self._hz = 0.0

    def add(self, t_us: int) -> None:
        """Count one arrival."""
        self.last_us = t_us
        if not self._since_us:
            self._since_us = t_us
            return
        self._count += 1
        elapsed_us = t_us - self._since_us
        if elapsed_us >= _RATE_WINDOW_US or elapsed_us < 0:
            self._hz = self._count / elapsed_us * 1e6 if elapsed_us > 0 else 0.0
            self._since_us, self._count = t_us, 0

    def hz(self, t_us: int) -> float:
        """Arrivals per second at a Unix time in µs; falls towards 0 while nothing comes."""
        elapsed_us = t_us - self._since_us
        if elapsed_us <= 0 or not self._since_us:
            return self._hz
        overdue = elapsed_us > _RATE_WINDOW_US + (2e6 / self._hz if self._hz else 0.0)
        return self._count / elapsed_us * 1e6 if overdue or not self._hz else self._hz


class _FirstCopies:
    """Remembers one vehicle's packets, byte for byte, for twelve to twenty-four seconds."""

    __slots__ = ("_newer", "_older", "_since_us")

    def __init__(self) -> None:
        self._newer: dict[int, tuple[int, int, int]] = {}
        self._older: dict[int, tuple[int, int, int]] = {}
        self._since_us = 0

    def find(self, packet: Packet, dated: bool) -> tuple[int, int, int] | None:
        """First arrival of the same packet, as (t_us, link, peer); None for a new one.

        Args:
            dated: it carries a time, so that its bytes cannot repeat.
        """
        key = hash(packet.raw)
        first = self._newer.get(key) or self._older.get(key)
        if first is None:
            return None
        return first if dated or first[1:] != (packet.link, packet.peer) else None

    def add(self, packet: Packet) -> None:
        """Remember a new packet."""
        if not 0 <= packet.t_us - self._since_us < _DUPLICATE_MEMORY_US or len(self._newer) >= _MAX_REMEMBERED:
            self._older, self._newer, self._since_us = self._newer, {}, packet.t_us
        self._newer[hash(packet.raw)] = (packet.t_us, packet.link, packet.peer)


class _Channel:
    """One address on one link."""

    __slots__ = ("first_copies", "lag", "late_at_us", "late_us", "loss", "packets", "rate", "runs")

    def __init__(self) -> None:
        self.packets = 0
        self.rate = _RateMeter()
        self.loss = PacketLoss()
        self.runs: dict[int, _SequenceRuns] = {}
        self.late_us = 0
        """Delay of the last duplicate behind the first copy, and when it came."""
        self.late_at_us = 0
        self.lag = ChannelLag.UNKNOWN
        self.first_copies = 0
        """Packets in a row that no other channel had brought before."""

    def add(self, packet: Packet, message_id: int) -> int:
        """Count a packet and return the run of its sequence number."""
        t_us, component_id, seq = packet.t_us, packet.component_id, packet.seq
        self.packets += 1
        self.rate.add(t_us)
        self.loss.add(packet, message_id)
        runs = self.runs.get(component_id)
        if runs is None:
            runs = self.runs[component_id] = _SequenceRuns()
        return runs.add(seq, t_us)


class Reception:
    """Counts and sorts one vehicle's packets before anything in them is used."""

    def __init__(self) -> None:
        self.duplicates = 0
        """Packets that had come before."""
        self.rejections = PacketRejections()
        self.signed = 0
        """Packets with a signature that was verified."""
        self.unsigned = 0
        """Number of accepted packets without a signature."""
        self._channels: dict[tuple[int, int], _Channel] = {}
        self._first_copies = _FirstCopies()
        self._current = -1, 0, 0  # link, peer and time of the last packet over a channel that was up to date

    def add_packet(self, packet: Packet, message_id: int) -> Arrival | None:
        """Count a packet whose signature allows to use it.

        Returns:
            How it came; None for a duplicate of one that came before.
        """
        signed = packet.signed
        dated = signed or message_id in _TIME_STAMPED
        first = self._first_copies.find(packet, dated)
        channel = self._channel_of(packet.link, packet.peer)
        run = channel.add(packet, message_id)
        if first is None:
            channel.first_copies += dated
        elif dated or channel.first_copies < _FIRST_COPIES:
            self.duplicates += 1
            if first[1:] != (packet.link, packet.peer) and dated:
                channel.first_copies = 0
                if message_id in _TIME_STAMPED:
                    channel.late_us, channel.late_at_us = packet.t_us - first[0], packet.t_us
            return None
        self._first_copies.add(packet)
        if packet.auth is Auth.GOOD:
            self.signed += 1
            self.rejections.note_verified(packet.t_us)
        else:
            self.unsigned += 1
        if signed:
            self.rejections.note_signed(packet)  # in a replay too, where only rejections are recorded
        late = channel.late_us > _LATE_US and abs(packet.t_us - channel.late_at_us) < _LATE_REMEMBERED_US
        return Arrival(SenderKey(packet.link, packet.peer, run, packet.component_id), late, channel.lag)

    def reject_packet(self, packet: Packet) -> tuple[Level, str]:
        """Count a packet whose signature forbids to use it.

        Returns:
            What an operator should know, an empty text for nothing.
        """
        if packet.auth is Auth.REPLAYED:
            first = self._first_copies.find(packet, dated=True)
            if first is not None and self.rejections.is_recent(first[0], packet.t_us):
                self.duplicates += 1  # the same packet over a second link
                return "info", ""
        channel = self._channels.get((packet.link, packet.peer))
        return self.rejections.add(packet, sender_last_us=channel.rate.last_us if channel is not None else None)

    def set_delay(self, sender: SenderKey, delay_us: int) -> None:
        """Note how long after it was made, by the vehicle's clock, the last packet of a channel came."""
        lag = ChannelLag.BEHIND if delay_us > _BEHIND_US else ChannelLag.CURRENT
        self._channel_of(sender.link, sender.peer).lag = lag

    def is_outdated(self, arrival: Arrival, t_us: int) -> bool:
        """Tell whether a packet may describe the vehicle's past while another channel is up to date.

        Args:
            arrival: of that packet, at most one for each time.
            t_us: when it came.
        """
        if arrival.lag is ChannelLag.CURRENT:
            self._current = arrival.sender.link, arrival.sender.peer, t_us
            return False
        link, peer, last_us = self._current
        return arrival.sender[:2] != (link, peer) and abs(t_us - last_us) < _CURRENT_CHANNEL_US

    @property
    def loss(self) -> float:
        """Share of packets lost lately, over all channels that are in use; NaN unknown."""
        newest_us = max((channel.rate.last_us for channel in self._channels.values()), default=0)
        used = [channel.loss for channel in self._channels.values() if newest_us - channel.rate.last_us < _UNUSED_US]
        known = [(loss.sequence.expected, share) for loss in used if not math.isnan(share := loss.share)]
        expected = sum(count for count, _ in known)
        return sum(count * share for count, share in known) / expected if expected else math.nan

    @property
    def newest_link(self) -> int:
        """Index of the link of the newest packet, −1 before any."""
        if not self._channels:
            return -1
        return max(self._channels, key=lambda key: self._channels[key].rate.last_us)[0]

    def channels(self, t_us: int) -> tuple[ChannelStatus, ...]:
        """Every channel at a Unix time in µs, in order of first use."""
        return tuple(
            ChannelStatus(
                link=link,
                peer=peer,
                packets=channel.packets,
                rate_hz=channel.rate.hz(t_us),
                loss=channel.loss.share,
                age_s=max(0.0, (t_us - channel.rate.last_us) * 1e-6),
                late_s=max(0, channel.late_us) * 1e-6,
            )
            for (link, peer), channel in self._channels.items()
        )

    def _channel_of(self, link: int, peer: int) -> _Channel:
        channel = self._channels.get((link, peer))
        if channel is None:
            if len(self._channels) >= _MAX_CHANNELS:
                del self._channels[min(self._channels, key=lambda key: self._channels[key].rate.last_us)]
            channel = self._channels[link, peer] = _Channel()
        return channel
