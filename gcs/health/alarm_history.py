"""Every alarm of a flight, from when it came until it went."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

from gcs.health.alarms import rank
from gcs.snapshot import Alarm


@dataclass(slots=True, kw_only=True)
class AlarmSpan:
    """An alarm from when it came until it went."""

    alarm: Alarm
    """Alarm in the words of its highest level."""
    until_us: int


class AlarmHistory:
    """Adds up the alarms that are on, moment by moment; one that changes its level stays the same alarm.

    Attributes:
        spans: in order of their coming.
    """

    def __init__(self) -> None:
        self.spans: list[AlarmSpan] = []
        self._on: dict[tuple[str, int], AlarmSpan] = {}

    def add(self, t_us: int, alarms: Iterable[Alarm]) -> None:
        """Take in what is on at the next moment, Unix µs."""
        before, self._on = self._on, {}
        for alarm in alarms:
            key = alarm.key, alarm.since_us
            span = before.get(key)
            if span is None:
                span = AlarmSpan(alarm=alarm, until_us=t_us)
                self.spans.append(span)
            elif rank(alarm.level) > rank(span.alarm.level):
                span.alarm = replace(alarm, acknowledged=span.alarm.acknowledged)
            span.until_us = t_us
            self._on[key] = span
