"""One vehicle's positions: judged as they come, interpolated when asked."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Hashable, Sequence
from typing import Literal, NamedTuple

import numpy as np

from mavlink.estimation.position_validation import (
    NOT_YET,
    GateParams,
    altitude_known,
    climbs_too_fast,
    course_gap,
    speed_possible,
    too_far,
)
from mavlink.estimation.sample_buffer import History
from mavlink.geodesy import LocalFrame, wrap_pi
from mavlink.protocol.messages import GlobalPosition
from mavlink.state import PositionState

__all__ = ["LOST_S", "Estimate", "Fix", "Jumps", "Positions", "Verdict", "fix_of", "in_frame"]

Verdict = Literal["new", "standing", "moved", "frozen", "duplicate", "late", "jump", "leap"]
"""new: usable; standing: usable, says nothing new; moved: usable after a jump; the others are not used (jump: too far,
leap: too high)."""

LOST_S = 3.0
_STALE_S = 1.0  # radios are a few tenths of a second late, and that is no trouble
_EXTRAPOLATE_S = 2.0
_HERMITE_S = 2.0
_ACCELERATION = 1.5  # m/s², 1σ of what a driver does between reports
_STANDING_SPEED = 0.3
_STANDING_REPORT_US = 1_000_000
_YAW_GAP = math.radians(20.0)
_COURSE_DISTRUST, _COURSE_WORST = 5, 10
_TURNS, _TURNS_US = 3, 10_000_000  # there, back and there again
_AWAY_US = 2_000_000  # a new place that is held is believed before
_SETTLED_US = 3_000_000


class Fix(NamedTuple):
    """A position in ENU metres and how it was moving."""

    east: float
    north: float
    up: float
    v_east: float
    v_north: float
    v_up: float
    heading: float
    """Clockwise from north, NaN unknown."""
    std_m: float
    height_m: float
    """Above home as reported."""


def in_frame(fixes: Sequence[Fix], before: LocalFrame, now: LocalFrame) -> list[Fix]:
    """The same places in another local frame. Velocities and headings stay: they are told by the north of the place."""
    p_enu = np.array([fix[:3] for fix in fixes], dtype=np.float64).reshape(-1, 3)
    moved = now.to_enu(*before.to_geodetic(p_enu)).tolist()
    return [fix._replace(east=p[0], north=p[1], up=p[2]) for p, fix in zip(moved, fixes, strict=True)]


def fix_of(
    sample: GlobalPosition,
    frame: LocalFrame,
    home_alt_m: float,
    *,
    heading: float,
    std_m: float,
    params: GateParams,
    drives: bool,
) -> tuple[Fix, tuple[str, ...]]:
    """A report in ENU, and what was left out of it because it cannot be right.

    Args:
        sample: a place that may be one.
        frame: ENU.
        home_alt_m: altitude of the home plane, NaN unknown; what drives stands on it.
        heading: from :meth:`Positions.judged_heading`.
        std_m: 1σ.
        params: what the vehicle can do.
        drives: a ground vehicle.
    """
    left_out = []
    alt_m = sample.alt_m if altitude_known(sample.alt_m) else math.nan
    if drives and not abs(alt_m - home_alt_m) <= params.height_gap_m:
        # rovers report sea level as their altitude until their filter has started, and more after
        if math.isfinite(home_alt_m):
            left_out.append("altitude, far from the ground")
        alt_m = home_alt_m if math.isfinite(home_alt_m) else alt_m if math.isfinite(alt_m) else frame.alt_m
    known = math.isfinite(alt_m)
    east, north, up = frame.to_enu_point(sample.lat_deg, sample.lon_deg, alt_m if known else frame.alt_m)
    v_east, v_north = sample.v_east, sample.v_north
    if not speed_possible(sample, params):
        left_out.append("faster than it can be")
        v_east = v_north = math.nan
    if math.isnan(heading) and not math.isnan(sample.heading):
        left_out.append("heading, against course or attitude")
    height_m = sample.relative_alt_m if altitude_known(sample.relative_alt_m) else math.nan
    up = up if known else math.nan
    return Fix(east, north, up, v_east, v_north, -sample.v_down, heading, std_m, height_m), tuple(left_out)


class Estimate(NamedTuple):
    """Where a vehicle is at some time, by its own reports."""

    fix: Fix
    age_s: float
    """Since the newest report at or before that time."""
    bracketed: bool
    """A later report exists too, and soon enough after: interpolated, not extrapolated."""


class Positions:
    """Positions of one vehicle by its own boot time in µs.

    Args:
        params: limits.
        drives: a ground vehicle, whose course must fit its heading.
    """

    def __init__(self, params: GateParams, *, drives: bool) -> None:
        self.period_s = math.nan
        """Usual time between reports."""
        self._params = params
        self._drives = drives
        self._history: History[Fix] = History()
        self._elsewhere: list[tuple[int, Fix]] = []
        self._course_badness = 0
        self._heading_trusted = True
        self._place = (math.nan, math.nan)
        self._reported_us = 0

    def clear(self) -> None:
        """Forgets every position, for a vehicle that has rebooted."""
        self._history.clear()
        self._elsewhere.clear()
        self._place = (math.nan, math.nan)
        self._reported_us = 0

    def move(self, before: LocalFrame, now: LocalFrame, reach_m: float) -> None:
        """Tells every position in another local frame; forgets them where the newest is farther than it reaches."""
        self._history.replace(lambda fixes: in_frame(fixes, before, now))
        self._elsewhere.clear()
        if self.last is not None and math.hypot(*self.last[1][:3]) > reach_m:
            self.clear()

    @property
    def known(self) -> bool:
        """Whether any position was accepted."""
        return len(self._history) > 0

    def has(self, boot_us: int) -> bool:
        """Whether a position of exactly this time is known."""
        return self._history.has(boot_us)

    @property
    def last(self) -> tuple[int, Fix] | None:
        """The newest accepted position and its time."""
        return self._history.last

    def judged_heading(self, sample: GlobalPosition, yaw: float) -> float:
        """The reported heading, or NaN when attitude or course contradict it.

        Args:
            sample: the report.
            yaw: of the same vehicle's attitude now, NaN unknown.
        """
        heading = sample.heading
        if math.isnan(heading):
            return heading
        if self._drives and math.hypot(sample.v_east, sample.v_north) >= self._params.course_speed:
            wrong = course_gap(sample.v_east, sample.v_north, heading) > self._params.course_gap
            badness = self._course_badness + (1 if wrong else -1)
            self._course_badness = max(0, min(_COURSE_WORST, badness))
            if self._course_badness >= _COURSE_DISTRUST:
                self._heading_trusted = False
            elif self._course_badness == 0:
                self._heading_trusted = True
        contradicted = abs(wrap_pi(heading - yaw)) > _YAW_GAP  # False when yaw is NaN
        return math.nan if contradicted or not self._heading_trusted else heading

    def take(self, boot_us: int, fix: Fix, place: tuple[float, float]) -> Verdict:
        """Judges one report against those before and keeps it when it can be right.

        Args:
            boot_us: when it was made.
            fix: the position in ENU.
            place: the position as it was on the wire, to tell a repetition.
        """
        if self._history.has(boot_us):
            return "duplicate"
        last = self._history.last
        if last is not None and self._is_jump(boot_us, fix, last):
            return self._jump(boot_us, fix, place)
        if last is not None and self._is_leap(boot_us, fix, last):
            return "leap" if self._jump(boot_us, fix, place) == "jump" else "moved"
        repeated = place == self._place
        if repeated and math.hypot(fix.v_east, fix.v_north) > _STANDING_SPEED:
            return "frozen"
        if self._history.add(boot_us, fix) != "added":
            return "late"
        self._elsewhere.clear()
        self._learn_period(boot_us, last)
        if repeated and boot_us - self._reported_us < _STANDING_REPORT_US:
            return "standing"
        self._place, self._reported_us = place, max(boot_us, self._reported_us)
        return "new"

    def at(self, boot_us: int) -> Estimate | None:
        """Position at a time: between two reports interpolated, after the last carried on for two seconds at most.

        Returns:
            None before the first report.
        """
        before, after = self._history.around(boot_us)
        if before is None:
            return None
        age_s = (boot_us - before[0]) * 1e-6
        if after is not None and after[0] - before[0] <= LOST_S * 1e6:
            return Estimate(_between(before, after, boot_us), age_s, True)
        return Estimate(_carried(before[1], age_s), age_s, False)

    def state(self, estimate: Estimate | None, refused_for: str) -> PositionState:
        """How far an estimate may be relied on: stale after a second and twice the usual period, lost after three.

        Args:
            estimate: from :meth:`at`.
            refused_for: why the last report was not used, empty where it was or is long ago.
        """
        if estimate is None:
            return "refused" if refused_for and refused_for not in NOT_YET else "never"
        due_s = _STALE_S if math.isnan(self.period_s) else 2.0 * self.period_s
        if estimate.bracketed or estimate.age_s <= due_s:
            return "ok"
        if refused_for:
            return "refused"
        if estimate.age_s <= _STALE_S:
            return "ok"
        return "stale" if estimate.age_s <= LOST_S else "lost"

    def _is_jump(self, boot_us: int, fix: Fix, last: tuple[int, Fix]) -> bool:
        gap_m = _apart_m(fix, last[1])
        return too_far(gap_m, abs(boot_us - last[0]) * 1e-6, max(fix.std_m, last[1].std_m), self._params)

    def _is_leap(self, boot_us: int, fix: Fix, last: tuple[int, Fix]) -> bool:
        """A ground vehicle's height is that of the ground and never judged here."""
        if self._drives:
            return False
        return climbs_too_fast(fix.up - last[1].up, abs(boot_us - last[0]) * 1e-6, self._params)

    def _jump(self, boot_us: int, fix: Fix, place: tuple[float, float]) -> Verdict:
        elsewhere = self._elsewhere
        if elsewhere and (
            boot_us <= elsewhere[-1][0]
            or self._is_jump(boot_us, fix, elsewhere[-1])
            or self._is_leap(boot_us, fix, elsewhere[-1])
        ):
            elsewhere.clear()
        elsewhere.append((boot_us, fix))
        del elsewhere[1:-2]
        if len(elsewhere) < 3 or boot_us - elsewhere[0][0] < self._params.jump_accept_us:
            return "jump"
        self.clear()
        self._history.add(boot_us, fix)
        self._place, self._reported_us = place, boot_us
        return "moved"

    def _learn_period(self, boot_us: int, last: tuple[int, Fix] | None) -> None:
        if last is None or boot_us <= last[0]:
            return
        gap_s = min((boot_us - last[0]) * 1e-6, LOST_S)
        # one gap after a loss must not look like a slow sender
        self.period_s = gap_s if math.isnan(self.period_s) else self.period_s + 0.1 * (gap_s - self.period_s)


