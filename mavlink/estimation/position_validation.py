"""Which reported positions may be used, and how good they are: pure rules on single reports."""

from __future__ import annotations

import math
from dataclasses import dataclass

from mavlink.geodesy import wrap_pi
from mavlink.protocol.messages import GlobalPosition, GpsRaw

__all__ = [
    "NOT_YET",
    "GateParams",
    "altitude_known",
    "climbs_too_fast",
    "course_gap",
    "nonsense",
    "position_std",
    "speed_possible",
    "too_far",
]


@dataclass(frozen=True, slots=True, kw_only=True)
class GateParams:
    """Limits of what a vehicle can do."""

    max_speed: float = 30.0
    """m/s; a place that needs more than this to get to is refused. Raise for fast vehicles."""
    jump_margin_m: float = 20.0
    """Beyond what the speed allows: filters settle in steps, and white noise of 4 m makes neighbours 20 m apart."""
    jump_accept_us: int = 1_000_000
    """A new place that has been held for this long, with nothing from the old one, is where the vehicle is."""
    height_gap_m: float = 30.0
    """A ground vehicle this far above or below the home plane reports the wrong altitude."""
    course_gap: float = math.radians(40.0)
    """Heading this far from the course, forward or backward, while driving: the heading is wrong."""
    course_speed: float = 1.0
    """m/s; slower, the course says nothing."""
    default_std_m: float = 2.0
    """1σ when the receiver says nothing."""
    max_acceleration: float = 4.0
    """m/s²; what two radios of one vehicle may differ by between their reports. Raise for agile vehicles."""
    max_climb: float = 20.0
    """m/s; an aircraft whose height changes faster has jumped."""
    climb_margin_m: float = 20.0
    """Beyond what the climb allows."""


NOT_YET = frozenset({"no fix (0/0)", "no GPS fix"})
"""Reasons of a vehicle that waits for its first fix: no fault before it has had one."""
_NEAR_ZERO_DEG = 1e-3  # autopilots without a fix report 0/0, or a few units of 1e-7° around it
_FIX_NONE = 1
_STD_OF_FIX = {4: 1.0, 5: 0.3, 6: 0.05}
_M_PER_HDOP = 1.5


def nonsense(position: GlobalPosition, gps: GpsRaw | None) -> str:
    """Why a report is no place at all, in a word or two; empty when it may be one.

    Args:
        position: the report.
        gps: the same vehicle's receiver lately, None when not heard.
    """
    lat, lon = position.lat_deg, position.lon_deg
    if not (math.isfinite(lat) and math.isfinite(lon)):
        return "not a number"
    if abs(lat) < _NEAR_ZERO_DEG and abs(lon) < _NEAR_ZERO_DEG:
        return "no fix (0/0)"
    if abs(lat) > 90.0 or abs(lon) > 180.0:
        return "out of range"
    if gps is not None and gps.fix_type == _FIX_NONE:
        return "no GPS fix"
    return ""


def altitude_known(alt_m: float) -> bool:
    """Whether an altitude above sea level is possible at all; the wire's sentinels are not."""
    return -1000.0 < alt_m < 20_000.0


def speed_possible(position: GlobalPosition, params: GateParams) -> bool:
    """Whether a reported velocity is one that this vehicle can have; True when none is given."""
    return not math.hypot(position.v_east, position.v_north) > params.max_speed


def climbs_too_fast(gap_m: float, dt_s: float, params: GateParams) -> bool:
    """Whether nothing that flies gets this far up or down in this time."""
    return abs(gap_m) > params.max_climb * max(dt_s, 0.0) + params.climb_margin_m


def too_far(gap_m: float, dt_s: float, std_m: float, params: GateParams) -> bool:
    """Whether nothing that drives gets this far in this time."""
    return gap_m > params.max_speed * max(dt_s, 0.0) + params.jump_margin_m + 3.0 * std_m


def position_std(gps: GpsRaw | None, params: GateParams) -> float:
    """1σ of a horizontal position: as the receiver estimates it, else by its dilution, else by its kind of fix."""
    if gps is None or gps.fix_type < 2:
        return params.default_std_m
    if math.isfinite(gps.h_acc_m):
        return max(gps.h_acc_m, 0.02)
    if gps.fix_type in _STD_OF_FIX:
        return _STD_OF_FIX[gps.fix_type]
    if math.isfinite(gps.hdop):
        return max(_M_PER_HDOP * gps.hdop, 0.5)
    return params.default_std_m


def course_gap(v_east: float, v_north: float, heading: float) -> float:
    """Angle between a heading and the line of travel, 0..π/2: 0 both forward and in reverse."""
    gap = abs(wrap_pi(math.atan2(v_east, v_north) - heading))
    return min(gap, math.pi - gap)
