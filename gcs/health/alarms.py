"""Alarms: what is wrong now, since when and what to do, raised and cleared once each.

What is wrong must last before it is raised, and be gone for a while before it is cleared; the more often it came back
lately, the longer. So a vehicle at the edge of a radio's range gives two lines in the event log, not two hundred.
Time is the snapshots', so that a replay raises what the flight raised.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import Final

from gcs.health.alarm_rule import CLEARS_AFTER_S, GROWING_S
from gcs.health.alarm_rules import Finding, findings
from gcs.health.text_alarms import TextAlarms
from gcs.snapshot import Alarm, Event, Level, Snapshot

__all__ = ["Alarms", "rank", "urgency"]

WORST_US = round(CLEARS_AFTER_S * 1e6)
"""An alarm has its higher level for so long after that was last found."""
GROWING_US = round(GROWING_S * 1e6)
LATELY_US = 300_000_000
"""An alarm that came back within so long must be gone longer to be over: doubled for every time."""
MOST_DOUBLINGS = 4
_RANK: Final[dict[Level, int]] = {"info": 0, "warning": 1, "alarm": 2}


def rank(level: Level) -> int:
    """0 info, 1 warning, 2 alarm."""
    return _RANK.get(level, 0)


def urgency(alarm: Alarm) -> tuple[int, bool, int, str]:
    """The order of alarms: the worst first, what vehicles say after what was found, then the newest."""
    return -rank(alarm.level), alarm.kind == "text", -alarm.since_us, alarm.key


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
        if lately <= 1:
            return round(self.finding.rule.clears_after_s * 1e6)
        return round(CLEARS_AFTER_S * 1e6) << min(lately - 1, MOST_DOUBLINGS)


class Alarms:
    """Turns snapshots into alarms; one for each flight or replay.

    Attributes:
        texts: what vehicles say, which are alarms as well.
    """

    def __init__(self) -> None:
        self.texts = TextAlarms()
        self._states: dict[str, _State] = {}
        self._counts: dict[str, int] = {}
        self._grown_us: dict[str, int] = {}
        self._now_us = 0

    def update(self, snapshot: Snapshot) -> tuple[tuple[Alarm, ...], tuple[Event, ...]]:
        """Take in one snapshot.

        Returns:
            What is wrong now, the worst first, then the newest, what vehicles say after what was found; and an event
            for each alarm that was found, went or changed its level.
        """
        now_us = self._now_us = max(self._now_us, snapshot.t_us)
        events: list[Event] = []
        for finding in findings(snapshot):
            if finding.raises:
                if finding.count is None or self._grows(finding.key, finding.count, now_us):
                    events += self._found(finding, now_us)
            elif (state := self._states.get(finding.key)) and state.raised_us:
                state.seen_us = state.found_us = now_us
        for key in [key for key, state in self._states.items() if state.found_us < now_us]:
            self._states[key].lower_us = 0
            events += self._gone(key, now_us)
        raised = [_alarm(state) for state in self._states.values() if state.raised_us]
        raised += self.texts.update(now_us)
        raised.sort(key=urgency)
        return tuple(raised), tuple(events)

    def _grows(self, key: str, count: int, now_us: int) -> bool:
        """Notes a counter; whether it has grown lately."""
        # a count that is lower has begun anew, with the process that counts
        if count != self._counts.get(key, 0):
            self._grown_us[key] = now_us
        self._counts[key] = count
        return now_us - self._grown_us.get(key, -GROWING_US) < GROWING_US

    def _found(self, finding: Finding, now_us: int) -> list[Event]:
        state = self._states.get(finding.key)
        if state is None:
            state = self._states[finding.key] = _State(finding, now_us, now_us, now_us)
        before, state.found_us = state.finding, now_us
        if rank(finding.rule.level) >= rank(before.rule.level):
            state.lower_us = 0
        elif state.raised_us:
            state.lower_us = state.lower_us or now_us
            if now_us - state.lower_us < finding.rule.lasts_s * 1e6:
                return self._gone(finding.key, now_us)  # too short yet to be a trouble of its own
        state.first_us = state.first_us or now_us
        state.seen_us = now_us
        worst = rank(finding.rule.level) >= rank(before.rule.level) or now_us - state.worst_us > WORST_US
        if worst or not state.raised_us:
            state.finding, state.worst_us = finding, now_us
        if not state.raised_us:
            if now_us - state.first_us < finding.rule.lasts_s * 1e6:
                return []
            state.raised_us = now_us
            state.raises.append(now_us)
        elif state.finding.rule.level == before.rule.level:
            return []
        return _logged(finding, now_us, finding.rule.level, finding.text)

    def _gone(self, key: str, now_us: int) -> list[Event]:
        state = self._states[key]
        state.first_us = 0
        absent_us = now_us - state.seen_us
        if not state.raised_us:
            if absent_us > WORST_US and not any(now_us - raised < LATELY_US for raised in state.raises):
                del self._states[key]
            return []
        if absent_us < state.hold_us(now_us):
            return []
        lasted_s = (state.seen_us - state.raised_us) * 1e-6
        state.raised_us = 0
        return _logged(state.finding, now_us, "info", f"over after {lasted_s:.0f} s: {state.finding.text}")


def _alarm(state: _State) -> Alarm:
    finding, rule = state.finding, state.finding.rule
    return Alarm(
        key=finding.key,
        level=rule.level,
        kind=rule.kind,
        text=finding.text,
        advice=rule.advice,
        since_us=state.raised_us,
        system_id=finding.system_id,
        doubts_name=rule.doubts_name,
    )


def _logged(finding: Finding, t_us: int, level: Level, text: str) -> list[Event]:
    """A line of the event log, or none where another module writes them."""
    if finding.rule.logged_by:
        return []
    return [Event(t_us=t_us, level=level, kind=finding.rule.kind, text=text, system_id=finding.system_id)]
