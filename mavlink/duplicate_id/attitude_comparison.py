"""Attitudes that several senders of one system id report at the same time: can they be of one vehicle?"""

from __future__ import annotations

import math
from typing import NamedTuple

from mavlink.estimation.interpolation import Pose
from mavlink.geodesy import wrap_pi
from mavlink.protocol.messages import Attitude
from mavlink.reception.reception import SenderKey

_MAX_SENDERS = 8
"""Senders compared; a flood of addresses must cost neither memory nor time."""
_GAP, _GAP_RATE = math.radians(10.0), math.radians(60.0)
"""Two attitudes of one vehicle differ by no more than this, and by no more than this per second between them."""
_TOGETHER_US = 300_000
"""Attitudes this close in time are compared."""


class AttitudeConflict(NamedTuple):
    """Another sender whose attitude contradicts this one's."""

    other: SenderKey
    gap: float
    """Radians."""


class AttitudeComparison:
    """The newest attitude of each sender."""

    def __init__(self) -> None:
        self._newest: dict[SenderKey, tuple[int, int, Attitude]] = {}

    def add(self, sender: SenderKey, boot_us: int, sample: Attitude) -> AttitudeConflict | None:
        """Keeps an attitude and compares it with those of others a moment ago."""
        self._newest.pop(sender, None)
        conflict = None
        for other, (other_us, t_us, newest) in self._newest.items():
            if abs(sample.t_us - t_us) < _TOGETHER_US and abs(boot_us - other_us) < _TOGETHER_US:
                dt_s = abs(boot_us - other_us) * 1e-6
                if turned_too_far(sample, newest, dt_s):
                    conflict = AttitudeConflict(other, _largest_difference(sample, newest))
        if len(self._newest) >= _MAX_SENDERS:
            del self._newest[next(iter(self._newest))]
        self._newest[sender] = (boot_us, sample.t_us, sample)
        return conflict


def turned_too_far(one: Attitude | Pose, other: Attitude | Pose, dt_s: float) -> bool:
    """Tell whether no vehicle turns this far in this time."""
    return _largest_difference(one, other) > _GAP + _GAP_RATE * dt_s


def _largest_difference(one: Attitude | Pose, other: Attitude | Pose) -> float:
    """Radians, of the angle that differs most."""
    return max(
        abs(wrap_pi(one.roll - other.roll)), abs(wrap_pi(one.pitch - other.pitch)), abs(wrap_pi(one.yaw - other.yaw))
    )
