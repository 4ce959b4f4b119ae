"""A vehicle's condition in a few cells: battery, satellites, radio, filter, place from the UAV, with the colour of the
mission's limits. Pure."""

from __future__ import annotations

import math
from collections.abc import Iterator

from gcs.limits import Limits
from gcs.snapshot import Snapshot, VehicleRow
from gcs.tui.draw.format import age, degrees, metres, percent
from gcs.tui.draw.freshness import UNKNOWN, aged
from gcs.tui.palette import ALARM, FAINT, INK, WARN
from gcs.tui.themes import Colour
from infra.plain_text import plain

REJECTING = 1.0
"""Innovation over what the filter allows: from here on it rejects the measurement."""
Cell = tuple[str, Colour]
Fact = tuple[str, str, Colour]


def battery(row: VehicleRow, limits: Limits) -> Cell:
    """``87%``, or ``11.9V`` where the charge is not known."""
    condition = row.condition
    low = condition.charge < limits.battery_share or condition.voltage_v < limits.battery_v
    colour = ALARM if low or condition.battery else INK
    if math.isfinite(condition.charge):
        return percent(condition.charge), colour
    return (f"{condition.voltage_v:.1f}V", colour) if math.isfinite(condition.voltage_v) else (UNKNOWN, FAINT)


def satellites(row: VehicleRow, limits: Limits) -> Cell:
    """Number of satellites in use."""
    count = row.condition.satellites
    return (str(count), WARN if count < limits.satellites else INK) if count >= 0 else (UNKNOWN, FAINT)


def hdop(row: VehicleRow, limits: Limits) -> Cell:
    """``0.8``, at most four letters."""
    value = row.condition.hdop
    if not math.isfinite(value):
        return UNKNOWN, FAINT
    return (f"{value:.1f}" if value < 99.95 else "99+"), WARN if limits.hdop and value > limits.hdop else INK


def radio(row: VehicleRow) -> Cell:
    """Signal above noise, in the radio's own units."""
    value = row.condition.radio
    return (f"{value:.0f}", INK) if math.isfinite(value) else (UNKNOWN, FAINT)


def from_uav(row: VehicleRow, snapshot: Snapshot) -> Cell:
    """``120 m 045°``: horizontally, clockwise from north."""
    east, north = (float(row.p_enu[k]) - float(snapshot.uav_enu[k]) for k in (0, 1))
    if row.role == "uav" or not math.isfinite(east + north) or row.position_state not in ("ok", "stale"):
        return UNKNOWN, FAINT
    return f"{metres(math.hypot(east, north))} {degrees(math.atan2(east, north))}", INK


def condition_facts(row: VehicleRow, snapshot: Snapshot, width: int) -> Iterator[Fact]:
    """Name, value and colour of all that is known, as it looks at its age; values take at most ``width`` cells."""
    condition, limits = row.condition, snapshot.limits
    away, colour = from_uav(row, snapshot)
    if away != UNKNOWN:
        yield ("from the UAV", *aged(away, colour, row.position_age_s, width))
    charge, colour = battery(row, limits)
    if charge != UNKNOWN:
        volts = f" {condition.voltage_v:.1f} V" * (math.isfinite(condition.voltage_v) and charge.endswith("%"))
        left = f"{age(condition.left_s)} left" if math.isfinite(condition.left_s) else ""
        text = " ".join(word for word in (charge + volts, condition.battery, left) if word)
        yield ("battery", *aged(text, colour, condition.power_age_s, width))
    if condition.satellites >= 0 or math.isfinite(condition.hdop):
        (count, few), (spread, poor) = satellites(row, limits), hdop(row, limits)
        colour = WARN if WARN in (few, poor) else INK
        yield ("satellites", *aged(f"{count}  HDOP {spread}", colour, condition.receiver_age_s, width))
    if math.isfinite(condition.radio):
        yield ("radio", *aged(f"{condition.radio:.0f} above noise", INK, condition.radio_age_s, width))
    if math.isfinite(condition.filter_ratio):
        bad = condition.filter_ratio >= REJECTING or bool(row.doubted_for) or row.compass_doubted
        text = plain(row.doubted_for) or ("compass contradicts it" if row.compass_doubted else "")
        words = f"innovations {condition.filter_ratio:.1f} of 1.0" + f", {text}" * bool(text)
        yield ("filter", *aged(words, ALARM if bad else INK, condition.filter_age_s, width))
    if row.fence and math.isfinite(row.fence_m):
        side = f"{metres(abs(row.fence_m))} {'from' if row.fence_m >= 0.0 else 'BEYOND'} {plain(row.fence)}"
        yield ("fence", *aged(side, INK if row.fence_m >= 0.0 else ALARM, row.position_age_s, width))
    for fault in condition.faults:
        yield "fault", plain(fault), WARN
    for reason in condition.arming:
        yield "no arming", f"it says: {plain(reason)}", WARN