class Jumps:
    """Whether a vehicle's own place jumps to and fro, as that of a receiver which is jammed or fails.

    A jump that stays, or one bad report, is none of it.
    """

    def __init__(self) -> None:
        self._good_way: Hashable = None
        self._good_fix: Fix | None = None
        self._away_fix: Fix | None = None
        self._turns: deque[int] = deque(maxlen=_TURNS)
        self._away_us = 0
        self._last_us = 0

    def take(self, verdict: Verdict, way: Hashable, t_us: int, fix: Fix) -> None:
        """Hears how a report was judged.

        Args:
            verdict: from :meth:`Positions.take`.
            way: how it came; another sender's reports are no jumps of this one's.
            t_us: Unix µs of its arrival.
            fix: the place.
        """
        if verdict in ("jump", "leap"):
            if way != self._good_way:
                return
            if not self._away_us:
                self._away_us = t_us
                self._turns.append(t_us)
            self._last_us, self._away_fix = t_us, fix
        elif verdict in ("new", "standing", "moved"):
            if self._away_us and way == self._good_way:
                self._last_us = t_us
                if verdict != "moved" and self._is_back(fix):
                    self._turns.append(t_us)
            self._good_way, self._good_fix, self._away_us = way, fix, 0

    def _is_back(self, fix: Fix) -> bool:
        """Whether a place goes on from before a jump; one near that jumped to has only come within reach meanwhile."""
        if self._good_fix is None or self._away_fix is None:
            return False
        return _apart_m(fix, self._good_fix) < _apart_m(fix, self._away_fix)

    def jumps(self, t_us: int) -> bool:
        """Whether it jumps to and fro at a Unix time, or did until a moment ago."""
        if not 0 <= t_us - self._last_us < _SETTLED_US:
            return False
        away = self._away_us > 0 and self._last_us - self._away_us >= _AWAY_US
        return away or (len(self._turns) == _TURNS and self._last_us - self._turns[0] < _TURNS_US)


