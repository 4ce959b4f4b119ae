"""Alarms that say the same of several vehicles, put together: a lost link is not twenty rows."""

from __future__ import annotations

from collections.abc import Iterable

from gcs.findings import first_of
from gcs.snapshot import Alarm

__all__ = ["Group", "alike", "text_of"]

Group = tuple[Alarm, ...]
"""At least one; all of one level, kind and advice."""


def alike(alarms: Iterable[Alarm]) -> tuple[Group, ...]:
    """Groups in the order of their first alarm; what is of no vehicle stays alone."""
    groups: dict[tuple[str, ...], list[Alarm]] = {}
    for alarm in alarms:
        trouble = _trouble(alarm) if alarm.system_id else alarm.key
        groups.setdefault((alarm.level, alarm.kind, alarm.advice, trouble), []).append(alarm)
    return tuple(map(tuple, groups.values()))


def text_of(group: Group) -> str:
    """``UGV-1, UGV-2: no heartbeat``; with the first few names where there are many."""
    if len(group) == 1:
        return group[0].text
    names = [alarm.text.partition(": ")[0] for alarm in group]
    return f"{first_of(names)}: {_trouble(group[0])}"


def _trouble(alarm: Alarm) -> str:
    """What is said after the vehicle's name."""
    return alarm.text.partition(": ")[2] or alarm.key
