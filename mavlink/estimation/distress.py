"""Whether a vehicle doubts its own position, by what its own autopilot and receiver say, and by how much.

Evidence of five kinds: its filter's report (test ratios and flags), sensors that it calls unhealthy, texts, a receiver
that is elsewhere than the filter, and a jump. Each ends with the first word to the contrary, or when nobody repeats it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from mavlink.estimation.positions import Estimate
from mavlink.geodesy import LocalFrame
from mavlink.protocol.messages import FilterStatus, GpsRaw, Heartbeat, SensorHealth, StatusText

__all__ = ["Distress", "Doubt"]

_HOLD_US = 5_000_000
"""Reports of filters and sensors come once a second."""
_JUMP_HOLD_US = 1_000_000
"""A jump is over with the place that was accepted: the event stays, the alarm lasts long enough to be seen."""
_TEXT_HOLD_US = 60_000_000
"""Of a text whose end is never told: its radio may have lost it."""
_FAILED_RATIO = 1.0
"""Innovation over what the filter allows: from here on it refuses the measurement."""
_M_PER_RATIO = 5.0
"""Metres of innovation a unit of that ratio stands for, at most, with the gates that autopilots ship with."""
_UNKNOWN_M, _UNAIDED_M = 10.0, 30.0
"""1σ while the size of an error is not told, and of a position that nothing from outside corrects."""
_GAP_M, _GAP_S = 8.0, 0.3
"""Receiver and filter may differ by this, and by what a vehicle moves in this time: the receiver's own delay."""
_GAPS = 2
_FIX_3D, _COMPARED_S = 3, 0.5
"""A fix is compared with an estimate that is carried on for no longer."""
_CRITICAL = 5
"""MAV_STATE of an autopilot in a failsafe."""
_SERIOUS = 3
"""MAV_SEVERITY of an error."""
_BEGIN = ("gps glitch", "ekf variance", "ekf failsafe", "position estimate lost", "jamming", "spoofing")
_END = ("glitch cleared", "failsafe cleared", "variance cleared")


class Doubt(NamedTuple):
    """Why a position is doubtful, and its 1σ."""

    reason: str
    std_m: float


@dataclass(slots=True)
class _Evidence:
    since_us: int
    until_us: int
    doubt: Doubt


