"""Alarms of two ground vehicles that are too near to each other."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from gcs.health.alarm_rule import AlarmRule
from gcs.snapshot import Snapshot, VehicleRow

NEAR_S = 1.0
"""Time, s, for which two have to be near: a few reports of both."""
APART = 1.2
"""Factor of the mission's limit from which on two vehicles are no longer near."""


@dataclass(frozen=True, slots=True)
class Pair:
    """Two vehicles, and how far apart they report to be."""

    a: VehicleRow
    b: VehicleRow
    distance_m: float
    """Horizontally, between the places that they report."""
    std_m: float
    """1σ of it: both positions', which grow with their age."""

    @property
    def key(self) -> str:
        """Both system ids."""
        return f"{self.a.system_id} {self.b.system_id}"

    @property
    def names(self) -> str:
        """Both names."""
        return f"{self.a.name} and {self.b.name}"


def near_pairs(now: Snapshot) -> Iterator[Pair]:
    """Ground vehicles with usable positions that are not surely further apart than the mission's limit; each once."""
    if not now.limits.separation_m:
        return
    rows = [row for row in now.vehicles if row.role == "ugv" and row.position_state in ("ok", "stale")]
    if len(rows) < 2:
        return
    places = np.array([row.p_enu[:2] for row in rows])
    std_m = np.array([row.std_m if math.isfinite(row.std_m) else 0.0 for row in rows])
    distance_m = np.linalg.norm(places[:, None] - places[None], axis=-1)
    spread_m = np.hypot(std_m[:, None], std_m[None])
    near = np.triu(distance_m - spread_m < APART * now.limits.separation_m, k=1)
    for i, j in np.argwhere(near):
        yield Pair(rows[i], rows[j], float(distance_m[i, j]), float(spread_m[i, j]))


def _is_near(pair: Pair, now: Snapshot) -> bool:
    known = now.conflicts.isdisjoint((pair.a.system_id, pair.b.system_id))
    return known and pair.distance_m < now.limits.separation_m


def _may_be_near(pair: Pair, now: Snapshot) -> bool:
    return not _is_near(pair, now) and pair.distance_m - pair.std_m < now.limits.separation_m


PAIR_RULES: tuple[AlarmRule[Pair], ...] = (
    AlarmRule(
        key="near",
        level="warning",
        kind="vehicle",
        text="may be too near each other",
        meaning="two ground vehicles are within 1σ of their positions, which grows with age, of the mission's "
        "`[limits] separation_m`, or report to be nearer while the video contradicts the position of one, for "
        f"{NEAR_S:g} s",
        advice="have one of them wait",
        condition=_may_be_near,
        vehicles=lambda pair, _: (pair.a.system_id, pair.b.system_id),
        kept_while=lambda pair, now: pair.distance_m < APART * now.limits.separation_m,
        lasts_s=NEAR_S,
    ),
    AlarmRule(
        key="near",
        level="alarm",
        kind="vehicle",
        text="too near each other",
        meaning=f"their reported positions are nearer than that, horizontally, for {NEAR_S:g} s; over when they are a "
        "fifth further apart, or when one is lost, which is an alarm of its own",
        advice="stop one of them",
        condition=_is_near,
        vehicles=lambda pair, _: (pair.a.system_id, pair.b.system_id),
        detail=lambda pair, _: f"{pair.distance_m:.1f} m",
        lasts_s=NEAR_S,
    ),
)
