"""How much of what comes is let in, and of whose, when more comes than can be borne.

Every sender, and strangers together, have an allowance: so many datagrams a second, and a burst at once. Who keeps
within it is let in whole. Whose allowance is used up is let in at a share p that follows the rate let in, s in a time
dt, towards the rate that he may have, R:

    p' = min(1, p · min(2, R · dt / s))

so it falls at once and opens again by doubling. Where all together are too many R is the level of a fair division:
whoever wants less than that has all he wants, and the others the same each.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from mavlink.links.batch import Sender

__all__ = ["HOLD_S", "Allowance", "Coming", "Shares", "fair_level"]

LIKELY_PER_S, OTHER_PER_S = 5000.0, 200.0
"""Strangers' datagrams wanted: those that look like a frame may be a vehicle that has just rebooted."""
STRANGERS_BURST_S = 0.25
SENDER_PER_S = 2000.0
"""Good frames wanted of one vehicle over one address: an autopilot on a fast line sends a few hundred a second."""
ALL_PER_S = 25_000.0
"""Good frames wanted of all who are known: a hundred vehicles send 20,000 a second."""
READ_PER_S = 60_000.0
"""Datagrams read of all who are known, with the junk that claims to be theirs, on a machine that is quick enough. Who
sends no more than a vehicle does is always read."""
SENDER_BURST_S = 2.0
"""A radio hands on at once what it could not for a while."""
_SMOOTH_S = 1.0
HOLD_S = 3.0
"""A flood that has paused for no longer goes on."""
_SLOWER, _FASTER = 0.5, 1.03
_DRAIN_S = 0.3
"""After it was told to read less it takes so long until what waits is read."""
_LEAST = 1e-6


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
    """Of one sender, or of all strangers of a class together."""

    burst_s: float
    credit_s: float
    """What is left of the allowance, in seconds of the rate."""
    share: float = 1.0
    """Of its datagrams, let in now."""
    wanted_per_s: float = 0.0
    """What it sends, let in or not."""
    turned_away: float = 0.0
    """Datagrams of this flood, about."""
    limited_s: float = -math.inf
    """When it last was not let in whole, monotonic."""

    @classmethod
    def full(cls, burst_s: float) -> Allowance:
        """One that nothing was taken of."""
        return cls(burst_s, burst_s)

    def held_back(self, seen: int) -> float:
        """About how many were not let in where so many were, in proportion: where none was, some may have come."""
        return (seen + 0.5) * (1.0 / self.share - 1.0)

    def count(self, seen: int, away: float, dt_s: float, now_s: float) -> None:
        """Notes what came in a time, and what of it was not let in."""
        part = min(dt_s / _SMOOTH_S, 1.0) if self.share < 1.0 else 1.0
        self.wanted_per_s += part * ((seen + away) / dt_s - self.wanted_per_s)
        self.turned_away += away
        if self.share < 1.0:
            self.limited_s = now_s

    def use(self, used_s: float, dt_s: float, now_s: float, *, now: bool = False) -> None:
        """Takes what came in a time off what is allowed.

        Args:
            used_s: what was let in, in seconds of the rate that is allowed.
            dt_s: the time.
            now_s: monotonic.
            now: whether no burst can be borne.
        """
        if self.share >= 1.0:
            self.credit_s = min(self.burst_s, self.credit_s + dt_s - used_s)
            if self.credit_s >= 0.0 and not (now and used_s > dt_s):
                return
        self.credit_s = 0.0
        self.share = min(1.0, max(_LEAST, self.share * min(2.0, dt_s / max(used_s, _LEAST))))
        if self.share < 1.0:
            if now_s - self.limited_s >= HOLD_S:
                self.turned_away = 0.0
            self.limited_s = now_s


