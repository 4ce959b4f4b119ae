"""One vehicle's reported positions: checked against what a vehicle can do, and kept when they can be right."""

from __future__ import annotations

import math
import statistics
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np

from mavlink.estimation.interpolation import (
    LOST_S,
    Fix,
    Insertion,
    PositionEstimate,
    SampleBuffer,
    horizontal_distance_m,
    position_at,
)
from mavlink.geodesy import LocalFrame, wrap_pi
from mavlink.protocol.messages import GlobalPosition, GpsRaw
from mavlink.state import PositionState

UNSTEADY_ALTITUDE = "altitude, contradicts itself from report to report"
NOT_YET = frozenset({"no fix (0/0)", "no GPS fix"})
"""Reasons of a vehicle that waits for its first fix: no fault before it has had one."""
_NEAR_ZERO_DEG = 1e-3
"""Autopilots without a fix report 0/0, or a few units of 1e-7° around it."""
_FIX_NONE, FIX_2D = 1, 2
_STD_OF_FIX_M = {4: 1.0, 5: 0.3, 6: 0.05}
"""1σ by GPS_FIX_TYPE where the receiver reports no accuracy: DGPS, RTK float, RTK fixed."""
_M_PER_HDOP = 1.5
"""1σ of a single-frequency receiver at a dilution of 1."""
_MIN_ACCURACY_M, _MIN_DILUTED_M = 0.02, 0.5
"""1σ is never less than this, by reported accuracy and by dilution."""
_SEA_LEVEL_M = 5.0
"""Altitudes this near to zero are those of a barometer that was set to zero where the vehicle was switched on."""
_MIN_UP_STD_M = 2.0
"""1σ of an altitude is never less than this, however good the receiver: barometers drift with the weather."""
_ALTITUDE_M = -1000.0, 20_000.0
"""Possible altitudes above sea level; the wire's values for "unknown" are not among them."""
_STDS = 3.0
"""Position errors up to this many σ are no jump."""
_GAPS, _MIN_GAPS = 5, 3
"""Number of last gaps between reports whose median is the usual gap, and the least for one: outages count nothing."""
_STALE_S = 1.0
"""Radios are a few tenths of a second late: younger positions are never stale."""
_PERIOD_GAIN = 0.1
"""Weight of the newest gap in the usual period between reports: one loss must not look like a slow sender."""
_STANDING_SPEED = 0.3
"""m/s; at less a vehicle is at rest, and its position may repeat."""
_STANDING_REPORT_US = 1_000_000
"""A standing vehicle's repeated position counts as new evidence this often."""
_STEADY_ALTITUDE_M, _STEADY_AGAIN_M, _LONGEST_STEP_M, _ALTITUDE_GAIN = 12.0, 6.0, 30.0, 0.3
"""Altitudes whose steps from report to report are larger than the first on average contradict themselves, until the
steps are smaller than the second. A step counts for the third at most, and the newest has the weight of the fourth."""
_YAW_GAP = math.radians(20.0)
"""A heading this far from the attitude's yaw is wrong."""
_COURSE_DISTRUST, _COURSE_WORST = 5, 10
"""Reports (wrong less right ones) after which a heading is distrusted, and the most that are counted: trust comes back
after as many right ones."""


@dataclass(frozen=True, slots=True, kw_only=True)
class VehicleLimits:
    """Limits of what a vehicle can do."""

    max_speed: float = 30.0
    """m/s; a position that needs more than this to get to is rejected. Raise for fast vehicles."""
    jump_margin_m: float = 20.0
    """Margin beyond what the speed allows, m: filters settle in steps, and white noise of 4 m makes neighbours 20 m
    apart."""
    jump_accept_us: int = 1_000_000
    """A new place that has been held for this long, with nothing from the old one, is where the vehicle is."""
    height_gap_m: float = 150.0
    """A ground vehicle this far above or below the UAV's home reports the wrong altitude: hills are lower."""
    sea_level_gap_m: float = 30.0
    """Equivalent of ``height_gap_m`` for a vehicle that reports sea level, as autopilots do until their filter has
    started."""
    course_gap: float = math.radians(40.0)
    """Difference of heading and course, forward or backward, while driving, above which the heading is wrong."""
    course_speed: float = 1.0
    """m/s; at less the course is not compared."""
    default_std_m: float = 2.0
    """1σ when the receiver reports none."""
    default_up_std_m: float = 3.0
    """1σ of the altitude when the receiver reports none: a barometer carries it on from the first fix."""
    max_acceleration: float = 4.0
    """m/s²; what two radios of one vehicle may differ by between their reports. Raise for agile vehicles."""
    max_climb: float = 20.0
    """m/s; an aircraft whose height changes faster has jumped."""
    climb_margin_m: float = 20.0
    """Margin beyond what the climb allows, m."""


