"""Alarms about how a vehicle is by its own report, and where it may be; limits are the mission's."""

from __future__ import annotations

import math

from gcs.health.alarm_rule import AlarmRule
from gcs.health.station_alarms import first_of
from gcs.health.vehicle_alarms import answers
from gcs.snapshot import Snapshot, VehicleRow

OLD_S = 30.0
"""Age from which on a report raises no alarm: over slow radios those of batteries and receivers come once in ten
seconds."""
SAG_S = 5.0
"""Time for which a value has to be low: voltage sags while a motor starts, and receivers lose satellites under a
tree."""
EMPTY = 0.5
"""Share of the mission's limit below which the charge is an alarm."""
CHARGE_BACK = 0.05
"""Charge above its limit from which on the alarm is over: monitors that filter voltage wander."""
HDOP_BACK = 0.8
"""Share of the mission's limit below which HDOP is good again."""
NO_FIX_S = 10.0
"""Time for which a fix has to be missing: a receiver that was hidden finds its satellites again by then."""
CHECKS_S = 10.0
"""Time for which checks have to fail: sensors settle by then after a start."""
OVER_S = 1.0
"""Time for which a position has to be beyond a fence: a few reports of a receiver."""
INSIDE_M = 1.0
"""Distance on the right side from which a vehicle has come back."""
_BAD = ("critical", "emergency", "failed", "unhealthy")


def _charge(row: VehicleRow) -> float:
    """0..1, NaN unknown or old."""
    return row.condition.charge if _reports(row, row.condition.power_age_s) else math.nan


def _reports(row: VehicleRow, age_s: float) -> bool:
    return age_s < OLD_S and answers(row) and not row.contested


def _is_empty(row: VehicleRow, now: Snapshot) -> bool:
    below = _reports(row, row.condition.power_age_s) and row.condition.voltage_v < now.limits.battery_v
    bad = row.condition.battery in _BAD and _reports(row, row.condition.power_age_s)
    return below or bad or _charge(row) < EMPTY * now.limits.battery_share


def _is_low(row: VehicleRow, now: Snapshot) -> bool:
    low = _charge(row) < now.limits.battery_share
    if row.condition.battery == "low" and _reports(row, row.condition.power_age_s):
        low = True
    return low and not _is_empty(row, now)


def _still_low(row: VehicleRow, now: Snapshot) -> bool:
    return row.condition.charge < now.limits.battery_share + CHARGE_BACK or not answers(row)


def _power(row: VehicleRow, now: Snapshot) -> str:
    condition = row.condition
    charge = f"{condition.charge:.0%}" if math.isfinite(condition.charge) else ""
    volts = f"{condition.voltage_v:.1f} V" if math.isfinite(condition.voltage_v) else ""
    return ", ".join(word for word in (condition.battery, charge, volts) if word)


def _without_fix(row: VehicleRow, now: Snapshot) -> bool:
    lost = row.fix in ("none", "2D") and _reports(row, row.condition.receiver_age_s)
    return lost and row.position_state != "never" and now.limits.satellites > 0


def _poor(row: VehicleRow, now: Snapshot) -> bool:
    condition, limits = row.condition, now.limits
    few = 0 <= condition.satellites < limits.satellites
    spread = bool(limits.hdop) and condition.hdop > limits.hdop
    known = _reports(row, condition.receiver_age_s) and row.position_state != "never"
    return known and (few or spread) and not _without_fix(row, now)


def _still_poor(row: VehicleRow, now: Snapshot) -> bool:
    few = 0 <= row.condition.satellites <= now.limits.satellites
    return few or row.condition.hdop > HDOP_BACK * now.limits.hdop or not answers(row)


def _reception(row: VehicleRow, now: Snapshot) -> str:
    condition = row.condition
    hdop = f"HDOP {condition.hdop:.1f}" if math.isfinite(condition.hdop) else ""
    return ", ".join(
        word for word in (f"{condition.satellites} satellites" * (condition.satellites >= 0), hdop) if word
    )


def _known_place(row: VehicleRow) -> bool:
    return row.position_state in ("ok", "stale")


def _is_over(row: VehicleRow, now: Snapshot) -> bool:
    return _known_place(row) and row.fence_m < 0.0 and row.system_id not in now.conflicts