@dataclass(frozen=True, slots=True)
class Coming:
    """What came in a while, and was let in."""

    likely: int
    """Strangers' datagrams that look like one frame."""
    other: int
    """Strangers' other datagrams."""
    frames: Mapping[Sender, int]
    """Good frames of those who are known; none where they are to be let in however many there are."""
    read: Mapping[Sender, int]
    """Datagrams of those who are known."""
    turned_away: int = 0
    """Datagrams that were not let in."""
    late: bool = False
    """Whether many waited to be read."""


class Shares:
    """Of everybody."""

    def __init__(self) -> None:
        self.likely, self.other = Allowance.full(STRANGERS_BURST_S), Allowance.full(STRANGERS_BURST_S)
        self.own: dict[Sender, Allowance] = {}
        """Those of known senders who have sent more than their part lately; all others are let in whole."""
        self.read_per_s = READ_PER_S
        """Datagrams of all who are known that this machine can read, as far as was seen."""
        self._slower_s = -math.inf

    def adapt(self, coming: Coming, systems: Mapping[Sender, int], dt_s: float, now_s: float) -> None:
        """Sets the shares from what came.

        Args:
            coming: since the last time.
            systems: how many systems each of those who are known speaks for, at this address and in this form.
            dt_s: since the last time.
            now_s: monotonic.
        """
        self._count(coming, dt_s, now_s)
        self._learn(sum(coming.read.values()) / dt_s, now_s, late=coming.late)
        self.likely.use(coming.likely / LIKELY_PER_S, dt_s, now_s)
        self.other.use(coming.other / OTHER_PER_S, dt_s, now_s)
        frames_level = self._level(coming.frames, ALL_PER_S, dt_s)
        read_level = max(self._level(coming.read, self.read_per_s, dt_s), SENDER_PER_S)
        for sender in {*coming.read, *self.own}:
            most_per_s = min(SENDER_PER_S * systems.get(sender, 1), frames_level)
            frames_s, read_s = coming.frames.get(sender, 0) / most_per_s, coming.read.get(sender, 0) / read_level
            used_s = max(frames_s, read_s)
            if sender not in self.own and used_s > dt_s:
                self.own[sender] = Allowance.full(SENDER_BURST_S)
                self.own[sender].count(coming.read[sender], 0.0, dt_s, now_s)
            if sender in self.own:
                self.own[sender].use(used_s, dt_s, now_s, now=read_s > dt_s)

    def _count(self, coming: Coming, dt_s: float, now_s: float) -> None:
        """Divides what was not let in, of which there is one count, as the shares say."""
        parts = [(self.likely, coming.likely), (self.other, coming.other)]
        parts += [(allowance, coming.read.get(sender, 0)) for sender, allowance in self.own.items()]
        held_back = [allowance.held_back(seen) for allowance, seen in parts]
        scale = coming.turned_away / max(sum(held_back), _LEAST)
        for (allowance, seen), away in zip(parts, held_back, strict=True):
            allowance.count(seen, away * scale, dt_s, now_s)

    def forget(self, since_s: float, known: Mapping[Sender, int]) -> None:
        """Leaves out those who have been let in whole since a time (monotonic), and who are not known any more."""
        for sender, allowance in list(self.own.items()):
            rested = allowance.share >= 1.0 and allowance.credit_s >= allowance.burst_s
            if sender not in known or (rested and allowance.limited_s < since_s):
                del self.own[sender]

    def _learn(self, read_per_s: float, now_s: float, *, late: bool) -> None:
        """How fast this machine reads while it does what else it has to do."""
        if not late:
            self.read_per_s = min(READ_PER_S, _FASTER * self.read_per_s)
        elif now_s - self._slower_s >= _DRAIN_S:
            self.read_per_s = max(SENDER_PER_S, _SLOWER * min(self.read_per_s, read_per_s))
            self._slower_s = now_s

    def _level(self, counts: Mapping[Sender, int], total: float, dt_s: float) -> float:
        own = self.own
        return fair_level((n / (own[s].share if s in own else 1.0) / dt_s for s, n in counts.items()), total)
