"""Reports of a flight itself, from its ``events.jsonl``, beside what a replay works out again.

Both are shown where they differ. An event of either counts as the other's when it says the same of the same vehicle at
about the same time; an alarm, when both have it at about the same time.
"""

from __future__ import annotations

import math
import re
from bisect import bisect_left
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from gcs.health.alarm_history import AlarmHistory, AlarmSpan
from gcs.health.alarm_rules import ReportedAlarm, alarm_of_key, reported_alarm
from gcs.health.alarms import rank, urgency
from gcs.health.station_alarms import CLOCK_STEP
from gcs.playback.opened_session import OpenedSession
from gcs.session.clock_steps import ClockSteps
from gcs.session.event_log import read_events
from gcs.snapshot import Alarm, Event
from infra.files.segment import segments
from infra.session_format import EVENTS

SAME_US: Final = 5_000_000
"""Greatest time between the same event in flight and in a replay without the flight's order of packets and frames."""
WORKED_OUT: Final = frozenset({"vehicle", "identity", "camera", "text"})
"""Kinds of events that a replay works out again; the others tell of links, disks and people."""
HELD_S: Final = 50
"""Longest time from an alarm's last sign to its end; its event says how long it lasted until that."""
MAX_EVENTS: Final = 20_000
OUTSIDE_US: Final = 86_400_000_000
"""Distance from all packets and frames beyond which events are from a clock that was wrong."""
_NEVER_US: Final = 1 << 62
_OVER: Final = re.compile(r"over after (\d+) s: (.*)")
_SEEN: Final = "seen: "
_SURE: Final = re.compile(r" \(\d+%\)")


@dataclass(slots=True)
class FlownAlarm:
    """An alarm that the flight showed."""

    alarm: Alarm
    until_us: int
    worked_out: bool = True
    """True if a replay can find it at all."""


