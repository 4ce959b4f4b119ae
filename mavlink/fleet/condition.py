"""Condition of one vehicle by its own reports: battery, satellites, radio, filter, sensors and arming checks."""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable
from dataclasses import replace
from typing import TypeVar, get_args

from mavlink.protocol.messages import (
    BatteryStatus,
    FilterStatus,
    GpsRaw,
    Heartbeat,
    RadioStatus,
    Sample,
    SecondGps,
    SensorHealth,
    StatusText,
)
from mavlink.state import ARMING_FAILURES, VehicleCondition

_MAX_SOURCES = 16
"""Batteries, receivers and components that are remembered of each kind: a flood of ids must not cost memory."""
_MAX_REASONS = 8
"""Reasons against arming."""
_GONE_US = 30_000_000
"""Silence after which one is gone while another reports: slow links bring one report in ten seconds."""
_REASON_US = 60_000_000
"""A reason against arming that is not repeated for this long is gone: ArduPilot repeats those that hold every 30 s."""
_PAYLOAD = 4
"""MAV_BATTERY_FUNCTION of what does not drive."""
_STATES = {2: "low", 3: "critical", 4: "emergency", 5: "failed", 6: "unhealthy"}
_MAX_SATELLITES = 100
"""Most satellites above any horizon."""
_UNKNOWN_RSSI = 255

_ConditionSample = BatteryStatus | SensorHealth | FilterStatus | GpsRaw | SecondGps | Heartbeat | StatusText
_CONDITION_SAMPLES = get_args(_ConditionSample)
"""Samples with a part of the condition: most others are positions and attitudes."""

Power = TypeVar("Power", BatteryStatus, SensorHealth)
Source = TypeVar("Source", BatteryStatus, SensorHealth, FilterStatus, GpsRaw | SecondGps)


