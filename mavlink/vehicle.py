"""Everything heard from one vehicle: its clock, positions, attitudes, receiver, mode and words."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

from mavlink.attitudes import Attitudes, Pose
from mavlink.clock import VehicleClock
from mavlink.distress import Distress, Doubt
from mavlink.gate import NOT_YET, GateParams, altitude_known, nonsense, position_std, speed_possible
from mavlink.geodesy import LocalFrame
from mavlink.modes import fix_name, kind_name, mode_name
from mavlink.origin import FLEET_SPAN_M
from mavlink.packet import Packet
from mavlink.positions import LOST_S, Estimate, Fix, Positions
from mavlink.reception import Reception, Speaker
from mavlink.refusals import Refusals, Told
from mavlink.samples import (
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
from mavlink.senders import Senders
from mavlink.state import Level, Notice, PositionState, VehicleStatus
from mavlink.texts import Texts
from mavlink.timekeeping import Timekeeping

__all__ = ["Vehicle"]

_GPS_FRESH_US = 5_000_000
_LATE_MOST_US = 60_000_000
_STALE_S = 1.0  # radios are a few tenths of a second late, and that is no trouble
_CHANGE_US = 200_000  # no vehicle changes its mode more often; a flood of forged ones does
_REFUSED_VERDICTS = {"jump": "farther than it can have driven", "leap": "higher or lower than it can have flown"}
_QUIET_VERDICTS = {"late": "out of order, seconds late", "frozen": "moving, and at the same place as before"}


class Vehicle:
    """One configured vehicle.

    Args:
        system_id: whose packets :meth:`heard` and the others get.
        drives: a ground vehicle: its course fits its heading, its altitude may be wrong.
        params: limits of what it can do.
        links: names of the links, by index, for what is told.
        address: of a link's index and a peer's number, in words.
    """

    def __init__(
        self,
        system_id: int,
        *,
        drives: bool,
        params: GateParams,
        links: tuple[str, ...] = (),
        address: Callable[[int, int], str] = lambda link, peer: "",
    ) -> None:
        self.system_id = system_id
        self.clock = VehicleClock()
        self.positions = Positions(params, drives=drives)
        self.attitudes = Attitudes()
        self.reception = Reception()
        self.refusals = Refusals()
        self.senders = Senders(params, links, address)
        self._drives = drives
        self._params = params
        self._times = Timekeeping()
        self._heartbeat: Heartbeat | None = None
        self._prompt = Speaker(-1, 0, 0), 0  # how and when the last one came that was not delayed
        self._component = 0  # whose positions and attitudes count; 0 until somebody speaks
        self._gps: GpsRaw | None = None
        self.distress = Distress()
        self._texts = Texts()
        self._changes = Told(_CHANGE_US)

    def heard(self, packet: Packet, message_id: int) -> bool:
        """Counts a packet of a known message; False for a copy of one that was heard before."""
        if not self.reception.take(packet, message_id):
            return False
        if packet.component_id == self._component:
            self.senders.speaks(self.reception.speaker, packet.t_us)
        return True

    def refuse_packet(self, packet: Packet) -> tuple[Notice, ...]:
        """Counts a packet that must not be believed for its signature."""
        level, text = self.reception.refuse(packet)
        if not text:
            return ()
        where = self.senders.where(Speaker(packet.link, packet.peer, 0))
        return (self._notice(packet.t_us, level, f"system {self.system_id}: {text} ({where})"),)

    def take_heartbeat(self, sample: Heartbeat) -> Iterator[Notice]:
        """HEARTBEAT of the autopilot; other components' are none of the vehicle's."""
        before = self._heartbeat
        alive = before is not None and abs(sample.t_us - before.t_us) < LOST_S * 1e6
        if before is not None and alive and sample.component_id != before.component_id:
            return  # a companion that says it is an autopilot, while the autopilot speaks
        kinds = self.senders.heartbeat(sample, self.reception.speaker)
        if not self.reception.behind:
            self.senders.mode(sample, self.reception.speaker)
        if self._outdated(sample.t_us):
            yield from self.contest_notices(sample.t_us)
            return
        if self.reception.prompt:
            self._prompt = self.reception.speaker, sample.t_us
        self._heartbeat = sample
        self._component = sample.component_id
        self.distress.take_heartbeat(sample)
        if before is None:
            yield self._notice(sample.t_us, "info", f"{self.kind} {self.system_id} is there, {self.mode}")
        elif not self.contested(sample.t_us):
            if kinds and self.senders.told.due("kind", sample.t_us):
                text = f"system {self.system_id} was a {kinds[0]} and says it is a {kinds[1]}"
                yield self._notice(sample.t_us, "warning", text)
            if before.armed != sample.armed and self._changes.due("armed", sample.t_us):
                yield self._notice(sample.t_us, "info", "armed" if sample.armed else "disarmed")
            if before.custom_mode != sample.custom_mode and self._changes.due("mode", sample.t_us):
                yield self._notice(sample.t_us, "info", f"mode {self.mode}")
        yield from self.contest_notices(sample.t_us)

    def _outdated(self, t_us: int) -> bool:
        """Whether the heartbeat taken last may tell how the vehicle was, while another radio tells how it is."""
        (link, peer, _), prompt_us = self._prompt
        speaker = self.reception.speaker
        elsewhere = (link, peer) != (speaker.link, speaker.peer)
        return not self.reception.prompt and elsewhere and abs(t_us - prompt_us) < LOST_S * 1e6

    def take_health(self, sample: FilterStatus | SensorHealth) -> tuple[Notice, ...]:
        """EKF_STATUS_REPORT, ESTIMATOR_STATUS and SYS_STATUS of the autopilot."""
        if sample.component_id == self._component and not self.reception.late:
            self.distress.take(sample)
        return ()

    def doubt(self, t_us: int) -> Doubt | None:
        """Why its positions may be wrong, by its own word; None without doubt, or without positions."""
        return self.distress.at(t_us) if self.positions.known and not self.contested(t_us) else None

    def take_gps(self, sample: GpsRaw, frame: LocalFrame | None) -> Iterator[Notice]:
        """GPS_RAW_INT; ``frame``: the local one, None unknown."""
        if self.reception.late:
            return
        if frame is not None and sample.component_id == self._component:
            now_us = self.clock.boot_of(sample.t_us)
            fix_us = sample.fix_us if abs(sample.fix_us - now_us) < _GPS_FRESH_US else now_us
            self.distress.take_receiver(sample, position_std(sample, self._params), self.positions.at(fix_us), frame)
        before, self._gps = self._gps, sample
        if before is None or fix_name(before.fix_type) == fix_name(sample.fix_type):
            return
        if self._changes.due("fix", sample.t_us):
            worse = sample.fix_type < min(before.fix_type, 3)
            text = f"GPS fix {fix_name(sample.fix_type)}, was {fix_name(before.fix_type)}"
            yield self._notice(sample.t_us, "warning" if worse else "info", text)

    def take_text(self, sample: StatusText) -> Iterator[Notice]:
        """STATUSTEXT; pieces of long texts are put together, repetitions within seconds are left out."""
        text = self._texts.take(sample)
        if text:
            if sample.component_id == self._component:
                self.distress.take_text(sample, text)
            level: Level = "alarm" if sample.severity <= 3 else "warning" if sample.severity == 4 else "info"
            yield Notice(t_us=sample.t_us, level=level, kind="text", text=text, system_id=self.system_id)

    def take_times(self, sample: SystemTime | TimeSync) -> Iterator[Notice]:
        """SYSTEM_TIME and TIMESYNC of the autopilot: only ever told, no position depends on them."""
        if self._component not in (0, sample.component_id):
            return  # a companion's
        if self.contested(sample.t_us):
            self._times.restart()  # two clocks together drift like none
        # a late link goes on telling of the count before a restart
        if isinstance(sample, SystemTime) and sample.unix_us and sample.t_us - self.clock.restarted_us > _LATE_MOST_US:
            self.senders.booted(sample.t_us, self.reception.speaker, sample.unix_us - sample.boot_ms * 1000)
            yield from self.contest_notices(sample.t_us)
        for text in self._times.take(sample, self.clock):
            yield self._notice(sample.t_us, "warning", f"system {self.system_id}: {text}")

    def take_hardware(self, packet: Packet) -> tuple[Notice, ...]:
        """AUTOPILOT_VERSION."""
        text = self.senders.hardware(packet, self.reception.speaker, self.clock.epoch)
        told = (self._notice(packet.t_us, "warning", f"system {self.system_id}: {text}"),) if text else ()
        return told + self.contest_notices(packet.t_us)

    def learn_time(self, boot_ms: int, sample: Attitude | GlobalPosition) -> tuple[int, tuple[Notice, ...]]:
        """Boot time in µs of a sample, and what the clock noticed."""
        clock = self.clock
        epoch, reboots = clock.epoch, clock.reboots
        boot_us = clock.learn(boot_ms, sample.t_us)
        if clock.late or not clock.stray:
            delay_us = sample.t_us - clock.unix_of(boot_us)
            self.reception.dated(max(delay_us, clock.params.late_us) if clock.late else delay_us)
        if clock.epoch != epoch:
            self.positions.clear()
            self.attitudes.clear()
            self._times.restart()
        if clock.reboots != reboots:
            self.distress = Distress()
            return boot_us, (self._notice(sample.t_us, "warning", f"system {self.system_id} has rebooted"),)
        if clock.stray:
            if not clock.late and not self.positions.has(boot_us):
                gap_s = (sample.t_us - clock.unix_of(boot_us)) * 1e-6
                self.senders.other_clock(sample.t_us, self.reception.speaker, gap_s)
        else:
            self.senders.usual_clock(sample.t_us, self.reception.speaker)
        return boot_us, self.contest_notices(sample.t_us)

    def counts(self, component_id: int) -> bool:
        """Whether positions and attitudes of this packet are the vehicle's now: its autopilot's and not late."""
        self._component = self._component or component_id
        if component_id != self._component:
            return False
        if self.reception.late:
            self.refusals.count("over a link that is seconds late")
            return False
        return True

    def take_attitude(self, boot_us: int, sample: Attitude) -> None:
        """ATTITUDE or ATTITUDE_QUATERNION."""
        if self.clock.stray:
            return
        if self.senders.several(sample.t_us):
            self.senders.attitude(boot_us, sample, self.reception.speaker)
        if not self.attitudes.take(boot_us, sample) and not self.attitudes.possible(sample):
            self.refusals.count("attitude that is none")

    def refuse(self, t_us: int, reason: str) -> tuple[Notice, ...]:
        """Counts a position that is not used; says so when the reason is new or was not given for a while."""
        if self.refusals.position(t_us, reason):
            level: Level = "warning" if self.positions.known or reason not in NOT_YET else "info"
            return (self._notice(t_us, level, f"position not used: {reason}"),)
        return ()

    def nonsense(self, sample: GlobalPosition) -> str:
        """Why a report is no place at all, empty when it may be one."""
        return nonsense(sample, self._fresh_gps(sample.t_us))

    def take_position(
        self, boot_us: int, sample: GlobalPosition, frame: LocalFrame, home_alt_m: float
    ) -> tuple[Fix | None, tuple[Notice, ...]]:
        """Judges a report that is a place.

        Args:
            boot_us: from :meth:`learn_time`.
            sample: GLOBAL_POSITION_INT.
            frame: ENU.
            home_alt_m: altitude of the home plane, NaN unknown.

        Returns:
            The position if it is new evidence, and notices.
        """
        fix = self._fix(boot_us, sample, frame, home_alt_m)
        if not math.isfinite(fix.up):
            return None, self.refuse(sample.t_us, "altitude unknown")
        t_us, speaker = sample.t_us, self.reception.speaker
        if self.clock.stray:
            if self.clock.late:
                self.senders.late_place(t_us, speaker, fix, self.positions.at(boot_us))
            self.refusals.count("seconds late" if self.clock.late else "of another clock")
            return None, ()
        self.senders.place(boot_us, t_us, fix, speaker)
        before = self.positions.last
        verdict = self.positions.take(boot_us, fix, (sample.lat_deg, sample.lon_deg))
        if verdict in _REFUSED_VERDICTS:
            self.senders.jump(t_us, speaker, fix, self.positions.last)
            return None, self.refuse(t_us, _REFUSED_VERDICTS[verdict])
        if verdict == "moved":
            self.refusals.reason = ""
            self.senders.moved()
            gap_m = math.dist(fix[:3], before[1][:3]) if before is not None else 0.0
            self.distress.take_jump(t_us, gap_m)
            text = f"position jumped by {gap_m:,.0f} m and stayed there: accepted"
            return self._evidence(t_us, fix), (self._notice(t_us, "alarm", text),)
        if verdict == "new" or verdict == "standing":
            self.senders.no_jump(t_us, speaker)
            self.refusals.reason = ""
            return self._evidence(t_us, fix) if verdict == "new" else None, ()
        if verdict in _QUIET_VERDICTS:
            self.refusals.count(_QUIET_VERDICTS[verdict])
        return None, ()

    def move(self, before: LocalFrame, now: LocalFrame) -> None:
        """Tells all that is kept of places in another local frame."""
        self.positions.move(before, now, FLEET_SPAN_M)
        self.senders.forget_places()

    def _evidence(self, t_us: int, fix: Fix) -> Fix | None:
        return None if self.contested(t_us) else fix

    def contested(self, t_us: int) -> bool:
        """Whether two senders use this system id at a Unix time."""
        return self.senders.contested(t_us)

    def contest_notices(self, t_us: int) -> tuple[Notice, ...]:
        """What to say when a second sender was found, or is gone again."""
        level, text = self.senders.news(t_us, self.system_id)
        return (self._notice(t_us, level, text),) if text else ()

    @property
    def kind(self) -> str:
        """Type in a word, empty before the first heartbeat."""
        return kind_name(self._heartbeat.type) if self._heartbeat else ""

    @property
    def mode(self) -> str:
        """Flight mode in words, empty before the first heartbeat."""
        beat = self._heartbeat
        return mode_name(beat.type, beat.autopilot, beat.base_mode, beat.custom_mode) if beat else ""

    def status(self, t_us: int, estimate: Estimate | None, pose: Pose | None) -> VehicleStatus:
        """One line of the fleet table, for a time and what was estimated for it."""
        beat, gps, air, doubt = self._heartbeat, self._fresh_gps(t_us), self.reception, self.doubt(t_us)
        return VehicleStatus(
            system_id=self.system_id,
            kind=self.kind,
            mode=self.mode,
            armed=beat.armed if beat else None,
            fix=fix_name(gps.fix_type) if gps else "none",
            satellites=gps.satellites if gps else 0,
            heartbeat_age_s=max(0.0, (t_us - beat.t_us) * 1e-6) if beat else math.inf,
            position_age_s=estimate.age_s if estimate else math.inf,
            attitude_age_s=pose.age_s if pose else math.inf,
            position_state=self.position_state(t_us, estimate),
            period_s=self.positions.period_s,
            loss=air.loss,
            refused=self.refusals.positions,
            last_text=self._texts.last,
            contested=self.contested(t_us),
            refusals=self.refusals.counts,
            refused_for=self.refusals.reason,
            copies=air.copies,
            signed=air.signed,
            unsigned=air.unsigned,
            bad_signature=air.bad_signature,
            replayed=air.replayed,
            held=air.held,
            held_s=air.held_s(t_us),
            signs=air.signs(t_us),
            link=air.freshest(),
            channels=air.channels(t_us),
            drift_ppm=self._times.drift_ppm(self.clock),
            round_trip_s=self._times.round_trip_s,
            clock_error_s=self._times.error_s,
            hardware=self.senders.hardware_text,
            doubted_for=doubt.reason if doubt is not None else "",
            compass_doubted=self.distress.compass(t_us),
        )

    def position_state(self, t_us: int, estimate: Estimate | None) -> PositionState:
        """How far the position may be relied on: stale after a second and twice its own period, lost after three."""
        if self.contested(t_us):
            return "contested"
        refused = self.refusals.last_us > 0 and t_us - self.refusals.last_us < LOST_S * 1e6
        if estimate is None:
            return "refused" if refused and self.refusals.reason not in NOT_YET else "never"
        period_s = self.positions.period_s
        due_s = _STALE_S if math.isnan(period_s) else 2.0 * period_s
        if estimate.bracketed or estimate.age_s <= due_s:
            return "ok"
        if refused and self.refusals.reason:
            return "refused"
        if estimate.age_s <= _STALE_S:
            return "ok"
        return "stale" if estimate.age_s <= LOST_S else "lost"

    def _fix(self, boot_us: int, sample: GlobalPosition, frame: LocalFrame, home_alt_m: float) -> Fix:
        alt_m = sample.alt_m if altitude_known(sample.alt_m) else math.nan
        if self._drives and not abs(alt_m - home_alt_m) <= self._params.height_gap_m:
            # rovers report sea level as their altitude until their filter has started, and more after
            if math.isfinite(home_alt_m):
                self.refusals.count("altitude, far from the ground")
            alt_m = home_alt_m if math.isfinite(home_alt_m) else alt_m if math.isfinite(alt_m) else frame.alt_m
        known = math.isfinite(alt_m)
        east, north, up = frame.to_enu_point(sample.lat_deg, sample.lon_deg, alt_m if known else frame.alt_m)
        up = up if known else math.nan
        v_east, v_north = sample.v_east, sample.v_north
        if not speed_possible(sample, self._params):
            self.refusals.count("faster than it can be")
            v_east = v_north = math.nan
        pose = self.attitudes.at(boot_us)
        heading = self.positions.judged_heading(sample, pose.yaw if pose is not None and pose.age_s < 0.5 else math.nan)
        if math.isnan(heading) and not math.isnan(sample.heading):
            self.refusals.count("heading, against course or attitude")
        std_m = position_std(self._fresh_gps(sample.t_us), self._params)
        height_m = sample.relative_alt_m if altitude_known(sample.relative_alt_m) else math.nan
        return Fix(east, north, up, v_east, v_north, -sample.v_down, heading, std_m, height_m)

    def _fresh_gps(self, t_us: int) -> GpsRaw | None:
        return self._gps if self._gps is not None and t_us - self._gps.t_us < _GPS_FRESH_US else None

    def _notice(self, t_us: int, level: Level, text: str) -> Notice:
        return Notice(t_us=t_us, level=level, kind="vehicle", text=text, system_id=self.system_id)
