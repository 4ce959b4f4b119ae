"""What a vehicle's clocks are worth: its drift, its idea of Unix time, its distance in time. Told, never relied on."""

from __future__ import annotations

import math
from collections.abc import Iterator

from mavlink.estimation.clock import VehicleClock
from mavlink.estimation.timesync import Exchanges
from mavlink.protocol.messages import SystemTime, TimeSync
from mavlink.reception.rejections import Told

__all__ = ["Timekeeping"]

_WEEK_S = 7 * 86400.0
_ROLLOVER_WEEKS = 1024  # GPS counts weeks modulo this
_WRONG_S = 60.0
_DRIFT_PPM = 300.0  # autopilots measure 120–150 ppm
_TELL_EVERY_US = 600_000_000


class Timekeeping:
    """Of one vehicle."""

    def __init__(self) -> None:
        self.error_s = math.nan
        """The vehicle's Unix time minus ours, NaN before it has one."""
        self._exchanges = Exchanges()
        self._told = Told(_TELL_EVERY_US)

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

    def take(self, sample: SystemTime | TimeSync, clock: VehicleClock) -> Iterator[str]:
        """One message about time; yields what an operator should know, now and then."""
        if isinstance(sample, TimeSync):
            self._exchanges.take(sample)
        elif sample.unix_us:
            self.error_s = (sample.unix_us - sample.t_us) * 1e-6
            yield from self._error_text(sample.t_us)
        yield from self._drift_text(sample.t_us, clock)

    def _drift_text(self, t_us: int, clock: VehicleClock) -> Iterator[str]:
        drift_ppm, exchanged = self.drift_ppm(clock), not math.isnan(self._exchanges.drift)
        if abs(drift_ppm) > _DRIFT_PPM and (exchanged or clock.drift_sure) and self._told.due("drift", t_us):
            way = "slow" if drift_ppm > 0 else "fast"
            yield f"its clock runs {abs(drift_ppm):.0f} ppm {way}; its positions are timed with that taken out"

    def _error_text(self, t_us: int) -> Iterator[str]:
        if abs(self.error_s) < _WRONG_S or not self._told.due("error", t_us):
            return
        spans = round(self.error_s / (_ROLLOVER_WEEKS * _WEEK_S))
        rest_s = self.error_s - spans * _ROLLOVER_WEEKS * _WEEK_S
        if spans and abs(rest_s) < _WEEK_S:
            yield f"its date is {spans * _ROLLOVER_WEEKS:+d} weeks off (GPS weeks rolled over): not used"
        else:
            yield f"its date is {self.error_s:+.0f} s off: not used"
