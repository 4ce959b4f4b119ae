"""Every rule on every screen of a flight."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from bench.screens.flights import Moment
from bench.screens.names import check_cut_names, check_fleet_standings, check_map_labels, check_video_labels
from bench.screens.screen import Screen
from bench.screens.station import shots
from bench.screens.values import (
    Clocks,
    check_ages,
    check_alarms,
    check_counts,
    check_faded,
    check_status,
    check_texts,
    clocks_of,
)

Rule = Callable[[Screen, Moment], Iterator[tuple[str, str]]]
RULES: tuple[Rule, ...] = (
    check_video_labels,
    check_map_labels,
    check_cut_names,
    check_fleet_standings,
    check_ages,
    check_faded,
    check_alarms,
    check_texts,
    check_counts,
    check_status,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Violation:
    """Something on a screen that is not so."""

    rule: str
    what: str


class Checker:
    """Checks the screens of one flight, in order."""

    def __init__(self) -> None:
        self._clocks: Clocks = {}

    def check(self, screen: Screen, moment: Moment) -> list[Violation]:
        """What is wrong on a screen."""
        found = [Violation(rule=rule, what=what) for check in RULES for rule, what in check(screen, moment)]
        clocks = clocks_of(screen)
        for name, shown in clocks.items():
            before = self._clocks.get(name, shown)
            if shown < before:
                found.append(Violation(rule="clock that goes back", what=f"{name} from {before:g} to {shown:g}"))
        self._clocks |= clocks
        return found


async def check_screens(moments: Sequence[Moment], size: tuple[int, int]) -> tuple[int, list[Violation]]:
    """How many screens a flight has, and what is wrong on them.

    Args:
        moments: of the flight, in order.
        size: columns and rows.
    """
    checker, screens, found = Checker(), 0, []
    async for shot in shots(moments, size):
        screens += 1
        found += checker.check(shot.screen, shot.moment)
    return screens, found
