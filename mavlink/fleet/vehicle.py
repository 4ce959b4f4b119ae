"""One vehicle: its clock, positions, attitudes, receivers, mode and texts, from its packets.

A packet is counted first (:meth:`Vehicle.count_packet`); how it came is passed along with the decoded sample.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

from pymavlink.dialects.v20.ardupilotmega import MAVLINK_MSG_ID_GLOBAL_POSITION_INT

from infra.reporting import Throttle
from mavlink.duplicate_id.claimed_places import FRESH_BOOT_US
from mavlink.duplicate_id.components import NO_COMPONENT, Components, PositionSource, PositionSources
from mavlink.duplicate_id.duplicate_id import DuplicateIdDetector
from mavlink.duplicate_id.sender_path import MAX_LINK_LAG_US
from mavlink.estimation.clock import ClockFit, ClockReading, OtherClocks, VehicleClock
from mavlink.estimation.clock_health import ClockHealth
from mavlink.estimation.gimbal import GimbalSample
from mavlink.estimation.interpolation import LOST_S, Attitudes, Fix, PositionEstimate
from mavlink.estimation.origin import FLEET_SPAN_M
from mavlink.estimation.position_quality import (
    Doubt,
    GpsReceivers,
    JumpDetector,
    PositionDoubts,
    PositionRejections,
    RepeatedPositions,
)
from mavlink.estimation.positions import (
    FIX_2D,
    UNSTEADY_ALTITUDE,
    Positions,
    VehicleLimits,
    Verdict,
    fix_of,
    place_error,
    position_stds,
)
from mavlink.fleet.condition import ConditionReports
from mavlink.geodesy import LocalFrame
from mavlink.protocol.messages import (
    Attitude,
    FilterStatus,
    GlobalPosition,
    GpsRaw,
    Heartbeat,
    SensorHealth,
    StatusText,
    SystemTime,
    TimeSync,
)
from mavlink.protocol.modes import fix_name
from mavlink.protocol.packet import Packet
from mavlink.reception.reception import Arrival, ChannelLag, Reception, SenderKey
from mavlink.state import Level, Notice, PositionState, VehicleStatus

_REPEATED_US = 5_000_000
"""Time within which the same text is a repetition."""
_PIECE_BYTES = 50
"""Length of STATUSTEXT's field: a shorter piece is the last of its text."""
_MAX_CHARS, _MAX_OPEN = 1000, 8
"""Most characters of one text, and most texts that wait for further pieces: any sender can send them."""
_WARNING = 4
"""MAV_SEVERITY; lower is more serious."""
Notices = tuple[Notice, ...]
_CHANGE_US = 200_000
"""Shortest time between two changes of mode; a flood of forged heartbeats changes more often."""
_GPS_FRESH_US = 5_000_000
"""A fix whose own time is farther than this from now carries another clock's time."""
_OTHER_AUTOPILOT_US = 600_000_000
"""Interval between reports of a second autopilot: a companion that claims to be one does so for a whole flight."""
_SHARED_CLOCK_US = 500_000
"""A component whose messages come no later than this after the autopilot's of the same boot time has its clock."""
_DELAY_GAIN, _DELAY_ASYMMETRY = 0.05, 9.0
"""Step of the usual delay towards one that is longer, and by how much smaller one towards a shorter delay is."""
_JUMPING = "it jumps between places, receiver jammed or failing"


class StatusTexts:
    """STATUSTEXT messages in order of arrival."""

    def __init__(self) -> None:
        self.last = ""
        """The newest whole text."""
        self._last_us = 0
        self._pieces: dict[tuple[int, int], str] = {}

    def add(self, sample: StatusText) -> tuple[Level, str]:
        """The text to show; empty for a piece of a longer one and for a repetition within seconds."""
        level: Level = "info" if sample.severity > _WARNING else "warning" if sample.severity == _WARNING else "alarm"
        text = self._joined(sample) if sample.text_id else sample.text
        if not text or (text == self.last and sample.t_us - self._last_us < _REPEATED_US):
            return level, ""
        self.last, self._last_us = text, sample.t_us
        return level, text

    def _joined(self, sample: StatusText) -> str:
        """A long text once its last piece has come, empty before."""
        key = (sample.component_id, sample.text_id)
        text = self._pieces.pop(key, "") + sample.text
        if len(sample.text.encode()) >= _PIECE_BYTES and len(text) < _MAX_CHARS:
            while len(self._pieces) >= _MAX_OPEN:
                del self._pieces[next(iter(self._pieces))]
            self._pieces[key] = text
            return ""
        return text


