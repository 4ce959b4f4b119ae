"""Health of a vehicle's clocks: their drift and their Unix time. No position depends on it.

The round trip is measured by TIMESYNC: we ask with tc1 = 0, ts1 = s, our Unix time in ns; the vehicle answers tc1 = b,
its boot time, ts1 = s; the answer arrives at a. With equal ways there and back b is our (s + a) / 2, and never off by
more than (a − s) / 2 (Cristian, Distributed Computing 3, 1989, doi:10.1007/BF01784024: the exchange with the least
round trip is the one to trust). A request that carries our Unix time identifies its answer: one to another station does
not fit.
"""

from __future__ import annotations

import math
from collections import deque

from mavlink.estimation.clock import VehicleClock
from mavlink.protocol.messages import SystemTime, TimeSync

_MAX_ROUND_TRIP_US = 2_000_000
"""Longest round trip; an answer that took longer is one to another request."""
_BIN_US, _BINS = 10_000_000, 60
"""The exchange with the least round trip of each ten seconds is kept, for ten minutes."""
_FIT_AFTER_US = 30_000_000
"""Span that the exchanges need for a drift to be fitted."""
_MAX_DRIFT_ERROR = 100e-6
"""Largest error, by half the round trips, with which a drift counts as known."""

CLOCK_ERROR_S = 30.0
"""Error of a vehicle's Unix time beyond which it is wrong: a receiver that does not know the leap seconds yet is 18 s
off."""
DRIFT_PPM = 300.0
"""Drift beyond which a vehicle's clock is wrong: crystals are within some tens of ppm, autopilots measure 120–150
ppm."""
_WEEK_S = 7 * 86400.0
_ROLLOVER_WEEKS = 1024
"""Weeks after which GPS counts from 0 again."""


class TimeSyncExchanges:
    """TIMESYNC exchanges with one vehicle since it booted."""

    def __init__(self) -> None:
        self.round_trip_s = math.nan
        """Least of the last ten minutes, NaN before any."""
        self._bins: deque[tuple[int, int, float]] = deque(maxlen=_BINS)  # start of the bin, least trip, offset then

    def clear(self) -> None:
        """Remove all, for a vehicle that has rebooted."""
        self._bins.clear()
        self.round_trip_s = math.nan

    def add(self, sample: TimeSync) -> bool:
        """Take in a TIMESYNC; return False where it answers no request of ours."""
        sent_us, boot_us = sample.ts1_ns // 1000, sample.tc1_ns // 1000
        trip_us = sample.t_us - sent_us
        if boot_us <= 0 or not 0 <= trip_us <= _MAX_ROUND_TRIP_US:
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
        error_us = sum(trip for _, trip, _ in self._bins) / len(self._bins)
        if span_us < _FIT_AFTER_US or error_us > _MAX_DRIFT_ERROR * span_us:
            return math.nan
        # least squares: Σ (b − b̄)(o − ō) / Σ (b − b̄)²
        n = len(self._bins)
        mean_b = sum(b for b, _, _ in self._bins) / n
        mean_o = sum(o for _, _, o in self._bins) / n
        square = sum((b - mean_b) ** 2 for b, _, _ in self._bins)
        return sum((b - mean_b) * (o - mean_o) for b, _, o in self._bins) / square


class ClockHealth:
    """Record of one vehicle's clocks."""

    def __init__(self) -> None:
        self.error_s = math.nan
        """The vehicle's Unix time minus ours, NaN before it has one."""
        self._exchanges = TimeSyncExchanges()

    def restart(self) -> None:
        """Start again, for a vehicle that has rebooted."""
        self.error_s = math.nan
        self._exchanges.clear()

    @property
    def round_trip_s(self) -> float:
        """Least round trip lately, NaN while no request is sent."""
        return self._exchanges.round_trip_s

    def drift_ppm(self, clock: VehicleClock) -> float:
        """Rate by which Unix time runs faster than the vehicle's clock: by exchanges, else by arrivals, else NaN."""
        drift = self._exchanges.drift
        if not math.isnan(drift):
            return drift * 1e6
        return clock.drift * 1e6 if clock.drift_known else math.nan

    def fault(self, clock: VehicleClock) -> str:
        """Fault of its clocks, in words; empty while nothing is."""
        if clock.off_rate:
            return f"it runs at {100.0 * clock.off_rate:.0f} % of real time; its reports are dated by arrival"
        drift_ppm, measured = self.drift_ppm(clock), not math.isnan(self._exchanges.drift)
        if abs(drift_ppm) > DRIFT_PPM and (measured or clock.drift_sure):
            return f"it runs {abs(drift_ppm):,.0f} ppm {'slow' if drift_ppm > 0 else 'fast'}"
        if not abs(self.error_s) > CLOCK_ERROR_S:
            return ""
        rollovers = round(self.error_s / (_ROLLOVER_WEEKS * _WEEK_S))
        if rollovers and abs(self.error_s - rollovers * _ROLLOVER_WEEKS * _WEEK_S) < _WEEK_S:
            return f"its date is {rollovers * _ROLLOVER_WEEKS:+d} weeks off (GPS week number rollover)"
        return f"its date is {self.error_s:+,.0f} s off"

    def add(self, sample: SystemTime | TimeSync) -> None:
        """Add one message about time."""
        if isinstance(sample, TimeSync):
            self._exchanges.add(sample)
        elif sample.unix_us:
            self.error_s = (sample.unix_us - sample.t_us) * 1e-6
