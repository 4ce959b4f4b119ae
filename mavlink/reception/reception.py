"""How one vehicle is heard: over which channels, how often, with which signatures, and which packets are copies."""

from __future__ import annotations

import math
from collections import Counter
from typing import NamedTuple

from infra.reporting import ReportGrowth, Throttle
from mavlink.protocol.packet import Auth, Packet
from mavlink.reception.duplicates import TIMED, Copies
from mavlink.reception.rate_meter import Arrivals
from mavlink.reception.rejections import REPORT_AGAIN_US
from mavlink.reception.reordering import SLOWEST_US, Overtaken
from mavlink.reception.sequence import SequenceLoss, SequenceRuns
from mavlink.signing.streams import ticks_of
from mavlink.state import ChannelStatus, Level, MessageRate

__all__ = ["Reception", "Speaker"]

_NEVER_US = -(1 << 62)
_CHANNELS = 16
_MESSAGES = 128
_LATE_US = 2_000_000  # copies over a channel that come this long after the first make it a late one
_LATE_KNOWN_US = 60_000_000
_PROMPT_US = 3_000_000  # for so long a radio that was prompt tells better than one that is behind
_BEHIND_US = 500_000  # a link this far behind another tells how the vehicle was
_FIRST_HAND = 10  # a channel with so many new messages on end has no copies: numbers have come round in its heartbeats
_ALARM_AFTER = 3
_ALARM_EVERY_US = 30_000_000
_OVERTAKEN, _OVERTAKEN_US = 20, 600_000_000  # so many are told, and again so much later: it lasts a whole flight
_REFUSED_AS = {
    Auth.UNSIGNED: "no signature",
    Auth.BAD: "bad signature",
    Auth.REPLAYED: "replayed signature",
    Auth.FUTURE: "signature from the future",
}
_HELD_US = 3_000_000  # held packets so far apart are still one trouble; after as long it is told
_AUTH_LASTS_US = 10_000_000  # a packet refused so lately says how a vehicle signs now
_TICKS_S = 1e-5


def _span(seconds: float) -> str:
    """A time in words, whole seconds or minutes."""
    return f"{seconds:.0f} s" if seconds < 100.0 else f"{seconds / 60.0:.0f} min"


class Speaker(NamedTuple):
    """Who sent a packet, as far as the way it came tells."""

    link: int
    peer: int
    run: int
    """Of its sequence numbers on that channel."""
    component: int = 0


class _Channel:
    """One address on one link."""

    __slots__ = ("behind_us", "first_hand", "late_at_us", "late_us", "loss", "messages", "packets", "rate", "runs")

    def __init__(self) -> None:
        self.packets = 0
        self.rate = Arrivals()
        self.messages: dict[int, Arrivals] = {}
        self.loss = SequenceLoss()
        self.runs: dict[int, SequenceRuns] = {}
        self.late_us = 0
        self.late_at_us = 0
        self.behind_us = -1
        self.first_hand = 0

    def take(self, packet: Packet, message_id: int) -> int:
        """Counts a packet and returns the run of its sequence number."""
        t_us, component_id, seq = packet.t_us, packet.component_id, packet.seq
        self.packets += 1
        self.rate.take(t_us)
        message = self.messages.get(message_id)
        if message is None and len(self.messages) < _MESSAGES:
            message = self.messages[message_id] = Arrivals()
        if message is not None:
            message.take(t_us)
        self.loss.take(0, component_id, seq)
        runs = self.runs.get(component_id)
        if runs is None:
            runs = self.runs[component_id] = SequenceRuns()
        return runs.take(seq, t_us)


