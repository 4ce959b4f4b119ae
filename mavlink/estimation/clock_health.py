"""Whether a vehicle's clocks run right: their drift and their idea of Unix time. No position depends on it."""

from __future__ import annotations

import math

from mavlink.estimation.clock import VehicleClock
from mavlink.estimation.timesync import Exchanges
from mavlink.protocol.messages import SystemTime, TimeSync

__all__ = ["CLOCK_ERROR_S", "DRIFT_PPM", "Timekeeping"]

CLOCK_ERROR_S = 30.0
"""A vehicle's Unix time is wrong beyond this: a receiver that has not yet heard of the leap seconds is 18 s off."""
DRIFT_PPM = 300.0
"""A vehicle's clock is wrong beyond this: crystals are within some tens of ppm, autopilots measure 120–150 ppm."""
_WEEK_S = 7 * 86400.0
_ROLLOVER_WEEKS = 1024  # GPS counts weeks modulo this


class Timekeeping:
    """Of one vehicle."""

    def __init__(self) -> None:
        self.error_s = math.nan
        """The vehicle's Unix time minus ours, NaN before it has one."""
        self._exchanges = Exchanges()

    def restart(self) -> None:
        """The vehicle has rebooted."""
        self.error_s = math.nan
        self._exchanges.clear()

    @property
    def round_trip_s(self) -> float:
        """Least time there and back lately, NaN while nobody asks."""
        return self._exchanges.round_trip_s

    def drift_ppm(self, clock: VehicleClock) -> float:
        """By how much Unix time runs faster than the vehicle's clock: by exchanges, else by arrivals, else NaN."""
        drift = self._exchanges.drift
        if not math.isnan(drift):
            return drift * 1e6
        return clock.drift * 1e6 if clock.drift_known else math.nan

    def fault(self, clock: VehicleClock) -> str:
        """What is wrong with its clocks, in words; empty while nothing is."""
        drift_ppm, measured = self.drift_ppm(clock), not math.isnan(self._exchanges.drift)
        if abs(drift_ppm) > DRIFT_PPM and (measured or clock.drift_sure):
            return f"it runs {abs(drift_ppm):,.0f} ppm {'slow' if drift_ppm > 0 else 'fast'}"
        if not abs(self.error_s) > CLOCK_ERROR_S:
            return ""
        rollovers = round(self.error_s / (_ROLLOVER_WEEKS * _WEEK_S))
        if rollovers and abs(self.error_s - rollovers * _ROLLOVER_WEEKS * _WEEK_S) < _WEEK_S:
            return f"its date is {rollovers * _ROLLOVER_WEEKS:+d} weeks off (GPS week number rollover)"
        return f"its date is {self.error_s:+,.0f} s off"

    def update(self, sample: SystemTime | TimeSync) -> None:
        """Takes in one message about time."""
        if isinstance(sample, TimeSync):
            self._exchanges.take(sample)
        elif sample.unix_us:
            self.error_s = (sample.unix_us - sample.t_us) * 1e-6
