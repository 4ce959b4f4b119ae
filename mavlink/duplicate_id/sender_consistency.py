"""What each of several speakers of one system id says of its attitude: do they tell of one vehicle?"""

from __future__ import annotations

import math
from typing import NamedTuple

from mavlink.estimation.attitudes import Pose
from mavlink.geodesy import wrap_pi
from mavlink.protocol.messages import Attitude
from mavlink.reception.reception import Speaker

__all__ = ["AttitudeTracks", "Turned", "turned"]

_MOST = 8
_ATTITUDE, _ATTITUDE_RATE = math.radians(10.0), math.radians(60.0)
_ATTITUDE_US = 300_000


class Turned(NamedTuple):
    """Another speaker whose attitude this one's rules out."""

    other: Speaker
    gap: float
    """Radians."""


class AttitudeTracks:
    """Attitudes by speaker."""

    def __init__(self) -> None:
        self._tracks: dict[Speaker, tuple[int, int, Attitude]] = {}

    def take(self, speaker: Speaker, boot_us: int, sample: Attitude) -> Turned | None:
        """Keeps an attitude and compares it with those of others a moment ago."""
        tracks = self._tracks
        tracks.pop(speaker, None)
        dissent = None
        for other, (other_us, t_us, row) in tracks.items():
            if abs(sample.t_us - t_us) < _ATTITUDE_US and abs(boot_us - other_us) < _ATTITUDE_US:
                dt = abs(boot_us - other_us) * 1e-6
                if turned(sample, row, dt):
                    dissent = Turned(other, _between(sample, row))
        if len(tracks) >= _MOST:
            del tracks[next(iter(tracks))]
        tracks[speaker] = (boot_us, sample.t_us, sample)
        return dissent


def turned(one: Attitude | Pose, other: Attitude | Pose, dt_s: float) -> bool:
    """Whether a vehicle does not turn so far in so short a time."""
    return _between(one, other) > _ATTITUDE + _ATTITUDE_RATE * dt_s


def _between(one: Attitude | Pose, other: Attitude | Pose) -> float:
    """Radians about the axis that differs most."""
    return max(
        abs(wrap_pi(one.roll - other.roll)), abs(wrap_pi(one.pitch - other.pitch)), abs(wrap_pi(one.yaw - other.yaw))
    )