class FlownReports:
    """Events and alarms as the flight had them, and as they are worked out again.

    Args:
        events: as recorded, empty where nothing was.
        start_us: first packet or frame, or begin of the flight.
        stop_us: last one, or its end.

    Attributes:
        start_us, stop_us: the same, and the first and last of the events.
    """

    def __init__(self, events: Sequence[Event], start_us: int, stop_us: int) -> None:
        near = (event for event in events if start_us - OUTSIDE_US <= event.t_us <= stop_us + OUTSIDE_US)
        self._flown = sorted(near, key=lambda event: event.t_us)[-MAX_EVENTS:]
        self._has_keys = any(event.alarm_level for event in self._flown)
        """False: an older recording, of whose alarms there are only the words."""
        flown_us = [event.t_us for event in self._flown]
        self.start_us, self.stop_us = min(start_us, *flown_us[:1], start_us), max(stop_us, *flown_us[-1:], stop_us)
        self._unmatched: dict[tuple[str, int, str], list[int]] = {}
        for index, event in enumerate(self._flown):
            self._unmatched.setdefault(self._gist(event), []).append(index)
        self._matched: set[int] = set()
        self._now: list[Event] = []
        alarms_of = _alarms if self._has_keys else _alarms_by_words
        self._alarms = alarms_of(self._flown, self.stop_us + 1)
        self._seen = [event for event in self._flown if event.kind == "operator" and event.text.startswith(_SEEN)]
        self._found = AlarmHistory()
        self._found_at: dict[str, list[AlarmSpan]] = {}
        """Times at which a replay has an alarm, by its key."""
        self._worked_out_us = 0.0
        self._shown: tuple[Event, ...] | None = None

    @classmethod
    def read(
        cls, recording: Path, start_us: int, stop_us: int, steps: ClockSteps | None = None
    ) -> tuple[FlownReports, str]:
        """Read all segments of ``events.jsonl``; also what could not be read, in words, empty when all could.

        Args:
            recording: a session's folder; a bare log has no events, whatever lies beside it.
            start_us: see the class.
            stop_us: see the class.
            steps: when the clock was set that stamped them.
        """
        events: list[Event] = []
        lost, trouble = 0, ""
        for part in segments(recording / EVENTS) if recording.is_dir() else ():
            try:
                more, skipped = read_events(part)
            except OSError as error:
                trouble = f"{part.name} cannot be read: {error.strerror}"
                continue
            events += more
            lost += skipped
        if steps:
            is_step = np.array([event.alarm == CLOCK_STEP for event in events], dtype=np.bool_)
            stamped_us = np.array([event.t_us for event in events], dtype=np.int64)
            t_us = steps.correct_events(stamped_us, is_step).tolist()
            events = [replace(event, t_us=at_us) for event, at_us in zip(events, t_us, strict=True)]
        if lost and not trouble:
            trouble = f"{EVENTS}: {lost} lines could not be read and were skipped"
        return cls(events, start_us, stop_us), trouble

    @classmethod
    def of(cls, opened: OpenedSession) -> tuple[FlownReports, str]:
        """Read those of an opened session: see ``read``."""
        known_us = opened.known_us
        return cls.read(opened.session.path, int(known_us.min()), int(known_us.max()), opened.log.steps)

    @property
    def flown(self) -> Sequence[Event]:
        """Events that the flight reported, in order of time."""
        return self._flown

    def add(self, t_us: int, events: Iterable[Event], alarms: Iterable[Alarm]) -> None:
        """Take in what a replay finds at its next moment."""
        for event in events:
            self._add_event(event)
        known = len(self._found.spans)
        self._found.add(t_us, alarms)
        for span in self._found.spans[known:]:
            self._found_at.setdefault(self._key(span.alarm), []).append(span)
        if t_us // SAME_US != self._worked_out_us // SAME_US:
            self._shown = None
        self._worked_out_us = max(t_us, self._worked_out_us)

    def finish(self) -> None:
        """Note that all of the recording is worked out."""
        self._shown, self._worked_out_us = None, math.inf

    def _add_event(self, event: Event) -> None:
        self._shown = None
        same = self._unmatched.get(self._gist(event), [])
        near = [index for index in same if abs(self._flown[index].t_us - event.t_us) <= SAME_US]
        if near:
            index = min(near, key=lambda index: abs(self._flown[index].t_us - event.t_us))
            same.remove(index)
            self._matched.add(index)
            return
        differs = bool(self._flown) and event.kind in WORKED_OUT
        self._now.append(replace(event, reported="now") if differs else event)
        del self._now[:-MAX_EVENTS]

    def events(self) -> tuple[Event, ...]:
        """Events that the flight reported, and what is worked out besides; in order of time."""
        if self._shown is None:
            passed_us = self._worked_out_us - SAME_US
            then = (
                replace(event, reported="then")
                if event.kind in WORKED_OUT and event.t_us < passed_us and index not in self._matched
                else event
                for index, event in enumerate(self._flown)
            )
            self._shown = tuple(sorted((*then, *self._now), key=lambda event: event.t_us))
        return self._shown

    def alarms(self, t_us: int, found: Sequence[Alarm]) -> tuple[Alarm, ...]:
        """Alarms on at a moment, the worst and newest first; where flight and replay differ, each says whose it is."""
        if not self._flown:
            return tuple(found)
        on = [flown for flown in self._alarms if flown.alarm.since_us <= t_us < flown.until_us]
        keys = set(map(self._key, found))
        shown = [self._compared(alarm, t_us) for alarm in found]
        shown += [self._as_flown(flown, t_us) for flown in on if flown.alarm.key not in keys]
        return tuple(sorted(shown, key=urgency))

    def spans(self) -> list[AlarmSpan]:
        """Every alarm of the flight and every one that only its replay raises, each once, in order of their coming.

        One that both have lasts from the first sign of it in either to the last, or until the flight raised it again.
        """
        spans, left = list[AlarmSpan](), {key: list(found) for key, found in self._found_at.items()}
        flown = _without_levels(self._alarms)
        ends = dict[str, int]()
        for one, next_us in zip(flown, _next_of_its_key(flown), strict=True):
            alarm, until_us = self._as_flown(one, one.alarm.since_us), one.until_us
            for found in list(left.get(alarm.key, ())):
                if not (found.alarm.since_us <= until_us + SAME_US and alarm.since_us <= found.until_us + SAME_US):
                    continue
                if found.until_us <= next_us:
                    left[alarm.key].remove(found)
                # where the flight's ended between, the replay's is two
                since_us = min(alarm.since_us, max(found.alarm.since_us, ends.get(alarm.key, 0)))
                alarm = replace(alarm, since_us=since_us, reported="")
                until_us = min(max(until_us, found.until_us), next_us)
            ends[alarm.key] = until_us
            spans.append(AlarmSpan(alarm=alarm, until_us=until_us))
        for found in (each for others in left.values() for each in others):
            alarm = self._compared(found.alarm, found.until_us) if self._flown else found.alarm
            # under a clock that was set ahead it is dated later than it is seen
            alarm = replace(alarm, since_us=min(alarm.since_us, found.until_us))
            spans.append(AlarmSpan(alarm=alarm, until_us=found.until_us))
        return sorted(spans, key=lambda span: (span.alarm.since_us, span.alarm.key))

    def _compared(self, alarm: Alarm, t_us: int) -> Alarm:
        """An alarm of the replay beside the flight's."""
        key = self._key(alarm)
        both = any(
            flown.alarm.key == key and _is_about(t_us, flown.alarm.since_us, flown.until_us) for flown in self._alarms
        )
        known = alarm_of_key(alarm.key, alarm.level, alarm.system_id)
        # an alarm whose lines another module writes is none by its key in the flight's log
        differs = not both and known is not None and not known.rule.logged_by
        return replace(alarm, acknowledged=self._was_seen(alarm, t_us), reported="now" if differs else "")

    def _as_flown(self, flown: FlownAlarm, t_us: int) -> Alarm:
        """An alarm of the flight that the replay does not have at the moment."""
        known = flown.worked_out and self._worked_out_us > t_us + SAME_US
        found = self._found_at.get(flown.alarm.key, ())
        differs = known and not any(_is_about(t_us, span.alarm.since_us, span.until_us) for span in found)
        seen = self._was_seen(flown.alarm, t_us)
        return replace(flown.alarm, acknowledged=seen, reported="then" if differs else "")

    def _key(self, alarm: Alarm) -> str:
        """Key that an alarm of the flight and one of the replay have in common."""
        if self._has_keys:
            return alarm.key
        known = reported_alarm(alarm.text, alarm.kind, alarm.system_id)
        return known.key if known else alarm.key

    def _gist(self, event: Event) -> tuple[str, int, str]:
        """Text of an event, without how sure it is, or how often or how long an alarm was on."""
        text = event.text
        if event.alarm_level and self._has_keys:
            return event.kind, event.system_id, f"{event.alarm} {event.alarm_level} {event.over}"
        if event.kind == "text":
            text = text.partition(" says: ")[2] or text
        return event.kind, event.system_id, _SURE.sub("", text)

    def _was_seen(self, alarm: Alarm, t_us: int) -> bool:
        """Tell whether the operator had acknowledged it."""
        return any(
            alarm.since_us - SAME_US <= event.t_us <= t_us
            and (event.acknowledges == alarm.key or event.text == _SEEN + alarm.text)
            for event in self._seen
        )


