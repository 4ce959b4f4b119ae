"""Trust in one vehicle's positions, beyond what each report shows by itself.

- :class:`PositionRejections` counts what was not used, and why.
- :class:`RepeatedPositions` finds out whether one position comes over and over.
- :class:`JumpDetector` finds positions that jump to and fro, as of a receiver that is jammed or fails.
- :class:`GpsReceivers` keeps what the vehicle's receivers report of their fix.
- :class:`PositionDoubts` collects what the vehicle's own autopilot and receiver report against its position.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Hashable
from dataclasses import dataclass
from typing import NamedTuple

from infra.reporting import Throttle
from mavlink.estimation.interpolation import LOST_S, Fix, PositionEstimate, horizontal_distance_m
from mavlink.estimation.positions import NOT_YET, Verdict
from mavlink.geodesy import LocalFrame
from mavlink.protocol.messages import FilterStatus, GpsRaw, Heartbeat, SensorHealth, StatusText
from mavlink.protocol.modes import fix_name
from mavlink.reception.reception import SenderKey
from mavlink.reception.rejected_packets import REPORT_AGAIN_US
from mavlink.state import Level

_REPEATED_US = 1_000_000
"""Time after which a position that comes again is no copy of another radio, nor one of a receiver with slow fixes."""
_JUMPS, _JUMPS_US = 3, 10_000_000
"""Jumps (there, back and there again), and the time within which they count as jumping to and fro."""
_AWAY_US = 2_000_000
"""Time away that counts likewise: longer than a place that is held needs to be accepted."""
_SETTLED_US = 3_000_000
"""Time after the last jump in which a vehicle settles."""
_FIX_LASTS_US = 5_000_000
"""GPS_RAW_INT comes once a second; older ones no longer describe the receiver."""
_FIX_STEADY_US = 5_000_000
"""A fix that has not changed for this long does not come and go."""
_MAX_RECEIVERS = 16
"""Channels and components remembered: a flood of addresses must not cost memory."""
_HOLD_US = 5_000_000
"""Reports of filters and sensors come once a second."""
_JUMP_HOLD_US = 1_000_000
"""A jump ends with the place that was accepted: the event stays, the alarm lasts long enough to be seen."""
_TEXT_HOLD_US = 60_000_000
"""Hold of a text without a text that ends it: the radio may have lost that one."""
_FAILED_RATIO = 1.0
"""Innovation over what the filter allows: from here on it rejects the measurement."""
_M_PER_RATIO = 5.0
"""Metres of innovation for a unit of that ratio, at most, with the gates that autopilots ship with."""
_UNKNOWN_M, _UNAIDED_M = 10.0, 30.0
"""1σ while the size of an error is unknown, and of a position that no outside measurement corrects."""
_GAP_M, _GAP_S, _GAP_STDS = 8.0, 0.3, 3.0
"""Receiver and filter may differ by this distance, by what a vehicle moves in this time (the receiver's own delay), and
by this many σ of the receiver."""
_GAPS = 2
"""Fixes in a row that have to be too far apart."""
_FIX_3D, _COMPARED_S = 3, 0.5
"""Fix type that is compared, and the longest extrapolation of the estimate with which it is."""
_CRITICAL = 5
"""MAV_STATE of an autopilot in a failsafe."""
_SERIOUS = 3
"""MAV_SEVERITY of an error."""
_BEGIN = ("gps glitch", "ekf variance", "ekf failsafe", "position estimate lost", "jamming", "spoofing")
_END = ("glitch cleared", "failsafe cleared", "variance cleared")
"""Parts of ArduPilot's and PX4's status texts."""


class PositionRejections:
    """Counts what one vehicle reported and what was not used, by reason."""

    def __init__(self) -> None:
        self.positions = 0
        """Positions that could not be right."""
        self.last_us = 0
        """Arrival of the last of them, 0 never."""
        self.reason = ""
        """Reason of the last rejection, while no good position has come since."""
        self.reports = Throttle(REPORT_AGAIN_US)
        self._counts: dict[str, int] = {}

    def count(self, reason: str) -> None:
        """Count a value that is left out; the rest of its report may be used."""
        self._counts[reason] = self._counts.get(reason, 0) + 1

    def add_position(self, t_us: int, reason: str, *, had_position: bool) -> Level | None:
        """Count a position that cannot be right.

        Returns:
            How urgently an operator should know; None where it was reported a moment ago.
        """
        self.count(reason)
        self.positions += 1
        self.last_us, self.reason = t_us, reason
        if not self.reports.due(reason, t_us):
            return None
        return "warning" if had_position or reason not in NOT_YET else "info"

    @property
    def counts(self) -> dict[str, int]:
        """Counts by reason, in order of first occurrence."""
        return dict(self._counts)


class RepeatedPositions:
    """Finds out whether all that comes is one position, of one place though the vehicle drives, or of one time.

    A parked vehicle's reports are of new times and of no speed: they may be of one place.
    """

    def __init__(self) -> None:
        self._new_us = self._again_us = 0

    def add(self, verdict: Verdict, t_us: int) -> None:
        """Add a report's verdict and its arrival, Unix µs; that of a time that came before is ``DUPLICATE``."""
        if verdict.accepted:
            self._new_us = t_us
        elif verdict in (Verdict.FROZEN, Verdict.DUPLICATE):
            self._again_us = t_us

    def add_copy(self, t_us: int) -> None:
        """Add the arrival of a packet that came before byte for byte, as do those that repeat once the count of packets
        has come round; it proves nothing by itself."""
        if self.lasts(t_us):
            self._again_us = t_us

    def lasts(self, t_us: int) -> bool:
        """Tell whether nothing but the same has come for a second and more, and still comes at a Unix time, µs."""
        return self._again_us - self._new_us > _REPEATED_US and abs(t_us - self._again_us) < LOST_S * 1e6


class JumpDetector:
    """Finds out whether a vehicle's own position jumps to and fro, as that of a receiver which is jammed or fails.

    A jump that stays, or one bad report, does not count.
    """

    def __init__(self) -> None:
        self._good_channel: Hashable = None
        self._good_fix: Fix | None = None
        self._away_fix: Fix | None = None
        self._jumps_us: deque[int] = deque(maxlen=_JUMPS)
        self._away_us = 0
        self._last_us = 0

    def add(self, verdict: Verdict, channel: Hashable, t_us: int, fix: Fix) -> None:
        """Add a report.

        Args:
            verdict: from :meth:`mavlink.estimation.positions.Positions.add`.
            channel: how it came; another sender's reports are no jumps of this one's.
            t_us: Unix µs of its arrival.
        """
        if verdict.impossible:
            if channel != self._good_channel:
                return
            if not self._away_us:
                self._away_us = t_us
                self._jumps_us.append(t_us)
            self._last_us, self._away_fix = t_us, fix
        elif verdict.accepted:
            if self._away_us and channel == self._good_channel:
                self._last_us = t_us
                if verdict is not Verdict.MOVED and self._is_back(fix):
                    self._jumps_us.append(t_us)
            self._good_channel, self._good_fix, self._away_us = channel, fix, 0

    def is_jumping(self, t_us: int) -> bool:
        """Tell whether it jumps to and fro at a Unix time, or did until a moment ago."""
        if not 0 <= t_us - self._last_us < _SETTLED_US:
            return False
        away = self._away_us > 0 and self._last_us - self._away_us >= _AWAY_US
        return away or (len(self._jumps_us) == _JUMPS and self._last_us - self._jumps_us[0] < _JUMPS_US)

    def _is_back(self, fix: Fix) -> bool:
        """Tell whether a position continues from before a jump, not just from a place within reach of where it led."""
        if self._good_fix is None or self._away_fix is None:
            return False
        return horizontal_distance_m(fix, self._good_fix) < horizontal_distance_m(fix, self._away_fix)


class _FixChange(NamedTuple):
    t_us: int
    was: str
    fix: str


class GpsReceivers:
    """GPS_RAW_INT of one system, kept by channel and component.

    What another sender reports, over another link or as another component, must not take the fix from positions that
    come with a report of their own.
    """

    def __init__(self) -> None:
        self._newest: dict[tuple[int, int, int], GpsRaw] = {}
        self._change = _FixChange(0, "", "")
        self._flapping = False

    def add(self, sample: GpsRaw, sender: SenderKey) -> tuple[Level, str]:
        """Keep a report; return what an operator should know, an empty text for nothing.

        A fix that comes and goes is reported once, and once more when it is steady again.
        """
        key, last, fix = _receiver_key(sender), self._change, fix_name(sample.fix_type)
        before = self._newest.pop(key, None)
        if len(self._newest) >= _MAX_RECEIVERS:
            del self._newest[next(iter(self._newest))]
        self._newest[key] = sample
        lately = 0 <= sample.t_us - last.t_us < _FIX_STEADY_US
        was = fix_name(before.fix_type) if before is not None else fix
        if was == fix:
            if not self._flapping or lately:
                return "info", ""
            self._flapping = False
            return "info", f"GPS fix {fix}, steady again"
        self._change = _FixChange(sample.t_us, was, fix)
        if lately and (self._flapping or (was, fix) == last[1:]):
            return "info", ""  # or the same over another link
        self._flapping = lately and fix == last.was
        if self._flapping:
            return "warning", f"GPS fix comes and goes: {last.was}, {last.fix}"
        worse = before is not None and sample.fix_type < min(before.fix_type, _FIX_3D)
        return "warning" if worse else "info", f"GPS fix {fix}, was {was}"

    def of_sender(self, t_us: int, sender: SenderKey) -> GpsRaw | None:
        """The report of the last seconds over a sender's channel; where there is none, over another."""
        own = self._newest.get(_receiver_key(sender))
        if own is not None and t_us - own.t_us < _FIX_LASTS_US:
            return own
        return self.of_component(t_us, sender.component)

    def of_component(self, t_us: int, component_id: int) -> GpsRaw | None:
        """The newest report of the last seconds from one component, over whatever channel."""
        for key in reversed(self._newest):
            if key[2] == component_id:
                newest = self._newest[key]
                return newest if t_us - newest.t_us < _FIX_LASTS_US else None
        return None


def _receiver_key(sender: SenderKey) -> tuple[int, int, int]:
    return sender.link, sender.peer, sender.component


class Doubt(NamedTuple):
    """Reason to doubt a position, and its 1σ."""

    reason: str
    std_m: float


@dataclass(slots=True)
class _Evidence:
    since_us: int
    until_us: int
    doubt: Doubt


class PositionDoubts:
    """Doubts of one vehicle about its own position; times are those of arrival, Unix µs.

    Evidence of five kinds: its filter's report (test ratios and flags), sensors that it calls unhealthy, status texts,
    a receiver that is elsewhere than the filter, and a jump. Each ends with the first report to the contrary, or when
    it is not repeated.
    """

    def __init__(self) -> None:
        self._evidence: dict[str, _Evidence] = {}
        self._compass_until_us = 0
        self._largest_m = 0.0
        self._gaps = 0
        self._critical = self._armed = False
        self._was_healthy: set[str] = set()

    def at(self, t_us: int) -> Doubt | None:
        """The doubt now, None without one. Its σ is the largest since it began: an error does not shrink meanwhile."""
        now = [e.doubt for e in self._evidence.values() if e.since_us <= t_us < e.until_us]
        if not now:
            return None
        return Doubt(now[0].reason, max(self._largest_m, *(doubt.std_m for doubt in now)))

    def compass_doubted(self, t_us: int) -> bool:
        """Tell whether its compass contradicts its filter, so that its heading is doubtful."""
        return t_us < self._compass_until_us

    def add_health(self, sample: FilterStatus | SensorHealth) -> None:
        """EKF_STATUS_REPORT, ESTIMATOR_STATUS or SYS_STATUS."""
        if isinstance(sample, FilterStatus):
            self._add_filter(sample)
        else:
            self._update_settled("gps", sample.t_us, sample.gps, "GPS unhealthy", _UNKNOWN_M)
            self._update_settled("estimate", sample.t_us, sample.estimate, "estimate unhealthy", _UNKNOWN_M)

    def _add_filter(self, sample: FilterStatus) -> None:
        t_us, ratio = sample.t_us, max(sample.position_ratio, sample.velocity_ratio)
        self._compass_until_us = t_us + _HOLD_US if sample.compass_ratio >= _FAILED_RATIO else 0
        if not sample.started:
            return
        stated_m = sample.accuracy_m if math.isfinite(sample.accuracy_m) else 0.0
        self._update("glitch", t_us, sample.glitch, "GPS glitch", max(_UNKNOWN_M, stated_m))
        size_m = max(_M_PER_RATIO * sample.position_ratio, _UNKNOWN_M, stated_m)
        self._update("ratio", t_us, ratio >= _FAILED_RATIO, "its filter refuses its receiver", size_m)
        unaided_m = max(_UNAIDED_M, stated_m)
        self._update_settled("unaided", t_us, sample.aided, "nothing corrects its estimate", unaided_m)
        if not any(e.until_us > t_us for kind, e in self._evidence.items() if kind != "text"):
            self._evidence.pop("text", None)

    def add_text(self, sample: StatusText, text: str) -> None:
        """STATUSTEXT as put together; only errors about the position count."""
        lower = text.lower()
        if any(words in lower for words in _END):
            self._evidence.pop("text", None)
        elif sample.severity <= _SERIOUS and any(words in lower for words in _BEGIN):
            self._add("text", sample.t_us, _TEXT_HOLD_US, Doubt(f'it says "{text}"', _UNKNOWN_M))

    def add_heartbeat(self, sample: Heartbeat) -> None:
        """An autopilot that leaves its failsafe ends the doubt of a text, also when the text that ends it was lost."""
        if self._critical and sample.status != _CRITICAL:
            self._evidence.pop("text", None)
        self._critical, self._armed = sample.status == _CRITICAL, sample.armed

    def add_fix(self, sample: GpsRaw, std_m: float, then: PositionEstimate | None, frame: LocalFrame) -> None:
        """Compare a receiver's own fix with what the filter makes of it.

        Args:
            std_m: 1σ of it.
            then: the vehicle's position at the moment of the fix.
            frame: ENU.
        """
        if then is None or not (then.bracketed or then.age_s <= _COMPARED_S) or sample.fix_type < _FIX_3D:
            return
        east, north, _ = frame.to_enu_point(sample.lat_deg, sample.lon_deg, frame.alt_m + then.fix.up)
        gap_m = math.hypot(east - then.fix.east, north - then.fix.north)
        speed = math.hypot(then.fix.v_east, then.fix.v_north)
        apart = gap_m > _GAP_M + _GAP_STDS * std_m + _GAP_S * (speed if math.isfinite(speed) else 0.0)
        self._gaps = self._gaps + 1 if apart else 0
        if not apart or self._gaps >= _GAPS:
            self._update("gap", sample.t_us, apart, "receiver and estimate are apart", gap_m)

    def add_jump(self, t_us: int, gap_m: float) -> None:
        """A position far from the one before was accepted."""
        self._add("jump", t_us, _JUMP_HOLD_US, Doubt("it jumped", gap_m))

    def _update(self, kind: str, t_us: int, wrong: bool, reason: str, std_m: float) -> None:
        if wrong:
            self._add(kind, t_us, _HOLD_US, Doubt(reason, std_m))
        else:
            self._evidence.pop(kind, None)

    def _update_settled(self, kind: str, t_us: int, healthy: bool | None, reason: str, std_m: float) -> None:
        """Equivalent of ``_update`` for what is unhealthy in every vehicle just switched on, until it has settled;
        None: not in use."""
        if healthy:
            self._was_healthy.add(kind)
        self._update(kind, t_us, healthy is False and (self._armed or kind in self._was_healthy), reason, std_m)

    def _add(self, kind: str, t_us: int, hold_us: int, doubt: Doubt) -> None:
        if self.at(t_us) is None:
            self._largest_m = 0.0
        self._largest_m = max(self._largest_m, doubt.std_m)
        before = self._evidence.get(kind)
        since_us = before.since_us if before is not None and before.until_us > t_us else t_us
        self._evidence[kind] = _Evidence(since_us, t_us + hold_us, doubt)
