"""All alarms, and which of them a snapshot shows. Pure."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from gcs.health.alarm_rule import AlarmRule
from gcs.health.condition_alarms import CONDITION_RULES
from gcs.health.link_alarms import LINK_RULES
from gcs.health.proximity_alarms import PAIR_RULES, near_pairs
from gcs.health.station_alarms import STATION_RULES
from gcs.health.vehicle_alarms import VEHICLE_RULES
from gcs.snapshot import Snapshot

__all__ = ["Finding", "ReportedAlarm", "findings", "reported_alarm"]

Rules = Iterable[AlarmRule[Any]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """What one rule finds for one vehicle, for two, for one link, or for the station."""

    rule: AlarmRule[Any]
    key: str
    """Of the alarm."""
    text: str
    system_id: int = 0
    count: int | None = None
    """Of a counter that should not grow; None: the rule's condition holds."""
    raises: bool = True
    """False: the condition does not hold, and an alarm that was raised before is kept all the same."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportedAlarm:
    """An alarm that an event reports."""

    rule: AlarmRule[Any]
    key: str
    """The same whenever it is reported; that of the alarm, but of pairs by their names."""
    worked_out: bool
    """Whether packets and frames alone raise it: then a recording raises it again."""


_WORKED_OUT = frozenset(
    {"unheard", "video", "video clock", "camera heading", "camera pitch", "camera mirrored", "no match"}
)
"""Of the station's alarms."""


@lru_cache(maxsize=4096)
def reported_alarm(text: str, kind: str, system_id: int) -> ReportedAlarm | None:
    """The alarm that such an event reports; None: this program words none like that, or logs it elsewhere."""
    best: tuple[int, ReportedAlarm] | None = None
    tables: tuple[Rules, ...] = (
        (VEHICLE_RULES, CONDITION_RULES) if system_id else (STATION_RULES, LINK_RULES, PAIR_RULES)
    )
    for rules in tables:
        for rule in rules:
            whose, found, rest = text.rpartition(rule.text)
            if not found or rule.kind != kind or rule.logged_by or (rest and not rest.startswith(": ")):
                continue
            if (whose and not whose.endswith(": ")) or bool(whose) != (rules is not STATION_RULES):
                continue
            name = str(system_id) if system_id else whose.removesuffix(": ")
            detail = rest.removeprefix(": ") if rule.each_detail else ""
            key = " ".join(part for part in (rule.key, name, detail) if part)
            worked_out = bool(system_id) or rules is PAIR_RULES or rule.key in _WORKED_OUT
            if best is None or len(rule.text) > best[0]:
                best = len(rule.text), ReportedAlarm(rule=rule, key=key, worked_out=worked_out)
    return best[1] if best else None


def findings(snapshot: Snapshot) -> Iterator[Finding]:
    """All that is wrong now or worth keeping, and every counter that is not at zero."""
    for row in snapshot.vehicles:
        whose, name = f" {row.system_id}", f"{row.name}: "
        yield from _findings((*VEHICLE_RULES, *CONDITION_RULES), row, snapshot, whose, name, row.system_id)
    for pair in near_pairs(snapshot):
        yield from _findings(PAIR_RULES, pair, snapshot, f" {pair.key}", f"{pair.names}: ")
    for link in snapshot.health.links:
        yield from _findings(LINK_RULES, link, snapshot, f" {link.name}", f"{link.name}: ")
    yield from _findings(STATION_RULES, snapshot.health, snapshot)


def _findings(
    rules: Rules, subject: object, now: Snapshot, whose: str = "", name: str = "", system_id: int = 0
) -> Iterator[Finding]:
    for rule in rules:
        count = rule.counter(subject, now) if rule.counter else None
        raises = bool(count) or bool(rule.condition and rule.condition(subject, now))
        if raises or (rule.kept_while and rule.kept_while(subject, now)):
            detail = rule.detail(subject, now) if rule.detail else ""
            yield Finding(
                rule=rule,
                key=f"{rule.key}{whose} {detail}" if rule.each_detail else f"{rule.key}{whose}",
                text=f"{name}{rule.text}: {detail}" if detail else f"{name}{rule.text}",
                system_id=system_id,
                count=count,
                raises=raises,
            )
