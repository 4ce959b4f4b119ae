"""All alarms, and which of them a snapshot shows. Pure."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

from gcs.health.alarm_rule import AlarmRule
from gcs.health.condition_alarms import CONDITION_RULES
from gcs.health.link_alarms import LINK_RULES
from gcs.health.proximity_alarms import PAIR_RULES, near_pairs
from gcs.health.station_alarms import STATION_RULES
from gcs.health.vehicle_alarms import VEHICLE_RULES
from gcs.snapshot import Snapshot

Rules = Iterable[AlarmRule[Any]]
AGAIN = "again and again:"
ON_AND_OFF = " on and off"
"""Ending of the key of an alarm that keeps coming back."""
_WORKED_OUT = frozenset(
    {
        *("unheard", "video", "video clock", "camera heading", "camera pitch", "camera mirrored"),
        *("no match", "match not known", "views differ"),
    }
)
"""Keys of the station's alarms that packets and frames alone raise."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """Result of one rule for one vehicle, for two, for one link, or for the station."""

    rule: AlarmRule[Any]
    key: str
    """Key of the alarm."""
    name: str
    """Owner of the alarm, with a colon behind, empty for the station's."""
    detail: str
    system_id: int = 0
    vehicles: tuple[int, ...] = ()
    """System ids of all that it is about, where it is not one vehicle's."""
    count: int | None = None
    """Value of a counter that should not grow; None: the rule's condition holds."""
    raises: bool = True
    """False: the condition does not hold, and an alarm that was raised before is kept all the same."""

    @property
    def text(self) -> str:
        """Words of a trouble: whose it is, and what."""
        return self.name + ": ".join(filter(None, (self.rule.text, self.detail)))

    def on_and_off(self, how_often: str) -> Finding:
        """The alarm that it is while it keeps coming back.

        What is well in between is a warning, unless something was lost or no name is to be acted on.
        """
        rule, detail = self.rule, self.detail if self.rule.each_detail else ""
        grave = rule.counter is not None or rule.doubts_name
        text = rule.on_and_off or f"{AGAIN} {rule.text}"
        return replace(
            self,
            rule=replace(rule, text=text, level=rule.level if grave else "warning"),
            key=self.key + ON_AND_OFF,
            detail=", ".join(filter(None, (detail, how_often))),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportedAlarm:
    """An alarm that an event reports."""

    rule: AlarmRule[Any]
    key: str
    """Key of the alarm, the same whenever it is reported; by its words alone, pairs have their names in it."""
    worked_out: bool
    """True if packets and frames alone raise it, so that a replay of a recording raises it again."""


def _tables(system_id: int) -> tuple[Rules, ...]:
    return (VEHICLE_RULES, CONDITION_RULES) if system_id else (STATION_RULES, LINK_RULES, PAIR_RULES)


def _is_worked_out(rule: AlarmRule[Any], rules: Rules, system_id: int) -> bool:
    return bool(system_id) or rules is PAIR_RULES or rule.key in _WORKED_OUT


@lru_cache(maxsize=4096)
def alarm_of_key(key: str, level: str, system_id: int) -> ReportedAlarm | None:
    """The alarm of a key and a level; None: this program has no such alarm."""
    whole = key.removesuffix(ON_AND_OFF)
    found = [
        (len(rule.key), rule.level == level, ReportedAlarm(rule=rule, key=key, worked_out=worked_out))
        for rules in _tables(system_id)
        for rule in rules
        if f"{whole} ".startswith(f"{rule.key} ")
        for worked_out in [_is_worked_out(rule, rules, system_id)]
    ]
    return max(found, key=lambda each: each[:2])[2] if found else None


@lru_cache(maxsize=4096)
def reported_alarm(text: str, kind: str, system_id: int) -> ReportedAlarm | None:
    """The alarm that an event of an older recording reports, by its words; None: no rule has these words."""
    best: tuple[int, ReportedAlarm] | None = None
    for rules in _tables(system_id):
        for rule in rules:
            whose, found, rest = text.rpartition(rule.text)
            if not found or rule.kind != kind or rule.logged_by or (rest and not rest.startswith(": ")):
                continue
            if (whose and not whose.endswith(": ")) or bool(whose) != (rules is not STATION_RULES):
                continue
            name = str(system_id) if system_id else whose.removesuffix(": ")
            detail = rest.removeprefix(": ") if rule.each_detail else ""
            key = " ".join(part for part in (rule.key, name, detail) if part)
            worked_out = _is_worked_out(rule, rules, system_id)
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
                name=name,
                detail=detail,
                system_id=system_id,
                vehicles=tuple(rule.vehicles(subject, now)) if rule.vehicles else (),
                count=count,
                raises=raises,
            )
