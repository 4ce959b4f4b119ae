"""Events as rows of the log: those that were searched for, and a vehicle's chatter folded into one row. Pure."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import groupby
from typing import Final

from gcs.snapshot import Event

CHATTER: Final = "text"
"""The kind of events that vehicles word themselves: of these alone a run is folded."""
WAYPOINT: Final = "waypoint"
REACHED: Final = re.compile(r"reached waypoint #(\d{1,6})(?:–(\d{1,6}))?", re.IGNORECASE)
MAX_ON_THEIR_WAY: Final = 4
"""Vehicles that have a row each for their waypoints."""
GONE: Final = re.compile(r"track \d+ is no longer (?P<name>.+?): (?P<why>.+)")
GIVEN: Final = re.compile(r"track \d+ is (?P<name>.+) \(\d+%\)")
TOGETHER: Final = 3
"""Names that are gone, or that are given, in one frame and are one row."""
NUMBER: Final = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?|\d+(?:\.\d+)?")


@dataclass(frozen=True, slots=True)
class EventRow:
    """One row."""

    event: Event
    """The newest of those that it stands for; its text has the numbers of all: ``reached waypoint 1–12``."""
    times: int
    """Number of events; 1 where the text tells of how many vehicles they are."""
    routine: bool = False
    """True if it tells what goes on all the time, and of the whole fleet."""


def found_events(events: Iterable[Event], query: str, names: Mapping[int, str]) -> list[Event]:
    """Events that have every word of a query in their kind, level, text or vehicle's name, in any case of letters.

    A word that is a vehicle's name finds that vehicle alone: ``UGV-1`` does not find UGV-11.

    Args:
        events: to search.
        query: words with spaces between.
        names: of vehicles, by system id.
    """
    wanted = [_Word(word, names) for word in query.casefold().split()]
    return [event for event in events if all(word.is_in(event, names) for word in wanted)]


class _Word:
    def __init__(self, word: str, names: Mapping[int, str]) -> None:
        self._word = word
        self._vehicles = {system_id for system_id, name in names.items() if name.casefold() == word}
        self._whole = re.compile(rf"(?<!\w){re.escape(word)}(?!\w)")

    def is_in(self, event: Event, names: Mapping[int, str]) -> bool:
        text = f"{event.kind} {event.level} {names.get(event.system_id, '')} {event.text}".casefold()
        if self._vehicles:
            return event.system_id in self._vehicles or self._whole.search(text) is not None
        return self._word in text


def rows_of(events: Sequence[Event]) -> list[EventRow]:
    """One row for a run of equal events, and one for a vehicle's texts that differ in numbers only.

    Texts of other vehicles may lie within such a run, which stands at its newest event; another event of the same
    vehicle ends it, but for waypoints, which are one row of all where more than ``MAX_ON_THEIR_WAY`` vehicles reached
    some. Alarms are never folded into other alarms: only equal ones, one after the other, are counted.
    """
    runs: list[_EventRun | None] = []
    latest: dict[object, int] = {}
    """Index of each vehicle's latest run, and of its latest about waypoints."""
    for event in events:
        whose: object = (event.system_id, WAYPOINT) if _is_on_its_way(event) else event.system_id
        before = latest.get(whose, -1) if _is_chatter(event) else len(runs) - 1
        run = runs[before] if before >= 0 else None
        if run is not None and run.takes(event):
            runs[before] = None
        else:
            run = _EventRun(event)
        latest[whose] = len(runs)
        runs.append(run)
    return _in_one_frame(_as_a_fleet([run.row for run in runs if run is not None]))


def _as_a_fleet(rows: list[EventRow]) -> list[EventRow]:
    """Return the rows with one, the newest, in place of those in which many vehicles reached waypoints."""
    reached = [row for row in rows if _is_on_its_way(row.event) and REACHED.search(row.event.text)]
    reached = [row for row in reached if row.event.level == "info" and not row.event.reported]
    vehicles = {row.event.system_id for row in reached}
    if len(vehicles) <= MAX_ON_THEIR_WAY:
        return rows
    numbers = [int(n) for row in reached for match in REACHED.finditer(row.event.text) for n in match.groups() if n]
    least, most = min(numbers), max(numbers)
    span = f"s {least}–{most}" if least < most else f" {least}"
    event = replace(
        reached[-1].event, system_id=0, kind="vehicle", text=f"{len(vehicles)} vehicles reached {WAYPOINT}{span}"
    )
    whole, folded = EventRow(event, 1, routine=True), set(map(id, reached[:-1]))
    return [whole if row is reached[-1] else row for row in rows if id(row) not in folded]


def _in_one_frame(rows: list[EventRow]) -> list[EventRow]:
    """The same with one row in place of those of names that went, or came, in one frame and for one reason."""
    found: list[EventRow] = []
    for change, group in groupby(rows, _change):
        alike = list(group)
        if change is None or len(alike) < TOGETHER:
            found += alike
            continue
        names = ", ".join(match["name"] for row in alike if (match := _name_change(row.event.text)))
        event = replace(alike[0].event, system_id=0, text=f"{len(alike)} {change[1]}: {names}")
        found.append(EventRow(event, 1))
    return found


def _change(row: EventRow) -> tuple[int, str] | None:
    """Frame and words of a name that came or went; None of any other event."""
    event, match = row.event, _name_change(row.event.text)
    if match is None or row.times > 1 or (event.kind, event.level, event.reported) != ("identity", "info", ""):
        return None
    return event.t_us, f"names gone, {match['why']}" if match.re is GONE else "named"


def _name_change(text: str) -> re.Match[str] | None:
    return GONE.fullmatch(text) or GIVEN.fullmatch(text)


def _is_on_its_way(event: Event) -> bool:
    """Tell whether a vehicle says which waypoint it is at: one row for all of that, whatever else happens meanwhile."""
    return _is_chatter(event) and WAYPOINT in event.text.casefold()


def _is_chatter(event: Event) -> bool:
    return event.kind == CHATTER and event.level != "alarm" and event.system_id > 0


Numbers = tuple[tuple[float, str], ...]
"""Numbers in a text in order, each with its letters."""


@lru_cache(maxsize=4096)
def _template(text: str) -> tuple[str, Numbers]:
    """A text with its numbers left out, and these."""
    return NUMBER.sub("\0", text), tuple((float(number), number) for number in NUMBER.findall(text))


class _EventRun:
    """Events that become one row."""

    def __init__(self, event: Event) -> None:
        self._event, self._times = event, 1
        self._key = (event.system_id, event.kind, event.level, event.reported)
        self._template, numbers = _template(event.text) if _is_chatter(event) else ("", ())
        self._least: Numbers = numbers
        self._most: Numbers = numbers

    def takes(self, event: Event) -> bool:
        """Add an event if it belongs to this run; whether it does."""
        if self._key != (event.system_id, event.kind, event.level, event.reported):
            return False
        if self._event.text != event.text:
            template, numbers = _template(event.text) if self._template else ("", ())
            if not template or template != self._template:
                return False
            self._least = tuple(map(min, self._least, numbers))
            self._most = tuple(map(max, self._most, numbers))
        self._event, self._times = event, self._times + 1
        return True

    @property
    def row(self) -> EventRow:
        if self._least == self._most:
            return EventRow(self._event, self._times)
        text = self._template
        for (_, least), (_, most) in zip(self._least, self._most, strict=True):
            text = text.replace("\0", least if least == most else f"{least}–{most}", 1)
        return EventRow(replace(self._event, text=text), self._times)
