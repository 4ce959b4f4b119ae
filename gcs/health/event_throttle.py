"""Keeps the event log readable when somebody talks without end: a few notices of each sender, then only how many more.

Nothing is lost by it: every packet is in the raw log before anything here is asked.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import replace

from gcs.snapshot import Event

__all__ = ["Quiet"]

BURST, RATE_HZ = 20.0, 2.0
"""Notices that one sender may make of one kind at once, and a second for ever after."""
SUM_UP_US = 1_000_000
MOST_SENDERS, MOST_TEXTS = 600, 16


class _Talker:
    """One sender's notices of one kind."""

    __slots__ = ("held", "last_us", "most", "since_us", "tokens")

    def __init__(self, t_us: int) -> None:
        self.tokens = BURST
        self.last_us = t_us
        self.held = 0
        """Notices that were not let through."""
        self.since_us = 0
        self.most: Counter[Event] = Counter()
        """The first few different ones of them, all at the time of the first."""

    def may(self, t_us: int) -> bool:
        self.tokens = min(BURST, self.tokens + max(0, t_us - self.last_us) * 1e-6 * RATE_HZ)
        self.last_us = max(self.last_us, t_us)
        if self.tokens < 1.0:
            return False
        self.tokens -= 1.0
        return True

    def hold(self, event: Event) -> None:
        self.since_us = self.since_us if self.held else event.t_us
        self.held += 1
        event = replace(event, t_us=self.since_us)
        if event in self.most or len(self.most) < MOST_TEXTS:
            self.most[event] += 1

    def sum_up(self, t_us: int) -> Event:
        """One event for all that were held."""
        event, number = self.most.most_common(1)[0]
        text = f"{event.text} × {number}"
        if number < self.held:
            text = f"{self.held} more, most often: {text}"
        self.held = 0
        self.most.clear()
        return replace(event, t_us=t_us, text=text)


class Quiet:
    """Lets through a sender's first notices and sums up the rest once a second."""

    def __init__(self) -> None:
        self._talkers: dict[tuple[int, str], _Talker] = {}
        self._now_us = 0

    def hear(self, events: Iterable[Event]) -> list[Event]:
        """What of these is to be told now, with what has been held back for a second."""
        said: list[Event] = []
        for event in events:
            talker = self._talker(event)
            if talker.may(event.t_us):
                said.append(event)
            else:
                talker.hold(event)
                if event.t_us - talker.since_us >= SUM_UP_US:
                    said.append(talker.sum_up(event.t_us))
        return said

    def overdue(self, t_us: int) -> list[Event]:
        """What was held back for a second, although its sender has fallen silent."""
        waiting = [talker for talker in self._talkers.values() if talker.held and t_us - talker.since_us >= SUM_UP_US]
        return [talker.sum_up(t_us) for talker in waiting]

    def _talker(self, event: Event) -> _Talker:
        key = (event.system_id, event.kind)
        talker = self._talkers.get(key)
        if talker is None:
            if len(self._talkers) >= MOST_SENDERS:
                del self._talkers[min(self._talkers, key=lambda k: self._talkers[k].last_us)]
            talker = self._talkers[key] = _Talker(event.t_us)
        return talker
