"""Samples of one vehicle in order of its own time, and its position and attitude between and after them.

Times are boot times in µs: a clock learnt better later then dates earlier samples better too.
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections.abc import Callable
from enum import Enum
from typing import Generic, NamedTuple, TypeVar

from mavlink.geodesy import wrap_pi
from mavlink.protocol.messages import Attitude

Sample = TypeVar("Sample")

_BUFFER_SIZE = 1000
"""Samples kept: a minute and a half at the 10 Hz of a position, half a minute of attitudes."""
_REORDER_US = 3_000_000
"""A sample older than the newest by more than this is not inserted any more."""

LOST_S = 3.0
"""A position older than this is lost, and no interpolation bridges a longer gap."""
_EXTRAPOLATE_S = 2.0
"""A position is extrapolated by its velocity for this long: vehicles turn, and then it is wrong."""
_HERMITE_S = 2.0
"""Longest gap over which velocities determine the path between, s."""
_VELOCITY_MISFIT_MPS = 2.0
"""Velocities that differ from the mean velocity between two positions by more than this are not used for the path."""
_DRIVER_ACCELERATION = 1.5
"""m/s², 1σ of what a driver does after the last report."""

ATTITUDE_LOST_S = 0.5
"""An attitude older than this is lost, and it is extrapolated no longer."""
_SWAY_S = 0.2
"""Rates of roll and pitch fade with this time constant after the last attitude: a body sways about its mean."""
_ATTITUDE_GAP_US = 1_000_000
"""Attitudes farther apart than this are not interpolated."""
_MAX_ANGLE = 2.0 * math.pi + 1e-3
"""rad; a little more than a whole turn, for rounding."""
_MAX_RATE = 50.0
"""rad/s, faster than anything that carries an autopilot turns."""
_RATE_GAP_US = 500_000
"""Gap between attitudes beyond which rates do not determine the path."""
_RATE_MISFIT = 0.7
"""rad/s; rates whose mean differs from the mean rate between two attitudes by more than this are in another unit or of
another axis. A body that sways by 3° within a quarter of a second is below."""
_GIMBAL_LOCK = 0.1
"""Cosine of a pitch so steep that the rates of roll and yaw mean nothing."""


class Insertion(Enum):
    """Outcome for a sample."""

    ADDED = "added"
    DUPLICATE = "there is a sample of that time"
    TOO_LATE = "older than the newest by too much"


class SampleBuffer(Generic[Sample]):
    """A bounded list of samples, ordered by time however they arrived.

    Args:
        size: samples kept at least; never more than twice as many.
        reorder_us: samples older than the newest by more than this are not inserted.
    """

    __slots__ = ("_reorder_us", "_samples", "_size", "_times")

    def __init__(self, size: int = _BUFFER_SIZE, reorder_us: int = _REORDER_US) -> None:
        self._size = size
        self._reorder_us = reorder_us
        self._times: list[int] = []
        self._samples: list[Sample] = []

    def __len__(self) -> int:
        return len(self._times)

    def add(self, time_us: int, sample: Sample) -> Insertion:
        """Insert a sample at its time."""
        times = self._times
        if not times or time_us > times[-1]:
            times.append(time_us)
            self._samples.append(sample)
            if len(times) > 2 * self._size:
                del times[: self._size], self._samples[: self._size]
            return Insertion.ADDED
        if time_us < times[-1] - self._reorder_us:
            return Insertion.TOO_LATE
        place = bisect_left(times, time_us)
        if times[place] == time_us:
            return Insertion.DUPLICATE
        times.insert(place, time_us)
        self._samples.insert(place, sample)
        return Insertion.ADDED

    def has(self, time_us: int) -> bool:
        """Tell whether there is a sample of exactly this time."""
        place = bisect_left(self._times, time_us)
        return place < len(self._times) and self._times[place] == time_us

    @property
    def newest(self) -> tuple[int, Sample] | None:
        """The newest sample and its time."""
        return (self._times[-1], self._samples[-1]) if self._times else None

    def around(self, time_us: int) -> tuple[tuple[int, Sample] | None, tuple[int, Sample] | None]:
        """The newest sample at or before a time, and the oldest after it."""
        place = bisect_right(self._times, time_us)
        before = (self._times[place - 1], self._samples[place - 1]) if place else None
        after = (self._times[place], self._samples[place]) if place < len(self._times) else None
        return before, after

    def times(self, after_us: int, until_us: int) -> list[int]:
        """Times of the samples after one and up to another."""
        return self._times[bisect_right(self._times, after_us) : bisect_right(self._times, until_us)]

    def replace_all(self, change: Callable[[list[Sample]], list[Sample]]) -> None:
        """Replace all samples by changed ones of the same times."""
        if self._samples:
            self._samples = change(self._samples)

    def clear(self) -> None:
        """Remove every sample."""
        self._times.clear()
        self._samples.clear()


class Fix(NamedTuple):
    """A position in ENU metres and its velocity in m/s."""

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
    """Height above home as reported, m."""
    up_std_m: float
    """1σ of ``up``; NaN where no possible altitude was reported and ``up`` is that of the home plane."""


class PositionEstimate(NamedTuple):
    """Place of a vehicle at some time, by its own reports."""

    fix: Fix
    age_s: float
    """Time since the newest report at or before that time, s."""
    bracketed: bool
    """A later report exists too, and soon enough after: interpolated, not extrapolated."""

    @property
    def usable(self) -> bool:
        """True if a report is near enough in time for the place to be known."""
        return self.bracketed or self.age_s <= _EXTRAPOLATE_S


def position_at(fixes: SampleBuffer[Fix], boot_us: int) -> PositionEstimate | None:
    """Position at a time: interpolated between two reports, after the last extrapolated for two seconds at most.

    Returns:
        None before the first report.
    """
    before, after = fixes.around(boot_us)
    if before is None:
        return None
    age_s = (boot_us - before[0]) * 1e-6
    if after is not None and after[0] - before[0] <= LOST_S * 1e6:
        return PositionEstimate(_interpolated(before, after, boot_us), age_s, True)
    return PositionEstimate(_extrapolated(before[1], age_s), age_s, False)


def horizontal_distance_m(one: Fix, other: Fix) -> float:
    """Distance over the ground."""
    return math.hypot(one.east - other.east, one.north - other.north)


def _interpolated(before: tuple[int, Fix], after: tuple[int, Fix], boot_us: int) -> Fix:
    """Cubic Hermite through both reports where their velocities fit their positions, else a straight line."""
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
    # (p1 − p0) / dt − (v0 + v1) / 2
    east = (b.east - a.east) / dt - 0.5 * (a.v_east + b.v_east)
    north = (b.north - a.north) / dt - 0.5 * (a.v_north + b.v_north)
    up = (b.up - a.up) / dt - 0.5 * (a.v_up + b.v_up)
    return east * east + north * north + up * up < _VELOCITY_MISFIT_MPS**2  # False when any is NaN


def _extrapolated(fix: Fix, age_s: float) -> Fix:
    """The last report moved on by its velocity; its σ grows with ½ a t²."""
    dt = min(age_s, _EXTRAPOLATE_S)
    ve, vn, vu = (0.0 if math.isnan(v) else v for v in (fix.v_east, fix.v_north, fix.v_up))
    std_m = math.hypot(fix.std_m, 0.5 * _DRIVER_ACCELERATION * age_s * age_s)
    return fix._replace(east=fix.east + ve * dt, north=fix.north + vn * dt, up=fix.up + vu * dt, std_m=std_m)


class Pose(NamedTuple):
    """Roll, pitch and yaw, clockwise from north, at some time."""

    roll: float
    pitch: float
    yaw: float
    age_s: float
    """Time since the newest report at or before that time, s."""
    bracketed: bool
    """Interpolated, not extrapolated."""


class _Angles(NamedTuple):
    """Angles and their own rates, rad and rad/s."""

    roll: float
    pitch: float
    yaw: float
    roll_rate: float
    pitch_rate: float
    yaw_rate: float

    @property
    def has_rates(self) -> bool:
        """True if rates were sent: many senders leave all of them at zero."""
        return any(self[3:])


class Attitudes:
    """Attitudes of one vehicle by its boot time in µs."""

    def __init__(self) -> None:
        self._buffer: SampleBuffer[_Angles] = SampleBuffer()

    def clear(self) -> None:
        """Remove every attitude, for a vehicle that has rebooted."""
        self._buffer.clear()

    def times(self, after_us: int, until_us: int) -> list[int]:
        """Times of the attitudes after one and up to another."""
        return self._buffer.times(after_us, until_us)

    @property
    def newest(self) -> tuple[int, _Angles] | None:
        """The newest attitude and its time."""
        return self._buffer.newest

    @staticmethod
    def is_possible(sample: Attitude) -> bool:
        """Tell whether the angles are numbers within a whole turn."""
        return abs(sample.roll) <= _MAX_ANGLE and abs(sample.pitch) <= _MAX_ANGLE and abs(sample.yaw) <= _MAX_ANGLE

    def add(self, boot_us: int, sample: Attitude) -> bool:
        """Keep one report; False when it is no attitude, too late or there already."""
        if not self.is_possible(sample):
            return False
        return self._buffer.add(boot_us, _angles(sample)) is Insertion.ADDED

    def at(self, boot_us: int) -> Pose | None:
        """Attitude at a time: between two reports interpolated, after the last extrapolated by its rates.

        Each angle goes the short way round. Returns None before the first report.
        """
        before, after = self._buffer.around(boot_us)
        if before is None:
            return None
        t0, a = before
        age_s = (boot_us - t0) * 1e-6
        if after is not None and after[0] - t0 <= _ATTITUDE_GAP_US:
            roll, pitch, yaw = _between(a, after[1], (boot_us - t0) / (after[0] - t0), (after[0] - t0) * 1e-6)
            return Pose(wrap_pi(roll), pitch, wrap_pi(yaw), age_s, True)
        dt = min(age_s, ATTITUDE_LOST_S)
        # ∫ e^(−t/τ) dt: roll and pitch come to rest, a turn goes on
        sway_s = _SWAY_S * -math.expm1(-dt / _SWAY_S)
        return Pose(
            wrap_pi(a.roll + a.roll_rate * sway_s),
            a.pitch + a.pitch_rate * sway_s,
            wrap_pi(a.yaw + a.yaw_rate * dt),
            age_s,
            False,
        )

    def yaw_at(self, boot_us: int) -> float:
        """Yaw alone at a time; NaN before the first report and where the last one is lost."""
        before, after = self._buffer.around(boot_us)
        if before is None or boot_us - before[0] >= ATTITUDE_LOST_S * 1e6:
            return math.nan
        if after is not None and (pose := self.at(boot_us)):
            return pose.yaw
        t0, a = before
        return wrap_pi(a.yaw + a.yaw_rate * ((boot_us - t0) * 1e-6))


def _between(a: _Angles, b: _Angles, s: float, dt: float) -> tuple[float, float, float]:
    """Angles a share s of the ``dt`` seconds after a: cubic Hermite where rates were sent and fit, else linear."""
    turned = [wrap_pi(y - x) for x, y in zip(a[:3], b[:3], strict=True)]
    h10 = h11 = 0.0
    h01 = s
    if dt * 1e6 <= _RATE_GAP_US and a.has_rates and b.has_rates and _rates_fit(a, b, turned, dt):
        # x = x0 + h01 Δ + h10 dt ẋ0 + h11 dt ẋ1
        h10, h01, h11 = s * (1.0 - s) ** 2, s * s * (3.0 - 2.0 * s), -s * s * (1.0 - s)
    roll, pitch, yaw = (
        x + h01 * by + dt * (h10 * rate_a + h11 * rate_b)
        for x, by, rate_a, rate_b in zip(a[:3], turned, a[3:], b[3:], strict=True)
    )
    return roll, pitch, yaw


def _rates_fit(a: _Angles, b: _Angles, turned: list[float], dt: float) -> bool:
    # Δ / dt − (ẋ0 + ẋ1) / 2
    off = (by / dt - 0.5 * (u + v) for by, u, v in zip(turned, a[3:], b[3:], strict=True))
    return sum(rate * rate for rate in off) < _RATE_MISFIT**2


def _angles(sample: Attitude) -> _Angles:
    """Angles and their own rates from body rates p, q, r.

    θ̇ = q cos φ − r sin φ,  ψ̇ = (q sin φ + r cos φ) / cos θ,  φ̇ = p + ψ̇ sin θ
    """
    p, q, r = (v if abs(v) <= _MAX_RATE else 0.0 for v in (sample.roll_rate, sample.pitch_rate, sample.yaw_rate))
    sin_roll, cos_roll = math.sin(sample.roll), math.cos(sample.roll)
    cos_pitch = math.cos(sample.pitch)
    if abs(cos_pitch) < _GIMBAL_LOCK:
        return _Angles(sample.roll, sample.pitch, sample.yaw, 0.0, 0.0, 0.0)
    yaw_rate = (q * sin_roll + r * cos_roll) / cos_pitch
    pitch_rate = q * cos_roll - r * sin_roll
    return _Angles(sample.roll, sample.pitch, sample.yaw, p + yaw_rate * math.sin(sample.pitch), pitch_rate, yaw_rate)