class Verdict(Enum):
    """Verdict on one report: why, whether it was accepted, whether it is impossible."""

    NEW = "new", True, False
    REPEATED = "the same position, standing", True, False
    MOVED = "held after a jump", True, False
    DUPLICATE = "of the time of another", False, False
    FROZEN = "moving, and at the same place as before", False, False
    OUT_OF_ORDER = "out of order, seconds late", False, False
    JUMP = "farther than it can have driven", False, True
    CLIMB = "higher or lower than it can have flown", False, True

    def __init__(self, reason: str, accepted: bool, impossible: bool) -> None:
        self.reason = reason
        self.accepted = accepted
        """The report can be right and is kept."""
        self.impossible = impossible
        """The vehicle cannot have got there."""


def place_error(position: GlobalPosition, gps: GpsRaw | None) -> str:
    """Return why a report is no place on Earth, in a word or two; empty when it may be one.

    Args:
        gps: the same vehicle's receiver lately, None unknown.
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
    """Tell whether an altitude above sea level is possible at all."""
    return _ALTITUDE_M[0] < alt_m < _ALTITUDE_M[1]


def speed_possible(position: GlobalPosition, limits: VehicleLimits) -> bool:
    """Tell whether a reported velocity is one that this vehicle can have; True when none is given."""
    return not math.hypot(position.v_east, position.v_north) > limits.max_speed


def climbs_too_fast(gap_m: float, dt_s: float, limits: VehicleLimits) -> bool:
    """Tell whether nothing that flies gets this far up or down in this time."""
    return abs(gap_m) > limits.max_climb * max(dt_s, 0.0) + limits.climb_margin_m


def too_far(gap_m: float, dt_s: float, std_m: float, limits: VehicleLimits) -> bool:
    """Tell whether nothing that drives gets this far in this time."""
    return gap_m > limits.max_speed * max(dt_s, 0.0) + limits.jump_margin_m + _STDS * std_m


def position_stds(gps: GpsRaw | None, limits: VehicleLimits) -> tuple[float, float]:
    """1σ of a position, level and of its altitude: as the receiver estimates them, else by what else it reports."""
    known = gps is not None and math.isfinite(gps.v_acc_m)
    return _level_std(gps, limits), max(gps.v_acc_m, _MIN_UP_STD_M) if gps and known else limits.default_up_std_m


def _level_std(gps: GpsRaw | None, limits: VehicleLimits) -> float:
    """1σ that the receiver estimates, else by its dilution, else by its kind of fix."""
    if gps is None or gps.fix_type < FIX_2D:
        return limits.default_std_m
    if math.isfinite(gps.h_acc_m):
        return max(gps.h_acc_m, _MIN_ACCURACY_M)
    if gps.fix_type in _STD_OF_FIX_M:
        return _STD_OF_FIX_M[gps.fix_type]
    if math.isfinite(gps.hdop):
        return max(_M_PER_HDOP * gps.hdop, _MIN_DILUTED_M)
    return limits.default_std_m


def course_gap(v_east: float, v_north: float, heading: float) -> float:
    """Angle between a heading and the line of travel, 0..π/2: 0 both forward and in reverse."""
    gap = abs(wrap_pi(math.atan2(v_east, v_north) - heading))
    return min(gap, math.pi - gap)


def in_frame(fixes: Sequence[Fix], before: LocalFrame, now: LocalFrame) -> list[Fix]:
    """Return the estimates in another local frame; velocities and headings stay, they refer to the north at the
    place."""
    p_enu = np.array([fix[:3] for fix in fixes], dtype=np.float64).reshape(-1, 3)
    moved = now.to_enu(*before.to_geodetic(p_enu)).tolist()
    return [fix._replace(east=p[0], north=p[1], up=p[2]) for p, fix in zip(moved, fixes, strict=True)]


def fix_of(
    sample: GlobalPosition,
    frame: LocalFrame,
    home_alt_m: float,
    *,
    heading: float,
    steady: Callable[[float], bool],
    stds_m: tuple[float, float],
    limits: VehicleLimits,
    drives: bool,
) -> tuple[Fix, tuple[str, ...]]:
    """A report in ENU, and what was left out of it because it cannot be right.

    Args:
        sample: a place that may be one.
        frame: ENU.
        home_alt_m: altitude of the home plane, NaN unknown; ground vehicles without an altitude are put on it.
        heading: from :meth:`Positions.check_heading`.
        steady: :meth:`Positions.check_altitude`.
        stds_m: from :func:`position_stds`.
    """
    left_out = []
    std_m, up_std_m = stds_m
    alt_m = sample.alt_m if altitude_known(sample.alt_m) else math.nan
    # rovers report sea level as their altitude until their filter has started, and some after
    most_gap_m = limits.sea_level_gap_m if abs(alt_m) < _SEA_LEVEL_M else limits.height_gap_m
    near = abs(alt_m - home_alt_m) <= most_gap_m
    if drives and not (near and steady(alt_m)):
        if near:
            left_out.append(UNSTEADY_ALTITUDE)
        elif math.isfinite(home_alt_m):
            left_out.append("altitude, far from the ground")
        alt_m = home_alt_m if math.isfinite(home_alt_m) else alt_m if math.isfinite(alt_m) else frame.alt_m
        up_std_m = math.nan
    known = math.isfinite(alt_m)
    east, north, up = frame.to_enu_point(sample.lat_deg, sample.lon_deg, alt_m if known else frame.alt_m)
    v_east, v_north = sample.v_east, sample.v_north
    if not speed_possible(sample, limits):
        left_out.append("faster than it can be")
        v_east = v_north = math.nan
    if math.isnan(heading) and not math.isnan(sample.heading):
        left_out.append("heading, against course or attitude")
    height_m = sample.relative_alt_m if altitude_known(sample.relative_alt_m) else math.nan
    up = up if known else math.nan
    return Fix(east, north, up, v_east, v_north, -sample.v_down, heading, std_m, height_m, up_std_m), tuple(left_out)


class Positions:
    """Positions of one vehicle by its own boot time in µs.

    Args:
        drives: a ground vehicle, whose course must fit its heading.
    """

    def __init__(self, limits: VehicleLimits, *, drives: bool) -> None:
        self.period_s = math.nan
        """Usual time between reports, at most three seconds."""
        self._gaps_s: deque[float] = deque(maxlen=_GAPS)
        """The last times between reports."""
        self._limits = limits
        self._drives = drives
        self._fixes: SampleBuffer[Fix] = SampleBuffer()
        self._elsewhere: list[tuple[int, Fix]] = []
        """The first and the last two reports in a row that were too far away."""
        self._heading_errors = 0
        self._heading_trusted = True
        self._alt_m, self._altitude_var, self._altitude_trusted = math.nan, 0.0, True
        """The altitude reported last, the mean square of its steps, and whether it is used."""
        self._place = (math.nan, math.nan)
        self._reported_us = 0

    def clear(self) -> None:
        """Remove every position, for a vehicle that has rebooted."""
        self._fixes.clear()
        self._elsewhere.clear()
        self._place = (math.nan, math.nan)
        self._reported_us = 0

    def change_frame(self, before: LocalFrame, now: LocalFrame, reach_m: float) -> None:
        """Convert every position to another local frame; remove them where the newest is farther than it reaches."""
        self._fixes.replace_all(lambda fixes: in_frame(fixes, before, now))
        self._elsewhere.clear()
        if self.newest is not None and math.hypot(*self.newest[1][:3]) > reach_m:
            self.clear()

    @property
    def known(self) -> bool:
        """True if any position was accepted."""
        return len(self._fixes) > 0

    def has(self, boot_us: int) -> bool:
        """Tell whether a position of exactly this time is known."""
        return self._fixes.has(boot_us)

    @property
    def newest(self) -> tuple[int, Fix] | None:
        """The newest accepted position and its time."""
        return self._fixes.newest

    def check_heading(self, sample: GlobalPosition, yaw: float) -> float:
        """The reported heading, or NaN when attitude or course contradict it.

        Args:
            yaw: of the same vehicle's attitude now, NaN unknown.
        """
        heading = sample.heading
        if math.isnan(heading):
            return heading
        if self._drives and math.hypot(sample.v_east, sample.v_north) >= self._limits.course_speed:
            wrong = course_gap(sample.v_east, sample.v_north, heading) > self._limits.course_gap
            errors = self._heading_errors + (1 if wrong else -1)
            self._heading_errors = max(0, min(_COURSE_WORST, errors))
            if self._heading_errors >= _COURSE_DISTRUST:
                self._heading_trusted = False
            elif self._heading_errors == 0:
                self._heading_trusted = True
        contradicted = abs(wrap_pi(heading - yaw)) > _YAW_GAP  # False when yaw is NaN
        return math.nan if contradicted or not self._heading_trusted else heading

    def check_altitude(self, alt_m: float) -> bool:
        """Tell whether the altitudes that are reported follow from one another; a first one is believed."""
        if not math.isnan(self._alt_m):
            step2 = min(abs(alt_m - self._alt_m), _LONGEST_STEP_M) ** 2
            self._altitude_var += _ALTITUDE_GAIN * (step2 - self._altitude_var)
            worst_m = _STEADY_ALTITUDE_M if self._altitude_trusted else _STEADY_AGAIN_M
            self._altitude_trusted = self._altitude_var < worst_m**2
        self._alt_m = alt_m
        return self._altitude_trusted

    def add(self, boot_us: int, fix: Fix, place: tuple[float, float]) -> Verdict:
        """Compare one report with those before and keep it when it can be right.

        Args:
            boot_us: when it was made.
            fix: the position in ENU.
            place: latitude and longitude as sent, to recognise a repetition.
        """
        if self._fixes.has(boot_us):
            return Verdict.DUPLICATE
        newest = self._fixes.newest
        if newest is not None and self._is_jump(boot_us, fix, newest):
            return Verdict.MOVED if self._settles(boot_us, fix, place) else Verdict.JUMP
        if newest is not None and self._is_climb(boot_us, fix, newest):
            return Verdict.MOVED if self._settles(boot_us, fix, place) else Verdict.CLIMB
        repeated = place == self._place
        if repeated and math.hypot(fix.v_east, fix.v_north) > _STANDING_SPEED:
            return Verdict.FROZEN
        if self._fixes.add(boot_us, fix) is not Insertion.ADDED:
            return Verdict.OUT_OF_ORDER
        self._elsewhere.clear()
        self._learn_period(boot_us, newest)
        if repeated and boot_us - self._reported_us < _STANDING_REPORT_US:
            return Verdict.REPEATED
        self._place, self._reported_us = place, max(boot_us, self._reported_us)
        return Verdict.NEW

    def at(self, boot_us: int) -> PositionEstimate | None:
        """Position at a time, see :func:`mavlink.estimation.interpolation.position_at`."""
        return position_at(self._fixes, boot_us)

    def state(self, estimate: PositionEstimate | None, rejected_for: str) -> PositionState:
        """Reliability of an estimate: stale after a second and twice the usual period, lost after three.

        Where reports usually come seconds apart it is lost after four usual gaps.

        Args:
            estimate: from :meth:`at`.
            rejected_for: why the last report was not used, empty where it was or is long ago.
        """
        if estimate is None:
            return "refused" if rejected_for and rejected_for not in NOT_YET else "never"
        gap_s = statistics.median(self._gaps_s) if len(self._gaps_s) >= _MIN_GAPS else 0.0
        due_s = _STALE_S if math.isnan(self.period_s) else 2.0 * max(self.period_s, gap_s)
        if estimate.bracketed or estimate.age_s <= due_s:
            return "ok"
        if rejected_for:
            return "refused"
        if estimate.age_s <= _STALE_S:
            return "ok"
        return "stale" if estimate.age_s <= max(LOST_S, 4.0 * gap_s) else "lost"

    def _is_jump(self, boot_us: int, fix: Fix, since: tuple[int, Fix]) -> bool:
        gap_m = horizontal_distance_m(fix, since[1])
        return too_far(gap_m, abs(boot_us - since[0]) * 1e-6, max(fix.std_m, since[1].std_m), self._limits)

    def _is_climb(self, boot_us: int, fix: Fix, since: tuple[int, Fix]) -> bool:
        """A ground vehicle's height is that of the ground and never checked here."""
        if self._drives:
            return False
        return climbs_too_fast(fix.up - since[1].up, abs(boot_us - since[0]) * 1e-6, self._limits)

    def _settles(self, boot_us: int, fix: Fix, place: tuple[float, float]) -> bool:
        """Tell whether the vehicle stayed too far away for long enough; then it starts again from there."""
        elsewhere = self._elsewhere
        if elsewhere and (
            boot_us <= elsewhere[-1][0]
            or self._is_jump(boot_us, fix, elsewhere[-1])
            or self._is_climb(boot_us, fix, elsewhere[-1])
        ):
            elsewhere.clear()
        elsewhere.append((boot_us, fix))
        del elsewhere[1:-2]
        if len(elsewhere) < 3 or boot_us - elsewhere[0][0] < self._limits.jump_accept_us:
            return False
        self.clear()
        self._fixes.add(boot_us, fix)
        self._place, self._reported_us = place, boot_us
        return True

    def _learn_period(self, boot_us: int, newest: tuple[int, Fix] | None) -> None:
        if newest is None or boot_us <= newest[0]:
            return
        self._gaps_s.append((boot_us - newest[0]) * 1e-6)
        gap_s = min(self._gaps_s[-1], LOST_S)
        self.period_s = gap_s if math.isnan(self.period_s) else self.period_s + _PERIOD_GAIN * (gap_s - self.period_s)