class ConditionReports:
    """Keeps the newest reports of each kind.

    Args:
        count: called with the reason where a value cannot be right and is left out.

    Attributes:
        channel: link and peer that its packets come over, −1 and 0 before any.
    """

    def __init__(self, count: Callable[[str], None]) -> None:
        self.channel = -1, 0
        self._count = count
        self._batteries: dict[Hashable, BatteryStatus] = {}
        self._sensors: dict[Hashable, SensorHealth] = {}
        self._filters: dict[Hashable, FilterStatus] = {}
        self._receivers: dict[Hashable, GpsRaw | SecondGps] = {}
        self._radio_us, self._radio = 0, math.nan
        self._reasons: dict[str, int] = {}

    def add(self, sample: Sample | None, channel: tuple[int, int]) -> None:
        """Take in one message, of whatever kind, that came over a channel."""
        self.channel = channel
        if isinstance(sample, _CONDITION_SAMPLES):
            self._keep(sample)

    def _keep(self, sample: _ConditionSample) -> None:
        if isinstance(sample, BatteryStatus):
            if sample.function != _PAYLOAD:
                _keep(self._batteries, (sample.component_id, sample.battery_id), self._checked(sample))
        elif isinstance(sample, SensorHealth):
            _keep(self._sensors, sample.component_id, self._checked(sample))
        elif isinstance(sample, FilterStatus):
            _keep(self._filters, sample.component_id, sample)
        elif isinstance(sample, GpsRaw | SecondGps):
            if sample.satellites > _MAX_SATELLITES:
                self._count("satellites that cannot be")
            else:
                _keep(self._receivers, (sample.component_id, type(sample)), sample)
        elif isinstance(sample, Heartbeat) and sample.armed:
            self._reasons.clear()
        elif isinstance(sample, StatusText) and sample.text.startswith(ARMING_FAILURES):
            self._reasons.pop(sample.text, None)
            while len(self._reasons) >= _MAX_REASONS:
                del self._reasons[next(iter(self._reasons))]
            self._reasons[sample.text] = sample.t_us

    def add_radio(self, sample: RadioStatus, *, shared: bool) -> None:
        """RADIO_STATUS of the radio that its packets come through; ``shared``: and those of others too.

        The far end of a radio with several partners is that of any of them, so only the near end counts.
        """
        ends = [(sample.rssi, sample.noise)] if shared else [
            (sample.rssi, sample.noise),
            (sample.remote_rssi, sample.remote_noise),
        ]  # fmt: skip
        known = [rssi - noise for rssi, noise in ends if _UNKNOWN_RSSI not in (rssi, noise)]
        self._radio_us, self._radio = sample.t_us, float(min(known)) if known else math.nan

    def at(self, t_us: int, autopilot: int) -> VehicleCondition:
        """The condition at a Unix time in µs; of sensors and receivers those of the autopilot's component."""
        sensors, estimate = self._sensors.get(autopilot), self._filters.get(autopilot)
        monitor = self._lowest()
        battery = monitor or sensors
        receiver = self._best_receiver(autopilot)
        ratios = (estimate.position_ratio, estimate.velocity_ratio, estimate.compass_ratio) if estimate else ()
        return VehicleCondition(
            voltage_v=battery.voltage_v if battery else math.nan,
            charge=_share(battery.charge_percent) if battery else math.nan,
            battery=_STATES.get(monitor.state, "") if monitor else "",
            left_s=monitor.left_s if monitor else math.nan,
            power_age_s=_age_s(t_us, battery),
            satellites=receiver.satellites if receiver else -1,
            hdop=receiver.hdop if receiver else math.nan,
            receiver_age_s=_age_s(t_us, receiver),
            radio=self._radio,
            radio_age_s=max(0, t_us - self._radio_us) * 1e-6 if self._radio_us else math.inf,
            filter_ratio=max(ratios, default=math.nan),
            filter_age_s=_age_s(t_us, estimate),
            faults=sensors.unhealthy if sensors and t_us - sensors.t_us < _GONE_US else (),
            arming=self._arming(t_us, sensors),
        )

    def _arming(self, t_us: int, sensors: SensorHealth | None) -> tuple[str, ...]:
        checks = sensors.arming if sensors and t_us - sensors.t_us < _GONE_US else None
        since_us = sensors.t_us if sensors and checks else 0  # passed then: earlier reasons are over
        reasons = tuple(
            text.partition(": ")[2]
            for text, reported_us in self._reasons.items()
            if since_us <= reported_us and t_us - reported_us < _REASON_US
        )
        return reasons or (("no reason given",) if checks is False else ())

    def _lowest(self) -> BatteryStatus | None:
        """Battery with the lowest charge, else with the lowest voltage; None without any."""
        newest_us = max((each.t_us for each in self._batteries.values()), default=0)
        used = [
            each
            for each in self._batteries.values()
            if newest_us - each.t_us < _GONE_US and (each.charge_percent >= 0 or math.isfinite(each.voltage_v))
        ]
        charged = [each for each in used if each.charge_percent >= 0]
        if charged:
            return min(charged, key=lambda each: each.charge_percent)
        return min(used, key=lambda each: each.voltage_v, default=None)

    def _best_receiver(self, autopilot: int) -> GpsRaw | SecondGps | None:
        """Receiver with the better fix and more satellites: autopilots use that."""
        own = [self._receivers.get((autopilot, kind)) for kind in (GpsRaw, SecondGps)]
        found = [each for each in own if each is not None]
        newest_us = max((each.t_us for each in found), default=0)
        fresh = [each for each in found if newest_us - each.t_us < _GONE_US]
        return max(fresh, key=lambda each: (each.fix_type, each.satellites), default=None)

    def _checked(self, sample: Power) -> Power:
        """Return the report without a charge that cannot be."""
        if -1 <= sample.charge_percent <= 100:
            return sample
        self._count("battery charge that cannot be")
        return replace(sample, charge_percent=-1)


def _keep(reports: dict[Hashable, Source], key: Hashable, sample: Source) -> None:
    reports.pop(key, None)
    while len(reports) >= _MAX_SOURCES:
        del reports[next(iter(reports))]
    reports[key] = sample


def _share(percent: int) -> float:
    return percent / 100 if percent >= 0 else math.nan


def _age_s(t_us: int, sample: BatteryStatus | SensorHealth | FilterStatus | GpsRaw | SecondGps | None) -> float:
    return max(0, t_us - sample.t_us) * 1e-6 if sample is not None else math.inf