def _may_be_over(row: VehicleRow, now: Snapshot) -> bool:
    return _known_place(row) and row.fence_m < row.std_m and not _is_over(row, now)


def _not_back(row: VehicleRow, now: Snapshot) -> bool:
    """Tell whether it is not known to be on the right side again."""
    return bool(row.fence) and not (_known_place(row) and row.fence_m > max(INSIDE_M, row.std_m))


CONDITION_RULES: tuple[AlarmRule[VehicleRow], ...] = (
    AlarmRule(
        key="battery",
        level="warning",
        kind="vehicle",
        text="battery low",
        meaning=f"its lowest battery is below the share `[limits] battery_share` (25 %) for {SAG_S:g} s, until "
        f"{CHARGE_BACK:.0%} above it, or its monitor reports it as low: charge and voltage are given",
        advice="bring it back",
        condition=_is_low,
        detail=_power,
        kept_while=_still_low,
        lasts_s=SAG_S,
    ),
    AlarmRule(
        key="battery",
        level="alarm",
        kind="vehicle",
        text="battery almost empty",
        meaning=f"below half of that share, or below `[limits] battery_v`, for {SAG_S:g} s, or its monitor reports it "
        "as critical or failing",
        advice="stop it where it can be fetched; an aircraft has to land now",
        condition=_is_empty,
        detail=_power,
        lasts_s=SAG_S,
    ),
    AlarmRule(
        key="reception",
        level="warning",
        kind="vehicle",
        text="its satellite reception is poor",
        meaning="fewer satellites than `[limits] satellites` (6), or more HDOP than `[limits] hdop` (2.5), for "
        f"{SAG_S:g} s",
        advice="its position may be off by many metres: rely on the picture; look for trees, walls and jammers near it",
        condition=_poor,
        detail=_reception,
        kept_while=_still_poor,
        lasts_s=SAG_S,
    ),
    AlarmRule(
        key="reception",
        level="alarm",
        kind="vehicle",
        text="its receiver has no 3D fix",
        meaning=f"it had a position, and its receiver reports none or only 2D for {NO_FIX_S:g} s",
        advice="its position is guessed from motion: do not act on its name; look for trees, walls and jammers near it",
        condition=_without_fix,
        doubts_name=True,
        lasts_s=NO_FIX_S,
    ),
    AlarmRule(
        key="arming",
        level="warning",
        kind="vehicle",
        text="it says that it cannot be armed",
        meaning=f"its arming checks fail for {CHECKS_S:g} s, by its texts or SYS_STATUS: its words are given",
        advice="put right what it names",
        condition=lambda row, _: bool(row.condition.arming) and answers(row) and not row.contested,
        detail=lambda row, _: first_of(row.condition.arming),
        kept_while=lambda row, _: bool(row.condition.arming) and not answers(row),
        lasts_s=CHECKS_S,
    ),
    AlarmRule(
        key="part",
        level="warning",
        kind="vehicle",
        text="it reports a part as failing",
        meaning=f"a sensor or part in use is not healthy in SYS_STATUS for {CHECKS_S:g} s: which is given",
        advice="bring it back and look at it; do not start with it",
        condition=lambda row, _: bool(row.condition.faults) and answers(row) and not row.contested,
        detail=lambda row, _: first_of(row.condition.faults),
        kept_while=lambda row, _: bool(row.condition.faults) and not answers(row),
        lasts_s=CHECKS_S,
    ),
    AlarmRule(
        key="fence",
        level="warning",
        kind="vehicle",
        text="it may be beyond a fence",
        meaning="the fence is nearer than 1σ of its position, which grows with age, or it reports to be beyond it and "
        f"the video contradicts its position, for {OVER_S:g} s: which is given",
        advice="turn it round",
        condition=_may_be_over,
        detail=lambda row, _: row.fence,
        kept_while=_not_back,
        lasts_s=OVER_S,
    ),
    AlarmRule(
        key="fence",
        level="alarm",
        kind="vehicle",
        text="it is beyond a fence",
        meaning=f"its reported position is on the wrong side of one of the mission's fences for {OVER_S:g} s; over "
        f"when it is known to be back, by {INSIDE_M:g} m and by 1σ",
        advice="stop it, and bring it back",
        condition=_is_over,
        detail=lambda row, _: row.fence,
        lasts_s=OVER_S,
    ),
)
