"""The share of each sender's datagrams that passes when more arrive than can be handled.

Every known sender, and all unknown ones together, have an allowance: a rate, and a burst. Within it everything passes.
Beyond it a share p passes, which moves the rate that passes, s datagrams in a time dt, towards the allowed rate R:

    p' = min(1, p · min(2, R · dt / s))

so it falls at once and recovers by doubling. Where all senders together are too many, R is the level of a max-min fair
division: those that want less get all they want, the others the same each.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from mavlink.links.batch import Sender

LIKELY_PER_S, OTHER_PER_S = 5000.0, 200.0
"""Unknown datagrams allowed: those that look like a frame may be of a vehicle that has just rebooted."""
STRANGERS_BURST_S = 0.25
SENDER_PER_S = 2000.0
"""Good frames allowed of one vehicle over one address: an autopilot on a fast line sends a few hundred a second."""
ALL_PER_S = 25_000.0
"""Good frames allowed of all known senders: a hundred vehicles send 20,000 a second."""
READ_PER_S = 60_000.0
"""Datagrams of all known senders, with the junk that claims to be theirs, that a quick machine reads. A sender that
keeps to a vehicle's rate is always read."""
SENDER_BURST_S = 2.0
"""A radio delivers at once what it could not for a while."""
_SMOOTH_S = 1.0
"""Time constant of the measured rates."""
HOLD_S = 3.0
"""A flood that pauses for no longer counts as one."""
_SLOWER, _FASTER = 0.5, 1.03
"""Factors on the rate that this machine reads: when it is late, and for each update when it is not."""
_DRAIN_S = 0.3
"""Time after the read rate is lowered in which what had queued before is still being read."""
_TINY = 1e-6
"""Lower bound of shares and divisors, above zero."""


def fair_level(wanted: Iterable[float], total: float) -> float:
    """The level L with Σ min(wanted, L) = total; inf where all that is wanted is no more than that."""
    rates, left = sorted(wanted), total
    for k, rate in enumerate(rates):
        level = left / (len(rates) - k)
        if rate > level:
            return level
        left -= rate
    return math.inf


@dataclass(slots=True)
class Allowance:
    """Allowance of one sender, or of all unknown senders of a class together."""

    burst_s: float
    credit_s: float
    """Rest of the burst, in seconds of the rate."""
    share: float = 1.0
    """Share of its datagrams that passes now."""
    wanted_per_s: float = 0.0
    """Rate that arrives, passed or not."""
    turned_away: float = 0.0
    """Estimated number of datagrams of this flood that did not pass."""
    limited_s: float = -math.inf
    """Time at which it last was limited, monotonic."""

    @classmethod
    def full(cls, burst_s: float) -> Allowance:
        """Return an unused allowance."""
        return cls(burst_s, burst_s)

    def estimate_refused(self, seen: int) -> float:
        """Estimate how many did not pass where ``seen`` did, n (1/p − 1); even where none did, some may have come."""
        return (seen + 0.5) * (1.0 / self.share - 1.0)

    def count(self, seen: int, away: float, dt_s: float, now_s: float) -> None:
        """Count the datagrams that passed in a time, and those that did not."""
        part = min(dt_s / _SMOOTH_S, 1.0) if self.share < 1.0 else 1.0
        self.wanted_per_s += part * ((seen + away) / dt_s - self.wanted_per_s)
        self.turned_away += away
        if self.share < 1.0:
            self.limited_s = now_s

    def spend(self, used_s: float, dt_s: float, now_s: float, *, now: bool = False) -> None:
        """Take what passed in a time off the allowance.

        Args:
            used_s: what passed, in seconds of the allowed rate.
            now_s: monotonic.
            now: whether not even a burst can be handled.
        """
        if self.share >= 1.0:
            self.credit_s = min(self.burst_s, self.credit_s + dt_s - used_s)
            if self.credit_s >= 0.0 and not (now and used_s > dt_s):
                return
        self.credit_s = 0.0
        self.share = min(1.0, max(_TINY, self.share * min(2.0, dt_s / max(used_s, _TINY))))
        if self.share < 1.0:
            if now_s - self.limited_s >= HOLD_S:
                self.turned_away = 0.0
            self.limited_s = now_s


