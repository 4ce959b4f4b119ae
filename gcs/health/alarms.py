"""Alarms: what is wrong now, since when and what to do, raised and cleared once each.

What is wrong must last before it is raised, and be gone for a moment before it is cleared. What keeps coming back is
another alarm, which says how often and is held the longer the more often it came; meanwhile the first is raised only
where it stays. So a vehicle at the edge of a radio's range gives six lines in the event log, not two hundred, and
nothing is said to be wrong that is well. Time is the snapshots', so that a replay raises what the flight raised.

A serious text of a vehicle is an alarm that stays until the operator has acknowledged it. Such texts are words from the
air, so they are of a kind of their own, begin with who says them, and are few of each vehicle however many it sends:
the event log and the telemetry log have them all.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final

from gcs.health.alarm_rule import CLEARS_AFTER_S, GROWING_S
from gcs.health.alarm_rules import Finding, findings
from gcs.snapshot import Alarm, Event, Snapshot
from mavlink.state import ARMING_FAILURES, Level

MAX_TEXTS = 6
"""Different texts of one vehicle that are alarms of their own; further ones share one."""
GONE_US = 60_000_000
"""An acknowledged text is over when it was not repeated for this long: autopilots repeat what still holds every 30
s."""
ADVICE = "these are the vehicle's own words, not this program's: check the vehicle; acknowledged, it goes"
WORST_US = round(CLEARS_AFTER_S * 1e6)
"""An alarm has its higher level for this long after that was last found."""
GROWING_US = round(GROWING_S * 1e6)
LATELY_US = 300_000_000
"""Time over which the returns of a trouble are counted, µs."""
BREAK_US = 500_000
"""Shortest break: what was gone for less has not come again."""
FLAPS, MAX_COUNTED = 3, 1_000
"""Number of times from which on an alarm counts as coming and going, and the most that are counted."""
STAYS_US = 10_000_000
"""Time after which coming and going is an alarm of its own as well."""
MINUTES_FROM_S = 90.0
MAX_DOUBLINGS = 4
"""Most doublings of the time that what comes and goes must be gone, one for every time it came."""
_RANK: Final[dict[Level, int]] = {"info": 0, "warning": 1, "alarm": 2}


@dataclass(slots=True)
class _Text:
    """Text of one vehicle that is not over yet."""

    event: Event
    """The first, or of those that share an alarm the newest."""
    since_us: int
    last_us: int
    others: int = 0
    """Further texts that share this alarm."""
    seen: bool = False

    def is_over(self, now_us: int) -> bool:
        return self.seen and now_us - self.last_us > GONE_US


class TextAlarms:
    """Texts that are not over yet, by the key of their alarm."""

    def __init__(self) -> None:
        self._texts: dict[str, _Text] = {}

    def add(self, event: Event) -> None:
        """Take in an event; only serious texts of vehicles count, and not arming checks: they have their own alarm."""
        words = event.text.partition(" says: ")[2]
        if event.kind != "text" or event.level != "alarm" or words.startswith(ARMING_FAILURES):
            return
        whose = f"text {event.system_id} "
        key = whose + event.text
        if key not in self._texts and not self._has_room(whose):
            key = whose  # shared: no text is empty
        known = self._texts.get(key)
        if known is None or known.is_over(event.t_us):
            self._texts[key] = _Text(event, event.t_us, event.t_us)
            return
        known.last_us = event.t_us
        if key == whose:
            known.event, known.others = event, known.others + 1
            # what comes on top of what was acknowledged is new
            if known.seen:
                known.seen, known.since_us = False, event.t_us

    def acknowledge(self, key: str) -> None:
        """The operator has seen an alarm; nothing where it is none of these."""
        if key in self._texts:
            self._texts[key].seen = True

    def update(self, now_us: int) -> Iterator[Alarm]:
        """The alarms at a time."""
        for key, text in list(self._texts.items()):
            if text.is_over(now_us):
                del self._texts[key]
                continue
            more = f" (and {text.others} more)" if text.others else ""
            yield Alarm(
                key=key,
                level="alarm",
                kind="text",
                text=text.event.text + more,
                advice=ADVICE,
                since_us=text.since_us,
                system_id=text.event.system_id,
            )

    def _has_room(self, whose: str) -> bool:
        """Tell whether a vehicle may have one more alarm of its own; the oldest that was seen makes room."""
        own = [key for key in self._texts if key.startswith(whose) and key != whose]
        if len(own) < MAX_TEXTS:
            return True
        oldest = next((key for key in own if self._texts[key].seen), None)
        if oldest is not None:
            del self._texts[oldest]
        return oldest is not None


def rank(level: Level) -> int:
    """0 info, 1 warning, 2 alarm."""
    return _RANK.get(level, 0)


def urgency(alarm: Alarm) -> tuple[int, bool, bool, bool, int, str]:
    """The order of alarms, the worst first.

    Of one level: names that may be wrong, then what the whole station has, then a vehicle's other troubles, then what
    vehicles say; then the newest.
    """
    whose = alarm.kind == "text", not alarm.doubts_name, alarm.system_id > 0
    return -rank(alarm.level), *whose, -alarm.since_us, alarm.key


@dataclass(slots=True)
class _State:
    """State of one alarm of one subject."""

    finding: Finding
    first_us: int
    """Time since which it has been found without a break, 0 while it is not."""
    seen_us: int
    worst_us: int
    """Time at which it was last found at the level it has."""
    found_us: int = 0
    """Time at which it was last found at any level."""
    lower_us: int = 0
    """Time since which it has been found at a lower level only, 0 while it is not."""
    raised_us: int = 0
    """Time at which it became an alarm, 0 not yet."""
    coming: bool = True
    """True if it has come, and not lasted yet."""
    came: deque[int] = field(default_factory=lambda: deque(maxlen=MAX_COUNTED))
    """Times at which it came, lately."""
    flapping_us: int = 0
    """Time at which it became one that comes and goes, 0 while it is none."""

    def note_coming(self, now_us: int) -> bool:
        """Note that it lasts; return whether it has come, and often enough lately to come and go."""
        if not self.coming:
            return False
        self.coming = False
        self.forget(now_us)
        self.came.append(now_us)
        return len(self.came) >= FLAPS

    def forget(self, now_us: int) -> None:
        """Forget what was long ago."""
        while self.came and now_us - self.came[0] >= LATELY_US:
            self.came.popleft()

    def is_calm(self, now_us: int) -> bool:
        """Tell whether what came and went has been gone for long enough."""
        return now_us - self.seen_us >= WORST_US << min(len(self.came), MAX_DOUBLINGS)

    def flapping(self) -> Finding:
        """Finding about what comes and goes: how often it came, in how long."""
        within_s = (self.seen_us - min(self.came, default=self.seen_us)) * 1e-6
        within = f"{within_s:.0f} s" if within_s < MINUTES_FROM_S else f"{within_s / 60:.0f} min"
        return self.finding.on_and_off(f"{len(self.came)} times in {within}")


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
            elif (state := self._states.get(finding.key)) and (state.raised_us or state.flapping_us):
                state.seen_us = state.found_us = now_us
        for key in [key for key, state in self._states.items() if state.found_us < now_us]:
            self._states[key].lower_us = 0
            events += self._gone(key, now_us)
        raised = [_alarm(state.finding, state.raised_us) for state in self._states.values() if state.raised_us]
        raised += [_alarm(state.flapping(), state.flapping_us) for state in self._states.values() if state.flapping_us]
        raised += self.texts.update(now_us)
        raised.sort(key=urgency)
        return tuple(raised), tuple(events)

    def _grows(self, key: str, count: int, now_us: int) -> bool:
        """Note a counter; whether it has grown lately."""
        # a count that is lower has started again, with the process that counts
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
        if not state.first_us:
            state.first_us = now_us
            state.coming |= now_us - state.seen_us >= BREAK_US
        last_us, state.seen_us = state.seen_us, now_us
        worst = rank(finding.rule.level) >= rank(before.rule.level) or now_us - state.worst_us > WORST_US
        if worst or not state.raised_us:
            state.finding, state.worst_us = finding, now_us
        lasted_us = now_us - state.first_us
        lasts = lasted_us >= finding.rule.lasts_s * 1e6
        if lasts and state.note_coming(now_us) and not state.flapping_us:
            events = _over(state.finding, last_us - state.raised_us, now_us) if state.raised_us else []
            state.raised_us, state.flapping_us = 0, now_us
            return events + _come(state.flapping(), now_us)
        if state.raised_us:
            return [] if state.finding.rule.level == before.rule.level else _come(finding, now_us)
        # a counter that grew once is found for a while
        stays_us = STAYS_US + (GROWING_US if finding.count is not None else 0)
        if not lasts or (state.flapping_us and lasted_us < stays_us):
            return []
        state.raised_us = now_us
        return _come(finding, now_us)

    def _gone(self, key: str, now_us: int) -> list[Event]:
        state = self._states[key]
        state.first_us = 0
        state.forget(now_us)
        events: list[Event] = []
        if state.raised_us and now_us - state.seen_us >= state.finding.rule.clears_after_s * 1e6:
            events += _over(state.finding, state.seen_us - state.raised_us, now_us)
            state.raised_us = 0
        if state.flapping_us and state.is_calm(now_us):
            events += _over(state.flapping(), state.seen_us - state.flapping_us, now_us)
            state.flapping_us = 0
        if not (state.raised_us or state.flapping_us or state.came) and now_us - state.seen_us > WORST_US:
            del self._states[key]
        return events


def _alarm(finding: Finding, since_us: int) -> Alarm:
    rule = finding.rule
    return Alarm(
        key=finding.key,
        level=rule.level,
        kind=rule.kind,
        text=finding.text,
        advice=rule.advice,
        since_us=since_us,
        system_id=finding.system_id,
        vehicles=finding.vehicles,
        doubts_name=rule.doubts_name,
    )


def _come(finding: Finding, now_us: int) -> list[Event]:
    return _logged(finding, now_us, finding.rule.level, finding.text)


def _over(finding: Finding, lasted_us: int, now_us: int) -> list[Event]:
    lasted_s = max(round(lasted_us * 1e-6), 1)  # what was reported was there
    return _logged(finding, now_us, "info", f"over after {lasted_s} s: {finding.text}", over=True)


def _logged(finding: Finding, t_us: int, level: Level, text: str, *, over: bool = False) -> list[Event]:
    """A line of the event log, or none where another module writes them."""
    rule = finding.rule
    if rule.logged_by:
        return []
    return [
        Event(
            t_us=t_us,
            level=level,
            kind=rule.kind,
            text=text,
            system_id=finding.system_id,
            alarm=finding.key,
            alarm_level=rule.level,
            over=over,
        )
    ]
