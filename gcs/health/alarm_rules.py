"""All alarms, and which of them a snapshot shows. Pure."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

from gcs.health.alarm_rule import AlarmRule
from gcs.health.condition_alarms import CONDITION_RULES
from gcs.health.link_alarms import LINK_RULES
from gcs.health.proximity_alarms import PAIR_RULES, near_pairs
from gcs.health.station_alarms import STATION_RULES
from gcs.health.vehicle_alarms import VEHICLE_RULES
from gcs.snapshot import Snapshot

__all__ = ["Finding", "findings"]

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
