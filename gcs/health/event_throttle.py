"""Keeps the event log readable when a sender floods it: a few notices of each sender, then only how many more.

Nothing is lost by it: every packet is in the raw log before anything here is asked.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import replace

from gcs.snapshot import Event
from infra.reporting import TokenBucket

BURST, RATE_HZ = 20.0, 2.0
"""Notices of one kind that one sender may make at once, and each second from then on."""
SUM_UP_US = 1_000_000
MAX_SENDERS, MAX_TEXTS = 600, 16


class _SenderEvents:
    """One sender's notices of one kind."""

    __slots__ = ("bucket", "held", "most", "since_us")

    def __init__(self, t_us: int) -> None:
        self.bucket = TokenBucket(RATE_HZ, BURST, t_us * 1e-6)
        self.held = 0
        """Notices that were not let through."""
        self.since_us = 0
        self.most: Counter[Event] = Counter()
        """The first few different ones of them, all at the time of the first."""

    def hold(self, event: Event) -> None:
        self.since_us = self.since_us if self.held else event.t_us
        self.held += 1
        event = replace(event, t_us=self.since_us)
        if event in self.most or len(self.most) < MAX_TEXTS:
            self.most[event] += 1

    def sum_up(self, t_us: int) -> Event:
        """Sum up all events that were held in one."""
        event, number = self.most.most_common(1)[0]
        text = f"{event.text} × {number}"
        if number < self.held:
            text = f"{self.held} more, most often: {text}"
        self.held = 0
        self.most.clear()
        return replace(event, t_us=t_us, text=text)


class EventThrottle:
    """Lets through a sender's first notices and sums up the rest once a second."""

    def __init__(self) -> None:
        self._senders: dict[tuple[int, str], _SenderEvents] = {}
        self._now_us = 0

    def admit(self, events: Iterable[Event]) -> list[Event]:
        """Events of these that are to be reported now, with what has been held back for a second."""
        admitted: list[Event] = []
        for event in events:
            sender = self._sender(event)
            if sender.bucket.allows(event.t_us * 1e-6):
                admitted.append(event)
            else:
                sender.hold(event)
                if event.t_us - sender.since_us >= SUM_UP_US:
                    admitted.append(sender.sum_up(event.t_us))
        return admitted

    def overdue(self, t_us: int) -> list[Event]:
        """Events that were held back for a second, although their sender has fallen silent."""
        waiting = [sender for sender in self._senders.values() if sender.held and t_us - sender.since_us >= SUM_UP_US]
        return [sender.sum_up(t_us) for sender in waiting]

    def _sender(self, event: Event) -> _SenderEvents:
        key = (event.system_id, event.kind)
        sender = self._senders.get(key)
        if sender is None:
            if len(self._senders) >= MAX_SENDERS:
                del self._senders[min(self._senders, key=lambda k: self._senders[k].bucket.last_s)]
            sender = self._senders[key] = _SenderEvents(event.t_us)
        return sender