class Reception:
    """Counts and sorts one vehicle's packets before anything in them is believed."""

    def __init__(self) -> None:
        self.copies = 0
        """Packets that had come before."""
        self.signed = 0
        """With a signature that was verified."""
        self.unsigned = 0
        """Without: no key is set, or one is and the packet was refused."""
        self.bad_signature = 0
        """Refused: made with another key, replayed, or from the future."""
        self.replayed = 0
        """Of these, what was kept for a while and is played again."""
        self.held = 0
        """Refused because nothing proves that they are made now."""
        self.speaker = Speaker(0, 0, 0)
        """Of the packet taken last."""
        self._prompt = -1, 0, 0  # how and when the last one came that was not delayed
        self._channels: dict[tuple[int, int], _Channel] = {}
        self._channel = _Channel()
        self._copies = Copies()
        self._overtaken, self._overtaken_reports = Overtaken(), Throttle(_OVERTAKEN_US)
        self._overtaken_count = 0
        self._players: dict[tuple[int, int], int] = {}  # who played a recording, and when last
        self._refused: Counter[Auth] = Counter()
        self._refused_reports: dict[Auth, ReportGrowth] = {}
        self._signed_us = self._refused_us = self._held_us = self._held_since_us = _NEVER_US
        self._lag_s = math.nan
        self._held_reports = Throttle(REPORT_AGAIN_US)

    def take(self, packet: Packet, message_id: int) -> bool:
        """Counts a packet that may be believed; False for a copy of one that came before."""
        first = self._copies.first(packet)
        channel = self._channel = self._channel_of(packet.link, packet.peer)
        run = channel.take(packet, message_id)
        dated = message_id in TIMED or packet.signed
        if first is None:
            channel.first_hand += dated
        elif dated or channel.first_hand < _FIRST_HAND:
            self.copies += 1
            if first[1:] != (packet.link, packet.peer) and dated:
                channel.first_hand = 0
                if message_id in TIMED:
                    channel.late_us, channel.late_at_us = packet.t_us - first[0], packet.t_us
            return False
        self._copies.add(packet)
        self.speaker = Speaker(packet.link, packet.peer, run, packet.component_id)
        if packet.auth is Auth.GOOD:
            self.signed += 1
            self._signed_us = packet.t_us
        else:
            self.unsigned += 1
        if packet.signed:
            self._overtaken.good(packet)  # in a replay too, which tells only who was refused
        return True

    def refuse(self, packet: Packet) -> tuple[Level, str]:
        """Counts a packet whose signature forbids to believe it; says why when an operator should know."""
        if packet.auth is Auth.REPLAYED:
            first = self._copies.first(packet)
            if first is not None and packet.t_us - first[0] < SLOWEST_US:
                self.copies += 1  # the same packet over a second link
                return "info", ""
            if self._merely_late(packet):
                return "warning", self._late_words(packet.t_us)
            self.replayed += 1
        self._refused_us = packet.t_us
        if packet.auth is Auth.HELD:
            self.held += 1
            return "warning", self._held_words(packet)
        if packet.auth is Auth.UNSIGNED:
            self.unsigned += 1
        else:
            self.bad_signature += 1
        self._refused[packet.auth] += 1
        refused = self._refused[packet.auth]
        reports = self._refused_reports.setdefault(
            packet.auth, ReportGrowth(first=_ALARM_AFTER, rest=_ALARM_EVERY_US, every=_ALARM_EVERY_US)
        )
        if not reports.due(refused, packet.t_us):
            return "info", ""
        said = f"{refused} packets refused, {_REFUSED_AS[packet.auth]}"
        return "alarm", said + (self._replay_words(packet) if packet.auth is Auth.REPLAYED else "")

    def signs(self, t_us: int) -> bool:
        """Whether it was verified and nothing refused in the seconds before a Unix time in µs."""
        return t_us - self._signed_us < _AUTH_LASTS_US <= t_us - self._refused_us

    def held_s(self, t_us: int) -> float:
        """How far signatures are behind, s, while all that comes is held; else NaN."""
        held = t_us - self._held_us < _HELD_US <= t_us - self._signed_us
        return self._lag_s if held else math.nan

    def _merely_late(self, packet: Packet) -> bool:
        """Whether a packet that is not newer than others was overtaken, and comes from nobody who plays recordings."""
        source, late = (packet.link, packet.peer), self._overtaken.late(packet)
        if not late:
            if source not in self._players and len(self._players) >= _CHANNELS:
                del self._players[next(iter(self._players))]
            self._players[source] = packet.t_us
        return late and packet.t_us - self._players.get(source, _NEVER_US) >= SLOWEST_US

    def _held_words(self, packet: Packet) -> str:
        t_us = packet.t_us
        if t_us - self._held_us >= _HELD_US:
            self._held_since_us = t_us
        self._held_us = t_us
        self._lag_s = (ticks_of(t_us) - int.from_bytes(packet.raw[-12:-6], "little")) * _TICKS_S
        if t_us - self._held_since_us < _HELD_US or not self._held_reports.due("", t_us):
            return ""
        return f"signatures {_span(self._lag_s)} behind, nothing proves that its packets are made now: held"

    def _replay_words(self, packet: Packet) -> str:
        """What is known of a recording that is played."""
        age_us = self._overtaken.age_us(packet)
        channel = self._channels.get((packet.link, packet.peer))
        recorded = "before this flight" if age_us is None else f"at least {_span(age_us * 1e-6)} ago"
        own = channel is not None and packet.t_us - channel.rate.last_us < _AUTH_LASTS_US
        return f": a recording made {recorded} is played" + (", from where it speaks itself" if own else "")

    def _late_words(self, t_us: int) -> str:
        self._overtaken_count += 1
        number = self._overtaken_count
        if number < _OVERTAKEN or not self._overtaken_reports.due("", t_us):
            return ""
        return f"{number} signed packets came after newer ones and are refused: out of order, or over a slower radio"

    @property
    def late(self) -> bool:
        """Whether the packet taken last came over a channel that is seconds behind another."""
        channel = self._channel
        return channel.late_us > _LATE_US and abs(channel.rate.last_us - channel.late_at_us) < _LATE_KNOWN_US

    def dated(self, delay_us: int) -> None:
        """The packet taken last came so long after it was made, by the vehicle's clock."""
        self._channel.behind_us = max(delay_us, 0)

    @property
    def behind(self) -> bool:
        """Whether the packet taken last came over a channel whose messages are not of this moment."""
        return self._channel.behind_us > _BEHIND_US

    @property
    def prompt(self) -> bool:
        """Whether it came over one whose messages are; neither where none of them says when it was made."""
        return 0 <= self._channel.behind_us <= _BEHIND_US

    def outdated(self, t_us: int) -> bool:
        """Whether the packet taken last may tell how the vehicle was, while another radio tells how it is."""
        link, peer, *_ = self.speaker
        if self.prompt:
            self._prompt = link, peer, t_us
        elsewhere = (link, peer) != self._prompt[:2]
        return not self.prompt and elsewhere and abs(t_us - self._prompt[2]) < _PROMPT_US

    @property
    def loss(self) -> float:
        """Share of packets lost lately, all channels together."""
        expected = sum(channel.loss.expected for channel in self._channels.values())
        received = sum(channel.loss.received for channel in self._channels.values())
        return max(0.0, 1.0 - received / expected) if expected > 0.0 else 0.0

    def freshest(self) -> int:
        """Index of the link that was heard last, -1 before any."""
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

    def rates(self, system_id: int, t_us: int) -> tuple[MessageRate, ...]:
        """Measured rates of all messages, by link and message id; addresses of one link together."""
        found: dict[tuple[int, int], tuple[float, int]] = {}
        for (link, _), channel in self._channels.items():
            for message_id, rate in channel.messages.items():
                hz, last_us = found.get((link, message_id), (0.0, 0))
                found[link, message_id] = hz + rate.hz(t_us), max(last_us, rate.last_us)
        return tuple(
            MessageRate(
                system_id=system_id, link=link, message_id=message_id, hz=hz, age_s=max(0.0, (t_us - last_us) * 1e-6)
            )
            for (link, message_id), (hz, last_us) in sorted(found.items())
        )

    def _channel_of(self, link: int, peer: int) -> _Channel:
        channel = self._channels.get((link, peer))
        if channel is None:
            if len(self._channels) >= _CHANNELS:
                del self._channels[min(self._channels, key=lambda key: self._channels[key].rate.last_us)]
            channel = self._channels[link, peer] = _Channel()
        return channel