def _apart_m(one: Fix, other: Fix) -> float:
    return math.hypot(one.east - other.east, one.north - other.north)


def _between(before: tuple[int, Fix], after: tuple[int, Fix], boot_us: int) -> Fix:
    """Cubic Hermite through both reports where their velocities fit their places, else a straight line."""
    (t0, a), (t1, b) = before, after
    dt = (t1 - t0) * 1e-6
    s = (boot_us - t0) / (t1 - t0)
    mix = [x + s * (y - x) for x, y in zip(a, b, strict=True)]
    if _velocities_fit(a, b, dt):
        # p = h00 p0 + h10 dt v0 + h01 p1 + h11 dt v1
        h10, h11 = s * (1.0 - s) ** 2, -s * s * (1.0 - s)
        h01 = s * s * (3.0 - 2.0 * s)
        for k in range(3):
            mix[k] = a[k] + h01 * (b[k] - a[k]) + dt * (h10 * a[k + 3] + h11 * b[k + 3])
    mix[6] = (a.heading + s * wrap_pi(b.heading - a.heading)) % (2.0 * math.pi)
    if math.isnan(mix[6]):
        mix[6] = a.heading if s < 0.5 else b.heading
    return Fix(*mix)


def _velocities_fit(a: Fix, b: Fix, dt: float) -> bool:
    if dt > _HERMITE_S:
        return False
    east = (b.east - a.east) / dt - 0.5 * (a.v_east + b.v_east)
    north = (b.north - a.north) / dt - 0.5 * (a.v_north + b.v_north)
    up = (b.up - a.up) / dt - 0.5 * (a.v_up + b.v_up)
    return east * east + north * north + up * up < 4.0  # m²/s²; False when any is NaN


def _carried(fix: Fix, age_s: float) -> Fix:
    """The last report moved on by its velocity; less certain with every second."""
    dt = min(age_s, _EXTRAPOLATE_S)
    ve, vn, vu = (0.0 if math.isnan(v) else v for v in (fix.v_east, fix.v_north, fix.v_up))
    std_m = math.hypot(fix.std_m, 0.5 * _ACCELERATION * age_s * age_s)
    return fix._replace(east=fix.east + ve * dt, north=fix.north + vn * dt, up=fix.up + vu * dt, std_m=std_m)
