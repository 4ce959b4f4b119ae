"""Alarms: what is wrong now, since when and what to do, raised and cleared once each.

A finding must last before it is raised, and be gone for a while before it is cleared; the more often it came back
lately, the longer. So a vehicle at the edge of a radio's range gives two lines in the event log, not two hundred.
Time is the snapshots', so that a replay raises what the flight raised.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import Final

from gcs.health.alarm_rules import Finding, counted, findings
from gcs.snapshot import Alarm, Event, Level, Snapshot

__all__ = ["Alarms", "rank"]

HOLD_US = 3_000_000
"""Gone for so long before it is over; doubled for every time that it came lately."""
LATELY_US = 300_000_000
MOST_DOUBLINGS = 4
GROWING_US = 10_000_000
"""A counter that has grown is said to grow for so long."""
_RANK: Final[dict[Level, int]] = {"info": 0, "warning": 1, "alarm": 2}


def rank(level: Level) -> int:
    """0 info, 1 warning, 2 alarm."""
    return _RANK.get(level, 0)


@dataclass(slots=True)
class _State:
    """One trouble of one thing."""

    finding: Finding
    first_us: int
    """Since when it has been found without a break, 0 while it is not."""
    seen_us: int
    worst_us: int
    """When it was last found at the level it has."""
    found_us: int = 0
    """When it was last found at any level."""
    lower_us: int = 0
    """Since when it has been found at a lower level only, 0 while it is not."""
    raised_us: int = 0
    """When it became an alarm, 0 not yet."""
    raises: deque[int] = field(default_factory=lambda: deque(maxlen=MOST_DOUBLINGS + 1))

    def hold_us(self, now_us: int) -> int:
        """How long it must be gone."""
        lately = sum(now_us - raised < LATELY_US for raised in self.raises)
        if self.finding.settled and lately <= 1:
            return 0
        return HOLD_US << min(max(lately - 1, 0), MOST_DOUBLINGS)


class Alarms:
    """Turns snapshots into alarms; one for each flight or replay."""

    def __init__(self) -> None:
        self._states: dict[str, _State] = {}
        self._counts: dict[str, int] = {}
        self._grown_us: dict[str, int] = {}
        self._now_us = 0

    def update(self, snapshot: Snapshot) -> tuple[tuple[Alarm, ...], tuple[Event, ...]]:
        """Take in one snapshot.

        Returns:
            What is wrong now, the worst first, then the newest; and an event for each alarm that came, went or changed
            its level.
        """
        now_us = self._now_us = max(self._now_us, snapshot.t_us)
        events: list[Event] = []
        for finding in (*findings(snapshot), *self._growing(snapshot, now_us)):
            if finding.raises:
                events += self._found(finding, now_us)
            elif (state := self._states.get(finding.key)) and state.raised_us:
                state.seen_us = state.found_us = now_us
        for key in [key for key, state in self._states.items() if state.found_us < now_us]:
            self._states[key].lower_us = 0
            events += self._gone(key, now_us)
        raised = [_alarm(state) for state in self._states.values() if state.raised_us]
        raised.sort(key=lambda alarm: (-rank(alarm.level), -alarm.since_us, alarm.key))
        return tuple(raised), tuple(events)

    def _growing(self, snapshot: Snapshot, now_us: int) -> list[Finding]:
        found = []
        for count, finding in counted(snapshot):
            if count > self._counts.get(finding.key, 0):
                self._grown_us[finding.key] = now_us
            self._counts[finding.key] = count
            if now_us - self._grown_us.get(finding.key, -GROWING_US) < GROWING_US:
                found.append(finding)
        return found

    def _found(self, finding: Finding, now_us: int) -> list[Event]:
        state = self._states.get(finding.key)
        if state is None:
            state = self._states[finding.key] = _State(finding, now_us, now_us, now_us)
        before, state.found_us = state.finding, now_us
        if rank(finding.level) >= rank(before.level):
            state.lower_us = 0
        elif state.raised_us:
            state.lower_us = state.lower_us or now_us
            if now_us - state.lower_us < finding.wait_s * 1e6:
                return self._gone(finding.key, now_us)  # too short yet to be a trouble of its own
        state.first_us = state.first_us or now_us
        state.seen_us = now_us
        if rank(finding.level) >= rank(before.level) or now_us - state.worst_us > HOLD_US or not state.raised_us:
            state.finding, state.worst_us = finding, now_us
        if not state.raised_us:
            if now_us - state.first_us < finding.wait_s * 1e6:
                return []
            state.raised_us = now_us
            state.raises.append(now_us)
            return [] if finding.told else [_event(finding, now_us, finding.level, finding.text)]
        if state.finding.level != before.level and not finding.told:
            return [_event(finding, now_us, finding.level, finding.text)]
        return []

    def _gone(self, key: str, now_us: int) -> list[Event]:
        state = self._states[key]
        state.first_us = 0
        absent_us = now_us - state.seen_us
        if not state.raised_us:
            if absent_us > HOLD_US and not any(now_us - raised < LATELY_US for raised in state.raises):
                del self._states[key]
            return []
        if absent_us < state.hold_us(now_us):
            return []
        lasted_s = (state.seen_us - state.raised_us) * 1e-6
        state.raised_us = 0
        if state.finding.told:
            return []
        return [_event(state.finding, now_us, "info", f"over after {lasted_s:.0f} s: {state.finding.text}")]


def _alarm(state: _State) -> Alarm:
    f = state.finding
    return Alarm(
        key=f.key,
        level=f.level,
        kind=f.kind,
        text=f.text,
        advice=f.advice,
        since_us=state.raised_us,
        system_id=f.system_id,
    )


def _event(finding: Finding, t_us: int, level: Level, text: str) -> Event:
    return Event(t_us=t_us, level=level, kind=finding.kind, text=text, system_id=finding.system_id)
