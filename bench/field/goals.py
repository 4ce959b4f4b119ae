"""What the product is to reach on every family."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from bench.field.families import FAMILIES, UNRELATED
from bench.field.summary import NAN, Outcome, Summary, summarise

ALL = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class Goal:
    """A bound on one measure of one version of a family, for all or some of its kinds of session."""

    family: int
    """``ALL``: the sum of all families."""
    hard: bool
    measure: str
    limit: float
    only: tuple[str, ...] = ()
    without: tuple[str, ...] = ()

    @property
    def at_most(self) -> bool:
        """Whether less is better."""
        return self.measure in _AT_MOST


@dataclass(frozen=True, slots=True, kw_only=True)
class GoalResult:
    """A goal and what was reached; NaN where it could not be measured."""

    goal: Goal
    value: float

    @property
    def met(self) -> bool | None:
        """None: not measured."""
        if np.isnan(self.value):
            return None
        return self.value <= self.goal.limit if self.goal.at_most else self.value >= self.goal.limit

    def text(self) -> str:
        """``right 98.71 < 99.2`` and the like."""
        sign = {True: "≤", False: "≥"}[self.goal.at_most] if self.met else {True: ">", False: "<"}[self.goal.at_most]
        digits = 3 if self.goal.measure == "ECE" else 2
        where = f" ({', '.join(self.goal.only)})" if self.goal.only else ""
        return f"{self.goal.measure}{where} {self.value:.{digits}f} {sign} {self.goal.limit:g}"


_AT_MOST = (
    *("false strangers", "first p90 s", "wrong ≥ 0.9 s", "wrong ≥ 0.9 s in all", "ECE", "p95 ms", "mismatch alarm s"),
)
_MEASURES: dict[str, Callable[[Summary], float]] = {
    "precision": lambda s: s.precision,
    "right": lambda s: s.right,
    "FPER": lambda s: s.fper,
    "false strangers": lambda s: s.false_strangers,
    "first p90 s": lambda s: s.first_p90_s,
    "wrong ≥ 0.9 s": lambda s: s.wrong_sure_worst_s,
    "wrong ≥ 0.9 s in all": lambda s: s.wrong_sure_s,
    "ECE": lambda s: s.ece,
}


def judge(goal: Goal, outcomes: Sequence[Outcome]) -> GoalResult:
    """Measure one goal on the sessions of a run."""
    mine = [o for o in outcomes if goal.family in (ALL, o.family) and o.hard == goal.hard]
    if goal.family == ALL and {o.family for o in mine} != set(FAMILIES):
        return GoalResult(goal=goal, value=NAN)
    mine = [o for o in mine if o.label not in goal.without and (not goal.only or o.label in goal.only)]
    if not mine:
        return GoalResult(goal=goal, value=NAN)
    if goal.measure == "p95 ms":
        large = [o.cpu_ms for o in mine if o.vehicles >= 50]
        return GoalResult(goal=goal, value=float(np.percentile(np.concatenate(large), 95)) if large else NAN)
    if goal.measure == "mismatch alarm s":
        return GoalResult(goal=goal, value=max(o.mismatch_s for o in mine))
    if goal.measure == "spoof flagged":
        spoofs = [o for o in mine if o.spoofed]
        return GoalResult(
            goal=goal, value=float(np.mean([bool(o.spoofed & o.accused) for o in spoofs])) if spoofs else NAN
        )
    return GoalResult(goal=goal, value=_MEASURES[goal.measure](summarise([o.product for o in mine])))


_GRID = {(9, True): ("grid 4 m",)}
"""Beyond what positions can distinguish: it has goals of its own."""


def _bounds(hard: bool, rows: dict[int, tuple[float, ...]]) -> list[Goal]:
    names = ("precision", "right", "FPER")
    apart = _GRID | {(14, True): ("fixed",)}
    return [
        Goal(family=family, hard=hard, measure=name, limit=limit, without=apart.get((family, hard), ()))
        for family, limits in rows.items()
        for name, limit in zip(names, limits, strict=False)
        if not math.isnan(limit)
    ]


_STANDARD = {
    1: (99.95, 99.5), 2: (99.95, 99.7), 3: (99.9, 99.0), 4: (99.95, 99.2), 5: (99.95, 98.5), 6: (99.9, 99.2, 99.9),
    7: (99.95, 99.0), 8: (99.95, 99.0), 9: (99.9, 99.2), 10: (99.95, 99.5), 11: (99.95, 99.2), 12: (99.95, 99.4),
    13: (99.95, 99.0), 14: (99.95, 99.0), 16: (99.95, 97.0), 17: (99.95, 99.0, 99.9), 18: (math.nan, math.nan, 99.9),
    19: (99.9, 97.0), 20: (99.8, 99.0), 21: (99.9, 98.0), 22: (99.95, 99.5), 23: (99.9, 99.0),
    24: (99.7, 96.0), 25: (99.7, 97.0), 26: (99.7, 97.0), 27: (99.7,), 28: (99.9,),
}  # fmt: skip
_HARD = {
    1: (99.9, 97.0, 99.9), 2: (99.5, 98.5), 3: (99.0, 96.0), 4: (99.95, 99.0), 5: (99.9, 98.5), 6: (99.9, 99.5, 99.9),
    7: (99.9, 98.5), 8: (99.5, 98.0, 97.0), 9: (98.5, 97.0), 10: (99.95, 99.0), 11: (99.9, 99.2, 99.5),
    12: (99.9, 98.0), 13: (99.9, 97.0), 14: (99.9, 99.4), 16: (99.8, 95.0), 17: (99.8, 97.0, 99.5),
    18: (math.nan, math.nan, 99.9), 19: (99.5, 90.0), 20: (99.8, 95.0), 21: (99.5, 95.0, 99.0), 22: (99.9, 98.0),
    23: (99.9, 97.0), 24: (99.7, 96.0), 25: (99.7, 97.0), 26: (99.7, 97.0), 27: (99.7,), 28: (99.9,),
}  # fmt: skip

GOALS: tuple[Goal, ...] = (
    *_bounds(False, _STANDARD),
    *_bounds(True, _HARD),
    Goal(family=1, hard=False, measure="first p90 s", limit=0.5),
    Goal(family=1, hard=False, measure="wrong ≥ 0.9 s", limit=0.0),
    Goal(family=11, hard=False, measure="p95 ms", limit=50.0),
    Goal(family=13, hard=False, measure="spoof flagged", limit=1.0),
    Goal(family=3, hard=True, measure="wrong ≥ 0.9 s", limit=1.0),
    Goal(family=9, hard=True, measure="wrong ≥ 0.9 s", limit=0.5),
    Goal(family=9, hard=True, measure="right", limit=82.0, only=("grid 4 m",)),
    Goal(family=9, hard=True, measure="ECE", limit=0.05, only=("grid 4 m",)),
    Goal(family=13, hard=True, measure="wrong ≥ 0.9 s", limit=0.0),
    Goal(family=14, hard=True, measure="wrong ≥ 0.9 s", limit=0.0, only=("fixed",)),
    *(Goal(family=28, hard=h, measure="first p90 s", limit=15.0) for h in (False, True)),
    *(Goal(family=28, hard=h, measure="wrong ≥ 0.9 s", limit=0.1) for h in (False, True)),
    *(
        Goal(family=f, hard=h, measure="ECE", limit=0.01, without=_GRID.get((f, h), ()))
        for f in range(1, 15)
        for h in (False, True)
    ),
    *(Goal(family=f, hard=h, measure="ECE", limit=0.05) for f in FAMILIES if f > 14 for h in (False, True)),
    *(Goal(family=f, hard=h, measure="false strangers", limit=1.0) for f in FAMILIES for h in (False, True)),
    *(Goal(family=UNRELATED, hard=h, measure="mismatch alarm s", limit=10.0) for h in (False, True)),
    *(
        Goal(family=ALL, hard=h, measure=measure, limit=limit)
        for h, limits in ((False, (99.95, 99.3, 99.9, 3.0, 0.01)), (True, (99.5, 96.5, 99.5, 15.0, 0.01)))
        for measure, limit in zip(("precision", "right", "FPER", "wrong ≥ 0.9 s in all", "ECE"), limits, strict=True)
    ),
)
"""Precision, right of all and FPER in percent; wrong seconds in the worst session, unless in all. Family 15 has only a
goal for its ECE: it shows how far the others' figures rest on errors that behave as expected."""
