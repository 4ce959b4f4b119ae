"""One vehicle's attitude by its own boot time: interpolated, or carried on with its rates."""

from __future__ import annotations

import math
from typing import NamedTuple

from mavlink.estimation.sample_buffer import History
from mavlink.geodesy import wrap_pi
from mavlink.protocol.messages import Attitude

__all__ = ["ATTITUDE_LOST_S", "Attitudes", "Pose"]

ATTITUDE_LOST_S = 0.5
_BRACKET_US = 1_000_000
_FULL = 2.0 * math.pi + 1e-3
_MOST_RATE = 50.0  # rad/s, faster than anything that carries an autopilot turns


class Pose(NamedTuple):
    """Roll, pitch and yaw, clockwise from north, at some time."""

    roll: float
    pitch: float
    yaw: float
    age_s: float
    """Since the newest report at or before that time."""
    bracketed: bool


class _Row(NamedTuple):
    roll: float
    pitch: float
    yaw: float
    roll_rate: float
    pitch_rate: float
    yaw_rate: float


class Attitudes:
    """Attitudes of one vehicle; boot times in µs."""

    def __init__(self) -> None:
        self._history: History[_Row] = History()

    def clear(self) -> None:
        """Forgets every attitude, for a vehicle that has rebooted."""
        self._history.clear()

    @staticmethod
    def possible(sample: Attitude) -> bool:
        """Whether the angles are numbers, and such as angles are sent."""
        return abs(sample.roll) <= _FULL and abs(sample.pitch) <= _FULL and abs(sample.yaw) <= _FULL

    def take(self, boot_us: int, sample: Attitude) -> bool:
        """Keeps one report, unless it is no attitude, too late or there already."""
        if not self.possible(sample):
            return False
        return self._history.add(boot_us, _row(sample)) == "added"

    def at(self, boot_us: int) -> Pose | None:
        """Attitude at a time, each angle the short way round; None before the first report."""
        before, after = self._history.around(boot_us)
        if before is None:
            return None
        t0, a = before
        age_s = (boot_us - t0) * 1e-6
        if after is not None and after[0] - t0 <= _BRACKET_US:
            s = (boot_us - t0) / (after[0] - t0)
            roll, pitch, yaw = (x + s * wrap_pi(y - x) for x, y in zip(a[:3], after[1][:3], strict=True))
            return Pose(wrap_pi(roll), pitch, wrap_pi(yaw), age_s, True)
        dt = min(age_s, ATTITUDE_LOST_S)
        return Pose(
            wrap_pi(a.roll + a.roll_rate * dt),
            a.pitch + a.pitch_rate * dt,
            wrap_pi(a.yaw + a.yaw_rate * dt),
            age_s,
            False,
        )


def _row(sample: Attitude) -> _Row:
    """Angles and their own rates from body rates p, q, r.

    θ̇ = q cos φ − r sin φ,  ψ̇ = (q sin φ + r cos φ) / cos θ,  φ̇ = p + ψ̇ sin θ
    """
    p, q, r = (v if abs(v) <= _MOST_RATE else 0.0 for v in (sample.roll_rate, sample.pitch_rate, sample.yaw_rate))
    sin_roll, cos_roll = math.sin(sample.roll), math.cos(sample.roll)
    cos_pitch = math.cos(sample.pitch)
    if abs(cos_pitch) < 0.1:  # near straight up or down the angles' rates mean nothing
        return _Row(sample.roll, sample.pitch, sample.yaw, 0.0, 0.0, 0.0)
    yaw_rate = (q * sin_roll + r * cos_roll) / cos_pitch
    pitch_rate = q * cos_roll - r * sin_roll
    return _Row(sample.roll, sample.pitch, sample.yaw, p + yaw_rate * math.sin(sample.pitch), pitch_rate, yaw_rate)