class Distress:
    """What one vehicle says against its own position; times are those of arrival, Unix µs."""

    def __init__(self) -> None:
        self._found: dict[str, _Evidence] = {}
        self._compass_until_us = 0
        self._worst_m = 0.0
        self._gaps = 0
        self._critical = self._armed = False
        self._was_well: set[str] = set()

    def at(self, t_us: int) -> Doubt | None:
        """The doubt now, None without one. Its σ is the largest since it began: what is wrong stays as wrong."""
        now = [e.doubt for e in self._found.values() if e.since_us <= t_us < e.until_us]
        if not now:
            return None
        return Doubt(now[0].reason, max(self._worst_m, *(doubt.std_m for doubt in now)))

    def compass(self, t_us: int) -> bool:
        """Whether its compass contradicts its filter, so that its heading is doubtful."""
        return t_us < self._compass_until_us

    def take(self, sample: FilterStatus | SensorHealth) -> None:
        """EKF_STATUS_REPORT, ESTIMATOR_STATUS or SYS_STATUS."""
        if isinstance(sample, FilterStatus):
            self._filter(sample)
        else:
            self._judge_settled("gps", sample.t_us, sample.gps, "GPS unhealthy", _UNKNOWN_M)
            self._judge_settled("estimate", sample.t_us, sample.estimate, "estimate unhealthy", _UNKNOWN_M)

    def _filter(self, sample: FilterStatus) -> None:
        t_us, ratio = sample.t_us, max(sample.position_ratio, sample.velocity_ratio)
        self._compass_until_us = t_us + _HOLD_US if sample.compass_ratio >= _FAILED_RATIO else 0
        if not sample.started:
            return
        stated_m = sample.accuracy_m if math.isfinite(sample.accuracy_m) else 0.0
        self._judge("glitch", t_us, sample.glitch, "GPS glitch", max(_UNKNOWN_M, stated_m))
        size_m = max(_M_PER_RATIO * sample.position_ratio, _UNKNOWN_M, stated_m)
        self._judge("ratio", t_us, ratio >= _FAILED_RATIO, "its filter refuses its receiver", size_m)
        alone_m = max(_UNAIDED_M, stated_m)
        self._judge_settled("unaided", t_us, sample.aided, "nothing corrects its estimate", alone_m)
        if self._healthy(t_us):
            self._found.pop("text", None)

    def take_text(self, sample: StatusText, text: str) -> None:
        """STATUSTEXT as put together; only what is an error and speaks of the position counts."""
        said = text.lower()
        if any(words in said for words in _END):
            self._found.pop("text", None)
        elif sample.severity <= _SERIOUS and any(words in said for words in _BEGIN):
            self._add("text", sample.t_us, _TEXT_HOLD_US, Doubt(f'it says "{text}"', _UNKNOWN_M))

    def take_heartbeat(self, sample: Heartbeat) -> None:
        """An autopilot that leaves its failsafe has said so, also when the text was lost."""
        if self._critical and sample.status != _CRITICAL:
            self._found.pop("text", None)
        self._critical, self._armed = sample.status == _CRITICAL, sample.armed

    def take_receiver(self, sample: GpsRaw, std_m: float, then: Estimate | None, frame: LocalFrame) -> None:
        """A receiver's own fix against what the filter makes of it.

        Args:
            sample: GPS_RAW_INT.
            std_m: 1σ of it.
            then: the vehicle's position for the moment of the fix.
            frame: ENU.
        """
        if then is None or not (then.bracketed or then.age_s <= _COMPARED_S) or sample.fix_type < _FIX_3D:
            return
        east, north, _ = frame.to_enu_point(sample.lat_deg, sample.lon_deg, frame.alt_m + then.fix.up)
        gap_m = math.hypot(east - then.fix.east, north - then.fix.north)
        speed = math.hypot(then.fix.v_east, then.fix.v_north)
        wide = gap_m > _GAP_M + 3.0 * std_m + _GAP_S * (speed if math.isfinite(speed) else 0.0)
        self._gaps = self._gaps + 1 if wide else 0
        if not wide or self._gaps >= _GAPS:
            self._judge("gap", sample.t_us, wide, "receiver and estimate are apart", gap_m)

    def take_jump(self, t_us: int, gap_m: float) -> None:
        """A place far from the one before was accepted."""
        self._add("jump", t_us, _JUMP_HOLD_US, Doubt("it jumped", gap_m))

    def _healthy(self, t_us: int) -> bool:
        """Whether nothing but a text speaks against the position."""
        return not any(e.until_us > t_us for kind, e in self._found.items() if kind != "text")

    def _judge(self, kind: str, t_us: int, wrong: bool, reason: str, std_m: float) -> None:
        if wrong:
            self._add(kind, t_us, _HOLD_US, Doubt(reason, std_m))
        else:
            self._found.pop(kind, None)

    def _judge_settled(self, kind: str, t_us: int, well: bool | None, reason: str, std_m: float) -> None:
        """The same of what is unwell in every vehicle just switched on, until it has settled; None: not in use."""
        if well:
            self._was_well.add(kind)
        self._judge(kind, t_us, well is False and (self._armed or kind in self._was_well), reason, std_m)

    def _add(self, kind: str, t_us: int, hold_us: int, doubt: Doubt) -> None:
        if self.at(t_us) is None:
            self._worst_m = 0.0
        self._worst_m = max(self._worst_m, doubt.std_m)
        before = self._found.get(kind)
        since_us = before.since_us if before is not None and before.until_us > t_us else t_us
        self._found[kind] = _Evidence(since_us, t_us + hold_us, doubt)
