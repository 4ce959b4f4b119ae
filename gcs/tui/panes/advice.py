"""Advice to an operator about a vehicle."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

import numpy as np

from gcs.health.heard import is_heard
from gcs.snapshot import Snapshot, Standing, VehicleRow
from gcs.tui.draw.format import metres
from gcs.tui.panes.alarms import worst_alarm
from infra.plain_text import plain

ADVICE: Final[Mapping[Standing, str]] = MappingProxyType(
    {
        "confirmed": "nothing: rely on it",
        "tentative": "do not rely on it yet; = states who it is",
        "coasting": "wait until it is seen again",
        "unidentified": "do not guess: it should be there without a name",
        "out of view": "turn or move the camera there",
        "no position": "check its receiver and its stream rates",
        "misplaced": "do not rely on its position: find it by eye",
        "no new frame": "check the camera and its link",
    }
)
"""Advice by standing, while no alarm says more."""
HELD: Final = "wait for a new picture, then rely on it"
"""Advice about a name of a picture that is old."""
UNHEARD: Final = "switch it on; check its system id and its key against the mission"
"""Advice about a vehicle that was never heard."""


def what_to_do(snapshot: Snapshot, row: VehicleRow) -> str:
    """Advice of the worst alarm, else what the standing does."""
    worst = worst_alarm(snapshot, row.system_id)
    if worst is not None and worst.advice:
        return plain(worst.advice)
    if not is_heard(row) and not snapshot.provisional:
        return UNHEARD
    if row.standing == "confirmed" and snapshot.held_s:
        return HELD
    if row.standing != "out of view":
        return ADVICE[row.standing]
    if row.elsewhere:
        return "nothing: another camera shows it"
    aircraft = [each for each in snapshot.vehicles if each.role == "uav"]
    away = {each.name: float(np.hypot(*(each.p_enu - row.p_enu)[:2])) for each in aircraft}
    away = {name: away_m for name, away_m in away.items() if math.isfinite(away_m)}
    if len(aircraft) < 2 or not away:
        return ADVICE[row.standing]
    nearest = min(away, key=lambda name: away[name])
    return f"{ADVICE[row.standing]}: {plain(nearest)} is nearest, {metres(away[nearest])} away"
