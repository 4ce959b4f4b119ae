"""Exchanges of clock readings with a vehicle: how far away it is, and how its clock drifts.

We ask with TIMESYNC tc1 = 0, ts1 = s, our Unix time in ns; it answers tc1 = b, its boot time, ts1 = s; the answer
arrives at a. With equal ways there and back b is our (s + a) / 2, and never off by more than (a − s) / 2 (Cristian,
Distributed Computing 3, 1989, doi:10.1007/BF01784024: the exchange with the least round trip is the one to trust).
A question that holds our Unix time proves itself: an answer to another station's clock does not fit.
"""

from __future__ import annotations

import math
from collections import deque

from mavlink.protocol.messages import TimeSync

__all__ = ["Exchanges"]

_MOST_TRIP_US = 2_000_000
_BIN_US = 10_000_000
_BINS = 60
_FIT_AFTER_US = 30_000_000
_DOUBT = 100e-6


class Exchanges:
    """Exchanges with one vehicle since it booted."""

    def __init__(self) -> None:
        self.round_trip_s = math.nan
        """Least of the last ten minutes, NaN before any."""
        self._bins: deque[tuple[int, int, float]] = deque(maxlen=_BINS)  # start of the bin, least trip, offset then

    def clear(self) -> None:
        """Forgets everything, for a vehicle that has rebooted."""
        self._bins.clear()
        self.round_trip_s = math.nan

    def take(self, sample: TimeSync) -> bool:
        """One TIMESYNC; False when it is no answer to a question of ours."""
        sent_us, boot_us = sample.ts1_ns // 1000, sample.tc1_ns // 1000
        trip_us = sample.t_us - sent_us
        if boot_us <= 0 or not 0 <= trip_us <= _MOST_TRIP_US:
            return False
        # offset = (s + a) / 2 − b
        offset_us = sent_us + trip_us / 2 - boot_us
        bins = self._bins
        if bins and 0 <= boot_us - bins[-1][0] < _BIN_US:
            if trip_us < bins[-1][1]:
                bins[-1] = (bins[-1][0], trip_us, offset_us)
        else:
            bins.append((boot_us, trip_us, offset_us))
        self.round_trip_s = min(trip for _, trip, _ in bins) * 1e-6
        return True

    @property
    def drift(self) -> float:
        """Seconds that Unix time gains on the vehicle's clock per second, NaN until it is known to 100 ppm."""
        if len(self._bins) < 3:
            return math.nan
        span_us = self._bins[-1][0] - self._bins[0][0]
        # each offset may be off by half its trip
        doubt_us = sum(trip for _, trip, _ in self._bins) / len(self._bins)
        if span_us < _FIT_AFTER_US or doubt_us > _DOUBT * span_us:
            return math.nan
        # least squares: Σ (b − b̄)(o − ō) / Σ (b − b̄)²
        n = len(self._bins)
        mean_b = sum(b for b, _, _ in self._bins) / n
        mean_o = sum(o for _, _, o in self._bins) / n
        square = sum((b - mean_b) ** 2 for b, _, _ in self._bins)
        return sum((b - mean_b) * (o - mean_o) for b, _, o in self._bins) / square