@dataclass(frozen=True, slots=True)
class PassedTraffic:
    """Counts of what passed in a while."""

    likely: int
    """Unknown datagrams that look like one frame."""
    other: int
    """Other unknown datagrams."""
    frames: Mapping[Sender, int]
    """Good frames of known senders; empty where their number is not limited."""
    read: Mapping[Sender, int]
    """Datagrams of known senders."""
    turned_away: int = 0
    """Datagrams that did not pass."""
    late: bool = False
    """True if many were queued."""


class Shares:
    """Shares of all senders of one port."""

    def __init__(self) -> None:
        self.likely, self.other = Allowance.full(STRANGERS_BURST_S), Allowance.full(STRANGERS_BURST_S)
        self.limited: dict[Sender, Allowance] = {}
        """Known senders over their allowance lately; of all others everything passes."""
        self.read_per_s = READ_PER_S
        """Datagrams of known senders that this machine can read, as measured."""
        self._slower_s = -math.inf

    def adapt(self, traffic: PassedTraffic, systems: Mapping[Sender, int], dt_s: float, now_s: float) -> None:
        """Set the shares from what came.

        Args:
            systems: for how many systems each known sender sends.
            now_s: monotonic.
        """
        self._count(traffic, dt_s, now_s)
        self._adapt_read_rate(sum(traffic.read.values()) / dt_s, now_s, late=traffic.late)
        self.likely.spend(traffic.likely / LIKELY_PER_S, dt_s, now_s)
        self.other.spend(traffic.other / OTHER_PER_S, dt_s, now_s)
        frames_level = self._level(traffic.frames, ALL_PER_S, dt_s)
        read_level = max(self._level(traffic.read, self.read_per_s, dt_s), SENDER_PER_S)
        for sender in {*traffic.read, *self.limited}:
            most_per_s = min(SENDER_PER_S * systems.get(sender, 1), frames_level)
            frames_s, read_s = traffic.frames.get(sender, 0) / most_per_s, traffic.read.get(sender, 0) / read_level
            used_s = max(frames_s, read_s)
            if sender not in self.limited and used_s > dt_s:
                self.limited[sender] = Allowance.full(SENDER_BURST_S)
                self.limited[sender].count(traffic.read[sender], 0.0, dt_s, now_s)
            if sender in self.limited:
                self.limited[sender].spend(used_s, dt_s, now_s, now=read_s > dt_s)

    def _count(self, traffic: PassedTraffic, dt_s: float, now_s: float) -> None:
        """Attribute the drops, which the kernel counts together, to senders as their shares would have it."""
        parts = [(self.likely, traffic.likely), (self.other, traffic.other)]
        parts += [(allowance, traffic.read.get(sender, 0)) for sender, allowance in self.limited.items()]
        held_back = [allowance.estimate_refused(seen) for allowance, seen in parts]
        scale = traffic.turned_away / max(sum(held_back), _TINY)
        for (allowance, seen), away in zip(parts, held_back, strict=True):
            allowance.count(seen, away * scale, dt_s, now_s)

    def forget(self, since_s: float, known: Mapping[Sender, int]) -> None:
        """Forget senders that were not limited since a time (monotonic), or are not known any more."""
        for sender, allowance in list(self.limited.items()):
            rested = allowance.share >= 1.0 and allowance.credit_s >= allowance.burst_s
            if sender not in known or (rested and allowance.limited_s < since_s):
                del self.limited[sender]

    def _adapt_read_rate(self, read_per_s: float, now_s: float, *, late: bool) -> None:
        """Adapt the rate that this machine reads beside its other work."""
        if not late:
            self.read_per_s = min(READ_PER_S, _FASTER * self.read_per_s)
        elif now_s - self._slower_s >= _DRAIN_S:
            self.read_per_s = max(SENDER_PER_S, _SLOWER * min(self.read_per_s, read_per_s))
            self._slower_s = now_s

    def _level(self, counts: Mapping[Sender, int], total: float, dt_s: float) -> float:
        own = self.limited
        return fair_level((n / (own[s].share if s in own else 1.0) / dt_s for s, n in counts.items()), total)