class PositionReport(NamedTuple):
    """One GLOBAL_POSITION_INT, how it came and what it showed of the clock."""

    sample: GlobalPosition
    arrival: Arrival
    reading: ClockReading


class Vehicle:
    """One configured vehicle.

    Args:
        drives: a ground vehicle: its course fits its heading, its altitude may be wrong.
        links: names of the links by index, for messages to the operator.
        address: of a link's index and a peer's number, in words.
    """

    def __init__(
        self,
        system_id: int,
        *,
        drives: bool,
        limits: VehicleLimits,
        links: tuple[str, ...] = (),
        address: Callable[[int, int], str] = lambda link, peer: "",
    ) -> None:
        self.system_id = system_id
        self.clock = VehicleClock()
        self.positions = Positions(limits, drives=drives)
        self.attitudes = Attitudes()
        self.rejections = PositionRejections()
        self.doubts = PositionDoubts()
        self.conditions = ConditionReports(self.rejections.count)
        self._duplicate_id = DuplicateIdDetector(limits, drives=drives, links=links, address=address)
        self._other_clocks = OtherClocks(self.clock)
        self.usual_delay_us = 0.0
        """Delay of most messages behind the quickest of them, µs: the 0.9 expectile of their delays."""
        self._drives, self._limits = drives, limits
        self._reception, self._clock_health = Reception(), ClockHealth()
        self._components, self._receivers = Components(), GpsReceivers()
        self._sources = PositionSources()
        self._jumps, self._repeats, self._texts = JumpDetector(), RepeatedPositions(), StatusTexts()
        self._change_reports, self._autopilot_reports = Throttle(_CHANGE_US), Throttle(_OTHER_AUTOPILOT_US)

    def count_packet(self, packet: Packet, message_id: int) -> Arrival | None:
        """Count a packet of a known message; None for a duplicate of one that came before."""
        arrival = self._reception.add_packet(packet, message_id)
        if arrival is None and message_id == MAVLINK_MSG_ID_GLOBAL_POSITION_INT:
            self._repeats.add_copy(packet.t_us)
        if arrival is not None and packet.component_id == self._components.autopilot:
            self._duplicate_id.add_sender(arrival.sender, packet.t_us)
        return arrival

    def reject_packet(self, packet: Packet) -> Notices:
        """Count a packet whose signature forbids to use it."""
        level, text = self._reception.reject_packet(packet)
        if not text:
            return ()
        channel = self._duplicate_id.channel_text(SenderKey(packet.link, packet.peer, 0))
        return (self._notice(packet.t_us, level, f"system {self.system_id}: {text} ({channel})"),)

    def add_heartbeat(self, sample: Heartbeat, arrival: Arrival) -> Iterator[Notice]:
        """HEARTBEAT of an autopilot; only that of the vehicle's own describes it."""
        t_us, sender = sample.t_us, arrival.sender
        first = self._components.heartbeat is None
        own = self._note_component(sample.component_id, t_us, heartbeat=True)
        self._duplicate_id.compare_autopilots(t_us, sender, self._components.rival(t_us))
        if own:
            yield from self._add_own_heartbeat(sample, arrival, first)
        elif self._autopilot_reports.due(f"{sample.component_id}", t_us):
            text = f"system {self.system_id}: component {sample.component_id} claims to be the autopilot too"
            yield self._notice(t_us, "warning", f"{text} ({self._duplicate_id.channel_text(sender)})")
        yield from self.conflict_notices(t_us)

    def _add_own_heartbeat(self, sample: Heartbeat, arrival: Arrival, first: bool) -> Iterator[Notice]:
        t_us, sender = sample.t_us, arrival.sender
        kinds = self._duplicate_id.compare_kind(sample, sender)
        if arrival.lag is not ChannelLag.BEHIND:
            self._duplicate_id.compare_mode(sample, sender)
        if self._reception.is_outdated(arrival, t_us):
            return
        before = self._components.heartbeat
        self._components.keep_heartbeat(sample)
        self.doubts.add_heartbeat(sample)
        if first:
            text = f"{self._components.kind} {self.system_id} is there, {self._components.mode}"
            yield self._notice(t_us, "info", text)
        elif before is not None and not self.in_conflict(t_us):
            if kinds and self._duplicate_id.reports.due("kind", t_us):
                text = f"system {self.system_id} was a {kinds[0]} and reports to be a {kinds[1]}"
                yield self._notice(t_us, "warning", text)
            if before.armed != sample.armed and self._change_reports.due("armed", t_us):
                yield self._notice(t_us, "info", "armed" if sample.armed else "disarmed")
            if before.custom_mode != sample.custom_mode and self._change_reports.due("mode", t_us):
                yield self._notice(t_us, "info", f"mode {self._components.mode}")

    def _note_component(self, component_id: int, t_us: int, *, heartbeat: bool) -> bool:
        """Tell whether a component is the vehicle's autopilot; if it became that, the other's samples are dropped."""
        components = self._components
        before = components.autopilot
        note = components.add_heartbeat if heartbeat else components.add_report
        own = note(component_id, t_us)
        if own and before not in (NO_COMPONENT, component_id):
            self.clock.reset()
            self._other_clocks.clear()
            self._sources = PositionSources()
            self._drop_samples()
            self.doubts = PositionDoubts()
        return own

    def _drop_samples(self) -> None:
        self.positions.clear()
        self.attitudes.clear()
        self._clock_health.restart()
        self._jumps, self._repeats = JumpDetector(), RepeatedPositions()

    def add_health(self, sample: FilterStatus | SensorHealth, arrival: Arrival) -> Notices:
        """EKF_STATUS_REPORT, ESTIMATOR_STATUS and SYS_STATUS of the autopilot."""
        if sample.component_id == self._components.autopilot and not arrival.late:
            self.doubts.add_health(sample)
        return ()

    def doubt(self, t_us: int) -> Doubt | None:
        """Return why its positions may be wrong by its own report; None without doubt, or without positions."""
        return self.doubts.at(t_us) if self.positions.known and not self.in_conflict(t_us) else None

    def add_gps(self, sample: GpsRaw, arrival: Arrival, frame: LocalFrame | None) -> Iterator[Notice]:
        """GPS_RAW_INT; ``frame``: ENU, None unknown."""
        if arrival.late:
            return
        if frame is not None and sample.component_id == self._components.autopilot:
            now_us = self.clock.boot_of(sample.t_us)
            fix_us = sample.fix_us if abs(sample.fix_us - now_us) < _GPS_FRESH_US else now_us
            self.doubts.add_fix(sample, position_stds(sample, self._limits)[0], self.positions.at(fix_us), frame)
        level, text = self._receivers.add(sample, arrival.sender)
        if self._components.autopilot not in (NO_COMPONENT, sample.component_id) or self.in_conflict(sample.t_us):
            return
        if text:
            yield self._notice(sample.t_us, level, text)

    def raw_position(self, sample: GpsRaw) -> GlobalPosition | None:
        """The place that its receiver measured, dated by its arrival; None without altitude or where a better comes."""
        used = self._sources.used
        if sample.fix_type <= FIX_2D or (used is not None and not used.raw):
            return None
        return GlobalPosition(
            *(sample.t_us, sample.system_id, sample.component_id),
            boot_ms=0,
            lat_deg=sample.lat_deg,
            lon_deg=sample.lon_deg,
            alt_m=sample.alt_m,
            relative_alt_m=math.nan,
            v_north=sample.speed * math.cos(sample.course),
            v_east=sample.speed * math.sin(sample.course),
            v_down=math.nan,
            heading=math.nan,
        )

    def add_text(self, sample: StatusText) -> Iterator[Notice]:
        """STATUSTEXT; pieces of long texts are put together, repetitions within seconds are left out."""
        level, text = self._texts.add(sample)
        if text:
            if sample.component_id == self._components.autopilot:
                self.doubts.add_text(sample, text)
            yield Notice(t_us=sample.t_us, level=level, kind="text", text=text, system_id=self.system_id)

    def add_time(self, sample: SystemTime | TimeSync, arrival: Arrival) -> Notices:
        """SYSTEM_TIME and TIMESYNC of the autopilot: only ever reported, no position depends on them."""
        if self._components.autopilot not in (NO_COMPONENT, sample.component_id):
            return ()  # a companion's
        if self.in_conflict(sample.t_us):
            self._clock_health.restart()  # two clocks together drift like none
        self._clock_health.add(sample)
        # a late link may still bring the count before a reboot
        if isinstance(sample, SystemTime) and sample.unix_us and sample.boot_ms * 1000 > FRESH_BOOT_US:
            booted_us = sample.unix_us - sample.boot_ms * 1000
            self._duplicate_id.compare_boot_time(sample.t_us, arrival.sender, booted_us)
            return self.conflict_notices(sample.t_us)
        return ()

    def add_hardware_id(self, packet: Packet, arrival: Arrival) -> Notices:
        """AUTOPILOT_VERSION."""
        if self._components.autopilot not in (NO_COMPONENT, packet.component_id):
            return ()  # gimbals and companions send their own
        text = self._duplicate_id.compare_hardware(packet, arrival.sender, self.clock.epoch)
        notices = (self._notice(packet.t_us, "warning", f"system {self.system_id}: {text}"),) if text else ()
        return notices + self.conflict_notices(packet.t_us)

    def learn_clock(self, sample: Attitude | GlobalPosition, arrival: Arrival) -> tuple[ClockReading, Notices]:
        """Learn from a sample's boot time; what it shows of the clock, and notices."""
        clock, t_us, sender = self.clock, sample.t_us, arrival.sender
        own = sample.component_id == self._components.autopilot
        other = self._other_clocks.read(type(sample), sample.component_id, sample.boot_ms, t_us, own=own)
        if other is not None:
            return other, self.conflict_notices(t_us)
        if not clock.started:
            self._drop_samples()
        trails = self._duplicate_id.is_slower_link(sender)
        reading = clock.add_message(sample.boot_ms, t_us, trails=trails)
        if reading.fit is not ClockFit.OUTLIER:
            delay_us = t_us - clock.unix_of(reading.boot_us)
            if not reading.fit.late:
                self._learn_delay(delay_us)
            self._reception.set_delay(sender, max(delay_us, clock.params.late_us) if reading.fit.late else delay_us)
        if reading.new_epoch:
            self._drop_samples()
        if reading.rebooted:
            self.doubts = PositionDoubts()
            return reading, (self._notice(t_us, "warning", f"system {self.system_id} has rebooted"),)
        if reading.fit.fits:
            if sample.boot_ms:
                self._other_clocks.add_dated(type(sample))
            self._duplicate_id.add_usual_clock(t_us, sender)
        elif reading.fit is ClockFit.OUTLIER and not trails:
            reading = self._check_other_clock(reading, t_us, sender)
        return reading, self.conflict_notices(t_us)

    def boot_time(self, sample: GimbalSample) -> int | None:
        """Time of what one of its components measured, by the vehicle's own clock.

        Args:
            sample: dated by the autopilot's clock, or by that of a component; without a boot time by its arrival.

        Returns:
            Boot time, µs; None while the vehicle's clock has no anchor.
        """
        clock, t_us, component = self.clock, sample.t_us, sample.component_id
        if not clock.started or self._components.autopilot == NO_COMPONENT:
            return None
        boot_us = clock.boot_at(sample.boot_ms, t_us) if sample.boot_ms else None
        if sample.boot_ms and component != self._components.autopilot:
            own = self._other_clocks.of_component(component)
            counts_on = not own.started or own.boot_at(sample.boot_ms, t_us) != own.newest_us
            reading = own.add_message(sample.boot_ms, t_us)
            made_us = own.unix_of(reading.boot_us) if reading.fit.fits and counts_on else t_us
            # a component that was switched on with the autopilot counts nearly alike
            shared = boot_us is not None and abs(made_us - clock.unix_of(boot_us)) < _SHARED_CLOCK_US
            boot_us = boot_us if shared else clock.boot_of(made_us)
        if boot_us is None:
            return clock.boot_of(t_us)
        self._learn_delay(t_us - clock.unix_of(boot_us))
        return boot_us

    def _learn_delay(self, delay_us: float) -> None:
        gain = _DELAY_GAIN if delay_us > self.usual_delay_us else _DELAY_GAIN / _DELAY_ASYMMETRY
        self.usual_delay_us += gain * (delay_us - self.usual_delay_us)

    def _check_other_clock(self, reading: ClockReading, t_us: int, sender: SenderKey) -> ClockReading:
        """Decide whether an outlier is of a faster link, which the clock then follows, or of another sender."""
        if reading.boot_us < FRESH_BOOT_US or self.positions.has(reading.boot_us):
            return reading
        early_us = self.clock.unix_of(reading.boot_us) - t_us
        if 0 < early_us <= MAX_LINK_LAG_US and self._duplicate_id.is_faster_link(sender, t_us):
            return self.clock.follow_faster_link(reading, t_us)
        self._duplicate_id.add_other_clock(t_us, sender, -early_us * 1e-6)
        return reading

    def is_from_autopilot(self, sample: Attitude | GlobalPosition) -> bool:
        """Tell whether the component that sends it is the vehicle's autopilot."""
        return self._note_component(sample.component_id, sample.t_us, heartbeat=False)

    def is_position_source(self, sample: GlobalPosition, *, raw: bool) -> bool:
        """Tell whether the vehicle's positions are taken from what sends this one.

        Args:
            raw: of its receiver, not of its autopilot's filter.
        """
        before = self._sources.used
        source = PositionSource(self.is_from_autopilot(sample), raw, sample.component_id)
        used = self._sources.add(source, sample.t_us)
        if before not in (None, self._sources.used):
            self._other_clocks.clear()
            self._drop_samples()
        return used

    def is_in_time(self, arrival: Arrival) -> bool:
        """Tell whether a report did not come over a late channel, and count it where it did."""
        if arrival.late:
            self.rejections.count("over a link that is seconds late")
        return not arrival.late

    def add_attitude(self, sample: Attitude, arrival: Arrival, reading: ClockReading) -> None:
        """ATTITUDE or ATTITUDE_QUATERNION."""
        if not reading.fit.fits:
            if reading.fit.late and reading.boot_us > FRESH_BOOT_US:
                then = self.attitudes.at(reading.boot_us)
                self._duplicate_id.compare_late_attitude(sample, arrival.sender, then)
            return
        if self._duplicate_id.several_senders(sample.t_us):
            self._duplicate_id.compare_attitude(reading.boot_us, sample, arrival.sender)
        if not self.attitudes.add(reading.boot_us, sample) and not self.attitudes.is_possible(sample):
            self.rejections.count("attitude that is none")

    def reject_position(self, t_us: int, reason: str) -> Notices:
        """Count a position that is not used; a notice when the reason is new or was not reported for a while."""
        level = self.rejections.add_position(t_us, reason, had_position=self.positions.known)
        return (self._notice(t_us, level, f"position not used: {reason}"),) if level is not None else ()

    def compare_place(self, sample: GlobalPosition, arrival: Arrival) -> str:
        """Compare a place with those of other senders, whichever component reports it.

        Returns:
            Why the report is no place at all, and was not compared; empty when it may be one.
        """
        gps = self._receivers.of_sender(sample.t_us, arrival.sender)
        error = place_error(sample, gps)
        if not error:
            self._duplicate_id.compare_place(sample, arrival.sender, position_stds(gps, self._limits)[0])
        return error

    def add_position(self, report: PositionReport, frame: LocalFrame, home_alt_m: float) -> tuple[Fix | None, Notices]:
        """Check a report that is a place, and keep it when it can be right.

        Returns:
            The position in ENU (``frame``, home plane at ``home_alt_m``) if it is new evidence, and notices.
        """
        sample, (sender, *_), reading = report
        t_us = sample.t_us
        heading = self.positions.check_heading(sample, self.attitudes.yaw_at(reading.boot_us))
        stds_m = position_stds(self._receivers.of_sender(t_us, sender), self._limits)
        fix, left_out = fix_of(
            *(sample, frame, home_alt_m),
            heading=heading,
            steady=self.positions.check_altitude,
            stds_m=stds_m,
            limits=self._limits,
            drives=self._drives,
        )
        for reason in left_out:
            self.rejections.count(reason)
        if not math.isfinite(fix.up):
            return None, self.reject_position(t_us, "altitude unknown")
        if not reading.fit.fits:
            self._reject_time(reading, t_us)
            return None, ()
        before = self.positions.newest
        verdict = self.positions.add(reading.boot_us, fix, (sample.lat_deg, sample.lon_deg))
        self._repeats.add(verdict, t_us)
        jumped = self._jumps.is_jumping(t_us)
        self._jumps.add(verdict, sender[:2], t_us, fix)
        if self._jumps.is_jumping(t_us):
            self.rejections.count(_JUMPING)
            if jumped or not self.rejections.reports.due(_JUMPING, t_us):
                return None, ()
            return None, (self._notice(t_us, "warning", f"positions not used: {_JUMPING}"),)
        if verdict.impossible:
            return None, self.reject_position(t_us, verdict.reason)
        notices: Notices = ()
        if verdict.accepted:
            self.rejections.reason = ""
        elif verdict is not Verdict.DUPLICATE:
            self.rejections.count(verdict.reason)
        if verdict is Verdict.MOVED:
            gap_m = math.dist(fix[:3], before[1][:3]) if before is not None else 0.0
            self.doubts.add_jump(t_us, gap_m)
            text = f"position jumped by {gap_m:,.0f} m and stayed there: accepted"
            notices = (self._notice(t_us, "alarm", text),)
        notices += self._altitude_notices(t_us, left_out)
        evidence = verdict in (Verdict.NEW, Verdict.MOVED) and not self.in_conflict(t_us)
        return fix if evidence else None, notices

    def _reject_time(self, reading: ClockReading, t_us: int) -> None:
        """Count a position whose time is not of the clock; it may be the newest one's, which comes again."""
        newest = self.positions.newest
        if newest is not None and reading.boot_us == newest[0]:
            self._repeats.add(Verdict.DUPLICATE, t_us)
        self.rejections.count("seconds late" if reading.fit.late else "of another clock")

    def _altitude_notices(self, t_us: int, left_out: tuple[str, ...]) -> Notices:
        if UNSTEADY_ALTITUDE not in left_out or not self.rejections.reports.due(UNSTEADY_ALTITUDE, t_us):
            return ()
        return (self._notice(t_us, "warning", f"not used: {UNSTEADY_ALTITUDE}"),)

    def change_frame(self, before: LocalFrame, now: LocalFrame) -> None:
        """Convert all that is kept of places to another local frame."""
        self.positions.change_frame(before, now, FLEET_SPAN_M)
        self._jumps = JumpDetector()

    def in_conflict(self, t_us: int) -> bool:
        """Tell whether two senders use this system id at a Unix time."""
        return self._duplicate_id.in_conflict(t_us)

    def is_trusted(self, t_us: int) -> bool:
        """Tell whether one sender alone reports its places, and they do not jump."""
        return not (self.in_conflict(t_us) or self._jumps.is_jumping(t_us))

    def conflict_notices(self, t_us: int) -> Notices:
        """Notices when a second sender was found or is gone, or another component is the autopilot or reports."""
        reports = self._duplicate_id.report(t_us, self.system_id), self._components.report(), self._sources.report()
        if not any(text for _, text in reports):
            return ()
        return tuple(self._notice(t_us, level, text) for level, text in reports if text)

    def estimate(self, t_us: int) -> PositionEstimate | None:
        """Return its position at a Unix time, µs; None before its first report."""
        return self.positions.at(self.clock.boot_of(t_us))

    def status(self, t_us: int, estimate: PositionEstimate | None) -> VehicleStatus:
        """One line of the fleet table, for a time and what was estimated for it."""
        heartbeat, reception, doubt = self._components.heartbeat, self._reception, self.doubt(t_us)
        rejected_packets, jumping = reception.rejections, self._jumps.is_jumping(t_us)
        contested = self.in_conflict(t_us)
        gps = self._receiver(t_us)
        position_state = self.position_state(t_us, estimate)
        return VehicleStatus(
            system_id=self.system_id,
            kind=self._components.kind,
            mode=self._components.mode,
            armed=heartbeat.armed if heartbeat else None,
            fix=fix_name(gps.fix_type) if gps else "",
            heartbeat_age_s=max(0.0, (t_us - heartbeat.t_us) * 1e-6) if heartbeat else math.inf,
            position_age_s=estimate.age_s if estimate else math.inf,
            position_state=position_state,
            frozen=position_state in ("stale", "lost") and self._repeats.lasts(t_us),
            period_s=self.positions.period_s,
            loss=reception.loss,
            refused=self.rejections.positions,
            last_text=self._texts.last,
            contested=contested,
            refusals=self.rejections.counts,
            refused_for=_JUMPING if jumping else self.rejections.reason,
            jumps=jumping,
            copies=reception.duplicates,
            signed=reception.signed,
            unsigned=reception.unsigned + rejected_packets.unsigned,
            bad_signature=rejected_packets.bad_signature,
            replayed=rejected_packets.replayed,
            held=rejected_packets.held,
            held_s=rejected_packets.held_s(t_us),
            signs=rejected_packets.signatures_good(t_us),
            link=reception.newest_link,
            channels=reception.channels(t_us),
            drift_ppm=self._clock_health.drift_ppm(self.clock),
            round_trip_s=self._clock_health.round_trip_s,
            clock_error_s=self._clock_health.error_s,
            clock_fault="" if contested else self._clock_health.fault(self.clock),
            condition=self.conditions.at(t_us, self._components.autopilot),
            hardware=self._duplicate_id.hardware_text,
            doubted_for=doubt.reason if doubt is not None else "",
            compass_doubted=self.doubts.compass_doubted(t_us),
        )

    def _receiver(self, t_us: int) -> GpsRaw | None:
        """The last report of the receiver that its positions come from, else of its autopilot's."""
        used = self._sources.used
        gps = self._receivers.of_component(t_us, used.component_id) if used is not None else None
        return gps or self._receivers.of_component(t_us, self._components.autopilot)

    def position_state(self, t_us: int, estimate: PositionEstimate | None) -> PositionState:
        """Reliability of the position."""
        if not self.is_trusted(t_us):
            return "contested" if self.in_conflict(t_us) else "refused"
        rejected = self.rejections.last_us > 0 and t_us - self.rejections.last_us < LOST_S * 1e6
        return self.positions.state(estimate, self.rejections.reason if rejected else "")

    def _notice(self, t_us: int, level: Level, text: str) -> Notice:
        return Notice(t_us=t_us, level=level, kind="vehicle", text=text, system_id=self.system_id)