def _is_about(t_us: int, since_us: int, until_us: int) -> bool:
    """Tell whether a moment lies within a time, or about."""
    return since_us - SAME_US <= t_us <= until_us + SAME_US


def _alarms(events: Sequence[Event], end_us: int) -> list[FlownAlarm]:
    """Alarms by the events that tell of their coming and going; others of their level are events alone."""
    alarms: list[FlownAlarm] = []
    on: dict[str, FlownAlarm] = {}
    for event in events:
        if not event.alarm_level:
            continue
        if event.alarm in on:
            on.pop(event.alarm).until_us = event.t_us
        if not event.over:
            on[event.alarm] = _flown(event, alarm_of_key(event.alarm, event.alarm_level, event.system_id), end_us)
            alarms.append(on[event.alarm])
    return alarms


def _alarms_by_words(events: Sequence[Event], end_us: int) -> list[FlownAlarm]:
    """Return the alarms of an older recording, whose events do not say of which alarm they are."""
    alarms: list[FlownAlarm] = []
    on: dict[str, FlownAlarm] = {}
    over_at: dict[tuple[str, int, str], list[int]] = {}
    for index, event in enumerate(events):
        if match := _OVER.fullmatch(event.text):
            over_at.setdefault((event.kind, event.system_id, match[2]), []).append(index)
    for index, event in enumerate(events):
        if match := _OVER.fullmatch(event.text):
            if key := _key_of_over(on, event, match[2], int(match[1])):
                on.pop(key).until_us = event.t_us
            continue
        if event.level == "info":
            continue
        known = reported_alarm(event.text, event.kind, event.system_id)
        ends = over_at.get((event.kind, event.system_id, event.text), [])
        if known is None and bisect_left(ends, index) == len(ends):
            continue
        flown = _flown(event, known, end_us)
        if flown.alarm.key in on:
            on.pop(flown.alarm.key).until_us = event.t_us
        on[flown.alarm.key] = flown
        alarms.append(flown)
    return alarms


