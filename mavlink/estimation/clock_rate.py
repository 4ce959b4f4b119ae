"""Rate of a vehicle's clock where it is not ours, as that of a simulator on a busy computer.

A crystal is off by some tens of ppm, an RC oscillator by 4 % at most; a simulator runs at any rate, and changes it.
With b the boot time and a the arrival, the least a − b of each two seconds is what the link's delays leave; its slope
over the arrival is one minus the rate.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from itertools import pairwise

BIN_US = 2_000_000
"""The least delay of each such span counts: longer than a radio's hold-up usually is."""
BINS = 7
"""Spans that the rate is taken from: the edges of six, 12 s."""
REAL_BINS = 30
"""Spans, a minute, for which a clock has to run right to be followed again."""
OFF = 0.05
"""A rate that is off by more is no clock's."""
UNSTEADY, CHANGED = 0.02, 0.01
"""Error of a rate, and its change within seconds, with both of which it is no clock's."""
REAL = 0.005
"""Off by less, a clock can be followed."""
BACK_US, LEAP_US = 60_000_000, 600_000_000
"""Boot times that go back or ahead by more are another count's; less far back they are late copies."""


class ClockRate:
    """Rate of one vehicle's boot time."""

    def __init__(self) -> None:
        self._bins: deque[tuple[int, int]] = deque(maxlen=REAL_BINS)
        self._least: tuple[int, int] | None = None
        self._stop_us = self._newest = 0

    def add(self, boot_us: int, arrival_us: int) -> bool:
        """Learn from a message; True when something new is known."""
        if self._least is not None and not -BACK_US <= boot_us - self._newest <= LEAP_US:
            self.clear()
        self._newest = max(boot_us, self._newest)
        point = arrival_us, arrival_us - boot_us
        if self._least is None or arrival_us < self._stop_us - 2 * BIN_US:
            self._bins.clear()
            self._least, self._stop_us = point, arrival_us + BIN_US
            return False
        if arrival_us < self._stop_us:
            if point[1] < self._least[1]:
                self._least = point
            return False
        if arrival_us >= self._stop_us + 2 * BIN_US:
            self._bins.clear()  # a pause: what came before and after cannot be compared
        else:
            self._bins.append(self._least)
        self._least, self._stop_us = point, arrival_us + BIN_US
        return True

    def clear(self) -> None:
        """Forget all, for another count."""
        self._bins.clear()
        self._least, self._newest = None, 0

    @property
    def is_off(self) -> bool:
        """True if it runs at a rate that no clock has."""
        points = list(self._bins)[-BINS:]
        if len(points) < BINS:
            return False
        # all along: a queue that fills on the way takes some seconds
        slopes = [_slope(pair) for pair in pairwise(points)]
        least = max(min(slopes), min(-slope for slope in slopes))
        changes = abs(_slope(points[: BINS // 2 + 1]) - _slope(points[BINS // 2 :])) > CHANGED
        return least > OFF or (least > UNSTEADY and changes)

    @property
    def is_real(self) -> bool:
        """True if it has run as ours for a minute."""
        points = list(self._bins)
        if len(points) < REAL_BINS:
            return False
        parts = [points[k : k + BINS // 2 + 1] for k in range(0, REAL_BINS - BINS // 2, BINS // 2)]
        return all(abs(_slope(part)) < REAL for part in parts)

    @property
    def rate(self) -> float:
        """Rate of the last twelve seconds: 1 is as fast as ours."""
        points = list(self._bins)[-BINS:]
        return 1.0 - _slope(points) if len(points) > 1 else 1.0


def _slope(points: Sequence[tuple[int, int]]) -> float:
    """Slope of the line from the first to the last point."""
    (begin_us, before_us), (end_us, after_us) = points[0], points[-1]
    return (after_us - before_us) / (end_us - begin_us) if end_us > begin_us else 0.0
