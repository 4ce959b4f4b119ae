"""Alarms that belong together on one row: a lost link is not twenty rows, a vehicle in trouble is not five."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from gcs.health.station_alarms import first_of
from gcs.snapshot import Alarm
from gcs.tui.draw.format import REPORTED_WORDS

__all__ = ["Group", "advice_of", "alike", "text_of"]

Group = tuple[Alarm, ...]
"""At least one, the worst first: the same of several vehicles, or several troubles of one."""


def alike(alarms: Iterable[Alarm]) -> tuple[Group, ...]:
    """What several vehicles have alike is one group, all else of one vehicle another; in order of their first alarm."""
    alarms = tuple(alarms)
    shared: dict[tuple[str, ...], list[Alarm]] = {}
    for alarm in alarms:
        shared.setdefault(_what(alarm), []).append(alarm)
    groups: dict[object, list[Alarm]] = {}
    for alarm in alarms:
        several = len(shared[_what(alarm)]) > 1 or not alarm.system_id
        own = (
            alarm.system_id,
            alarm.kind == "text",
            alarm.reported,
        )  # its own words are not among what was found out about it
        groups.setdefault(_what(alarm) if several else own, []).append(alarm)
    return tuple(map(tuple, groups.values()))


def text_of(group: Group) -> str:
    """``UGV-1, UGV-2: no heartbeat`` with the first few names where there are many; ``UGV-1: this; that``."""
    if group[0].reported:
        return REPORTED_WORDS[group[0].reported] + text_of(tuple(replace(alarm, reported="") for alarm in group))
    if len(group) == 1:
        return group[0].text
    names = dict.fromkeys(_parts(alarm)[0] for alarm in group)
    troubles = dict.fromkeys(_trouble(alarm) for alarm in group)
    says = " says" if group[0].kind == "text" else ""
    return f"{first_of(list(names))}{says}: {'; '.join(troubles)}"


def advice_of(group: Group) -> str:
    """What to do about each of its troubles, the worst first."""
    return "; ".join(dict.fromkeys(alarm.advice for alarm in group))


def _what(alarm: Alarm) -> tuple[str, ...]:
    return alarm.level, alarm.kind, alarm.advice, alarm.reported, _trouble(alarm) if alarm.system_id else alarm.key


def _trouble(alarm: Alarm) -> str:
    """The text after the vehicle's name."""
    return _parts(alarm)[1] or alarm.key


def _parts(alarm: Alarm) -> tuple[str, str]:
    """Whose alarm it is, and what."""
    whose, _, what = alarm.text.partition(" says: " if alarm.kind == "text" else ": ")
    return whose, what