def _without_levels(alarms: Iterable[FlownAlarm]) -> list[FlownAlarm]:
    """Join alarms, each of which stays the same one when its level changes."""
    joined: list[FlownAlarm] = []
    last: dict[str, FlownAlarm] = {}
    for flown in alarms:
        before = last.get(flown.alarm.key)
        if before and before.until_us == flown.alarm.since_us and before.alarm.level != flown.alarm.level:
            worst = max(before.alarm, flown.alarm, key=lambda alarm: rank(alarm.level))
            before.alarm, before.until_us = replace(worst, since_us=before.alarm.since_us), flown.until_us
        else:
            last[flown.alarm.key] = replace(flown)
            joined.append(last[flown.alarm.key])
    return joined


def _next_of_its_key(alarms: Sequence[FlownAlarm]) -> list[int]:
    """Times at which each is raised again, Unix µs; the end of time where it is not."""
    raised, later = list[int](), dict[str, int]()
    for flown in reversed(alarms):
        raised.append(later.get(flown.alarm.key, _NEVER_US))
        later[flown.alarm.key] = flown.alarm.since_us
    return raised[::-1]


def _key_of_over(on: dict[str, FlownAlarm], event: Event, text: str, lasted_s: int) -> str:
    """The alarm that is over, empty for none of those that are on.

    Its words may have changed since it came: then what it is about decides, or when it must have come.
    """
    alike = {
        key: flown.alarm
        for key, flown in on.items()
        if (flown.alarm.kind, flown.alarm.system_id) == (event.kind, event.system_id)
    }
    for key, alarm in alike.items():
        if alarm.text == text:
            return key
    known = reported_alarm(text, event.kind, event.system_id)
    if known is not None and known.key in alike:
        return known.key
    came_s = {key: (event.t_us - alarm.since_us) * 1e-6 - lasted_s for key, alarm in alike.items()}
    return min((key for key, held_s in came_s.items() if -1.0 <= held_s <= HELD_S), key=came_s.__getitem__, default="")


def _flown(event: Event, known: ReportedAlarm | None, end_us: int) -> FlownAlarm:
    """An alarm by the event of its coming; known: its rule, None where this program has none of that kind."""
    alarm = Alarm(
        key=event.alarm or (known.key if known else event.text),
        level=event.level,
        kind=event.kind,
        text=event.text,
        advice=known.rule.advice if known else "",
        since_us=event.t_us,
        system_id=event.system_id,
        doubts_name=known is not None and known.rule.doubts_name,
    )
    return FlownAlarm(alarm=alarm, until_us=end_us, worked_out=known is not None and known.worked_out)
