"""Loss of a vehicle's packets on the way: by their sequence numbers and by the times they carry.

A hole in the sequence numbers is not always a loss: routers pass on some message types only, recordings keep some, and
messages of unknown dialects or without a signature are rejected. What a vehicle sends regularly distinguishes them: a
lossy link loses heartbeats and attitudes as well, a filter drops none of the types that it lets pass.
"""

from __future__ import annotations

import math
from collections import deque
from itertools import islice

from mavlink.protocol.dialect import HEARTBEAT
from mavlink.protocol.packet import Packet

SEQUENCE_LATE = 128
"""Sequence numbers are modulo 256: steps forward of half of that and more are steps back, by a reordered packet."""
_SEQUENCE_HALF_LIFE = 400.0
"""Packets after which older ones count half in a loss."""
_MAX_SEQUENCES = 32
"""Counters followed for one loss: components times links."""

_WINDOW_MS, _MAX_INTERVALS = 30_000, 64
"""Time over which what is regular is measured, and most intervals."""
_NEIGHBOURS = 10
"""Intervals on each side of one that tell what is usual there: of this many, a few are whole though most messages are
lost."""
_MIN_INTERVALS, _COUNTED_EVERY = 4, 4
_KNOWN_FROM = 10
"""Regular messages that have to come before a hole counts as a loss: of half as many it could be chance."""
_SILENCE_MS = 10_000
"""A longer interval is a silence, which is reported as that."""


class SequenceLoss:
    """Share of packets lost lately; every sender counts its packets per channel, modulo 256."""

    __slots__ = ("_half_life", "_last", "expected", "received")

    def __init__(self, half_life: float = _SEQUENCE_HALF_LIFE) -> None:
        self._half_life = half_life
        self._last: dict[tuple[int, int], int] = {}
        self.expected = 0.0
        """Packets sent lately, by their numbers; older ones count less."""
        self.received = 0.0

    def add(self, link: int, component_id: int, seq: int) -> None:
        """Count one packet."""
        key = (link, component_id)
        last = self._last.get(key)
        if last is None and len(self._last) >= _MAX_SEQUENCES:
            return
        step = 1 if last is None else (seq - last) & 0xFF
        self.received += 1.0
        if step == 0 or step >= SEQUENCE_LATE:
            self.expected += 1.0 if step == 0 else 0.0
            return
        self._last[key] = seq
        self.expected += step
        if self.expected > self._half_life:
            self.expected *= 0.5
            self.received *= 0.5

    @property
    def share(self) -> float:
        """0 nothing lost .. 1 everything."""
        return max(0.0, 1.0 - self.received / self.expected) if self.expected > 0.0 else 0.0


class _RegularMessage:
    """One message type that a vehicle sends at a steady rate."""

    __slots__ = ("_intervals_ms", "_last_ms", "_new", "_sent", "_span_ms", "received", "sent")

    def __init__(self, made_ms: int) -> None:
        self._last_ms = made_ms
        self._intervals_ms: deque[int] = deque()
        self._sent: deque[int] = deque()
        """Messages in each interval, its last one among them."""
        self._span_ms = 0
        self._new = 0
        """Intervals since the last count."""
        self.received = 0
        """Messages that came lately, as counted last; 0 while too few for a usual interval did."""
        self.sent = 0
        """Messages that were sent meanwhile, by the usual interval between them."""

    def add(self, made_ms: int) -> None:
        """Add a message that was made at a time in ms."""
        interval_ms = made_ms - self._last_ms
        if abs(interval_ms) > _SILENCE_MS:
            self._last_ms = made_ms  # a silence or a reboot
        if not 0 < interval_ms <= _SILENCE_MS:
            return
        self._last_ms = made_ms
        while self._span_ms > _WINDOW_MS or len(self._intervals_ms) >= _MAX_INTERVALS:
            self._span_ms -= self._intervals_ms.popleft()
            self._sent.popleft()
        self._intervals_ms.append(interval_ms)
        self._sent.append(1)
        self._span_ms += interval_ms
        self._new += 1

    def count(self) -> None:
        """Count what came and what was sent, where enough is new."""
        total = len(self._intervals_ms)
        if total < _MIN_INTERVALS or (self.received and self._new < _COUNTED_EVERY):
            return
        # of those before them, the intervals after are known now as well
        for at in range(max(0, total - self._new - _NEIGHBOURS), total):
            self._sent[at] = self._sent_in(at)
        self._new, self.received, self.sent = 0, total, sum(self._sent)

    def _sent_in(self, at: int) -> int:
        """Messages sent in one interval, by what is usual before and after it: at a change of the rate the longer."""
        usual_ms = max(self._usual_ms(at - _NEIGHBOURS, at + 1), self._usual_ms(at, at + _NEIGHBOURS + 1))
        return max(1, round(self._intervals_ms[at] / usual_ms)) if usual_ms else 1

    def _usual_ms(self, start: int, stop: int) -> int:
        """The second shortest interval, since the shortest may end with an extra message; 0 where there are too few."""
        near = sorted(islice(self._intervals_ms, max(0, start), stop))
        return near[1] if len(near) >= _MIN_INTERVALS else 0


class PacketLoss:
    """Share of the packets lost on one channel."""

    __slots__ = ("_regular", "sequence")

    def __init__(self, half_life: float = _SEQUENCE_HALF_LIFE) -> None:
        self.sequence = SequenceLoss(half_life)
        self._regular: dict[tuple[int, int], _RegularMessage] = {}

    def add(self, packet: Packet, message_id: int) -> None:
        """Count one packet."""
        component_id = packet.component_id
        self.sequence.add(packet.peer, component_id, packet.seq)
        made_ms = packet.t_us // 1000 if message_id == HEARTBEAT else packet.boot_ms
        if not made_ms:
            return
        key = component_id, message_id
        regular = self._regular.get(key)
        if regular is not None:
            regular.add(made_ms)
        elif len(self._regular) < _MAX_SEQUENCES:
            self._regular[key] = _RegularMessage(made_ms)

    @property
    def share(self) -> float:
        """0 nothing lost .. 1 everything; NaN while it is not known whether holes in the numbers are losses."""
        numbered = self.sequence.share
        if not numbered:
            return 0.0
        sent = received = 0
        for regular in self._regular.values():
            regular.count()
            if regular.received:
                sent, received = sent + regular.sent, received + regular.received
        return min(numbered, 1.0 - received / sent) if received >= _KNOWN_FROM else math.nan
