"""Everything heard from one vehicle: its clock, positions, attitudes, receiver, mode and words."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

from infra.reporting import Throttle
from mavlink.duplicate_id.claimed_places import FRESH_US, LATE_MOST_US
from mavlink.duplicate_id.components import NOBODY, Components
from mavlink.duplicate_id.duplicate_id import Senders
from mavlink.duplicate_id.satellite_receivers import Receiver
from mavlink.estimation.attitudes import ATTITUDE_LOST_S, Attitudes, Pose
from mavlink.estimation.clock import VehicleClock
from mavlink.estimation.clock_health import Timekeeping
from mavlink.estimation.distress import Distress, Doubt
from mavlink.estimation.origin import FLEET_SPAN_M
from mavlink.estimation.position_validation import NOT_YET, GateParams, nonsense, position_std
from mavlink.estimation.positions import LOST_S, Estimate, Fix, Jumps, Positions, fix_of
from mavlink.fleet.statustext import Texts
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
from mavlink.protocol.modes import fix_name, kind_name, mode_name
from mavlink.protocol.packet import Packet
from mavlink.reception.reception import Reception, Speaker
from mavlink.reception.rejections import Refusals
from mavlink.state import Level, Notice, PositionState, VehicleStatus

__all__ = ["Vehicle"]

_CHANGE_US = 200_000  # no vehicle changes its mode more often; a flood of forged ones does
_GPS_FRESH_US = 5_000_000
_OTHERS_US = 600_000_000  # a companion that says it is an autopilot says so for a whole flight
_REFUSED_VERDICTS = {"jump": "farther than it can have driven", "leap": "higher or lower than it can have flown"}
_JUMPS = "it jumps between places, receiver jammed or failing"
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
        self.senders = Senders(params, drives=drives, links=links, address=address)
        self._drives = drives
        self._params = params
        self._times = Timekeeping()
        self._components, self._receiver = Components(), Receiver()
        self._jumps, self.distress = Jumps(), Distress()
        self._texts = Texts()
        self._changes = Throttle(_CHANGE_US)
        self._others = Throttle(_OTHERS_US)

    def heard(self, packet: Packet, message_id: int) -> bool:
        """Counts a packet of a known message; False for a copy of one that was heard before."""
        if not self.reception.take(packet, message_id):
            return False
        if packet.component_id == self._components.speaking:
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
        """HEARTBEAT of an autopilot; those of other components than the vehicle's tell nothing of it."""
        t_us, speaker = sample.t_us, self.reception.speaker
        first = self._components.heartbeat is None
        counts = self._hear(sample.component_id, t_us, beats=True)
        self.senders.autopilots(t_us, speaker, self._components.rival(t_us))
        if counts:
            yield from self._take_own(sample, first)
        elif self._others.due(f"{sample.component_id}", t_us):
            text = f"component {sample.component_id} says that it is the autopilot too ({self.senders.where(speaker)})"
            yield self._notice(t_us, "warning", f"system {self.system_id}: {text}")
        yield from self.contest_notices(t_us)

    def _take_own(self, sample: Heartbeat, first: bool) -> Iterator[Notice]:
        t_us, speaker = sample.t_us, self.reception.speaker
        kinds = self.senders.heartbeat(sample, speaker)
        if not self.reception.behind:
            self.senders.mode(sample, speaker)
        if self.reception.outdated(t_us):
            return
        before = self._components.heartbeat
        self._components.keep(sample)
        self.distress.take_heartbeat(sample)
        if first:
            yield self._notice(t_us, "info", f"{self.kind} {self.system_id} is there, {self.mode}")
        elif before is not None and not self.contested(t_us):
            if kinds and self.senders.reports.due("kind", t_us):
                text = f"system {self.system_id} was a {kinds[0]} and says it is a {kinds[1]}"
                yield self._notice(t_us, "warning", text)
            if before.armed != sample.armed and self._changes.due("armed", t_us):
                yield self._notice(t_us, "info", "armed" if sample.armed else "disarmed")
            if before.custom_mode != sample.custom_mode and self._changes.due("mode", t_us):
                yield self._notice(t_us, "info", f"mode {self.mode}")

    def _hear(self, component_id: int, t_us: int, *, beats: bool) -> bool:
        """Whether a component speaks for the vehicle now; when it is another than before, what that said is dropped."""
        components = self._components
        before = components.speaking
        counts = components.beats(component_id, t_us) if beats else components.reports(component_id, t_us)
        if counts and before not in (NOBODY, component_id):
            self.clock.forget()
            self._forget()
            self.distress = Distress()
        return counts

    def _forget(self) -> None:
        self.positions.clear()
        self.attitudes.clear()
        self._times.restart()
        self._jumps = Jumps()

    def take_health(self, sample: FilterStatus | SensorHealth) -> tuple[Notice, ...]:
        """EKF_STATUS_REPORT, ESTIMATOR_STATUS and SYS_STATUS of the autopilot."""
        if sample.component_id == self._components.speaking and not self.reception.late:
            self.distress.take(sample)
        return ()

    def doubt(self, t_us: int) -> Doubt | None:
        """Why its positions may be wrong, by its own word; None without doubt, or without positions."""
        return self.distress.at(t_us) if self.positions.known and not self.contested(t_us) else None

    def take_gps(self, sample: GpsRaw, frame: LocalFrame | None) -> Iterator[Notice]:
        """GPS_RAW_INT; ``frame``: the local one, None unknown."""
        if self.reception.late:
            return
        if frame is not None and sample.component_id == self._components.speaking:
            now_us = self.clock.boot_of(sample.t_us)
            fix_us = sample.fix_us if abs(sample.fix_us - now_us) < _GPS_FRESH_US else now_us
            self.distress.take_receiver(sample, position_std(sample, self._params), self.positions.at(fix_us), frame)
        level, text = self._receiver.take(sample, self.reception.speaker)
        if text and self._components.speaking in (NOBODY, sample.component_id) and not self.contested(sample.t_us):
            yield self._notice(sample.t_us, level, text)

    def take_text(self, sample: StatusText) -> Iterator[Notice]:
        """STATUSTEXT; pieces of long texts are put together, repetitions within seconds are left out."""
        text = self._texts.take(sample)
        if text:
            if sample.component_id == self._components.speaking:
                self.distress.take_text(sample, text)
            level: Level = "alarm" if sample.severity <= 3 else "warning" if sample.severity == 4 else "info"
            yield Notice(t_us=sample.t_us, level=level, kind="text", text=text, system_id=self.system_id)

    def take_times(self, sample: SystemTime | TimeSync) -> tuple[Notice, ...]:
        """SYSTEM_TIME and TIMESYNC of the autopilot: only ever told, no position depends on them."""
        if self._components.speaking not in (NOBODY, sample.component_id):
            return ()  # a companion's
        if self.contested(sample.t_us):
            self._times.restart()  # two clocks together drift like none
        self._times.update(sample)
        # a late link goes on telling of the count before a reboot
        if isinstance(sample, SystemTime) and sample.unix_us and sample.boot_ms * 1000 > FRESH_US:
            self.senders.booted(sample.t_us, self.reception.speaker, sample.unix_us - sample.boot_ms * 1000)
            return self.contest_notices(sample.t_us)
        return ()

    def take_hardware(self, packet: Packet) -> tuple[Notice, ...]:
        """AUTOPILOT_VERSION."""
        if self._components.speaking not in (NOBODY, packet.component_id):
            return ()  # gimbals and companions tell their own
        text = self.senders.hardware(packet, self.reception.speaker, self.clock.epoch)
        told = (self._notice(packet.t_us, "warning", f"system {self.system_id}: {text}"),) if text else ()
        return told + self.contest_notices(packet.t_us)

    def learn_time(self, boot_ms: int, sample: Attitude | GlobalPosition) -> tuple[int, tuple[Notice, ...]]:
        """Boot time in µs of a sample, and what the clock noticed."""
        clock = self.clock
        epoch, reboots = clock.epoch, clock.reboots
        speaker = self.reception.speaker
        trails = self.senders.trails(speaker)
        boot_us = clock.learn(boot_ms, sample.t_us, trails=trails)
        if clock.late or not clock.stray:
            delay_us = sample.t_us - clock.unix_of(boot_us)
            self.reception.dated(max(delay_us, clock.params.late_us) if clock.late else delay_us)
        if clock.epoch != epoch:
            self._forget()
        if clock.reboots != reboots:
            self.distress = Distress()
            return boot_us, (self._notice(sample.t_us, "warning", f"system {self.system_id} has rebooted"),)
        if not clock.stray:
            self.senders.usual_clock(sample.t_us, speaker)
        elif not (clock.late or trails or boot_us < FRESH_US or self.positions.has(boot_us)):
            early_us = clock.unix_of(boot_us) - sample.t_us
            if 0 < early_us <= LATE_MOST_US and self.senders.quicker(speaker, sample.t_us):
                clock.quicken(boot_us, sample.t_us)
            else:
                self.senders.other_clock(sample.t_us, speaker, -early_us * 1e-6)
        return boot_us, self.contest_notices(sample.t_us)

    def counts(self, component_id: int, t_us: int) -> bool:
        """Whether positions and attitudes of this packet are the vehicle's now: its autopilot's and not late."""
        if not self._hear(component_id, t_us, beats=False):
            return False
        if self.reception.late:
            self.refusals.count("over a link that is seconds late")
            return False
        return True

    def take_attitude(self, boot_us: int, sample: Attitude) -> None:
        """ATTITUDE or ATTITUDE_QUATERNION."""
        if self.clock.stray:
            if self.clock.late and boot_us > FRESH_US:
                self.senders.late_attitude(sample, self.reception.speaker, self.attitudes.at(boot_us))
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
        return nonsense(sample, self._gps_of(sample))

    def compare_place(self, sample: GlobalPosition) -> None:
        """Compares a place with what others said of it, whichever component says it."""
        if not self.nonsense(sample):
            self.senders.place(sample, self.reception.speaker, position_std(self._gps_of(sample), self._params))

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
        pose = self.attitudes.at(boot_us)
        yaw = pose.yaw if pose is not None and pose.age_s < ATTITUDE_LOST_S else math.nan
        heading, std_m = self.positions.judged_heading(sample, yaw), position_std(self._gps_of(sample), self._params)
        fix, left_out = fix_of(
            sample, frame, home_alt_m, heading=heading, std_m=std_m, params=self._params, drives=self._drives
        )
        for reason in left_out:
            self.refusals.count(reason)
        if not math.isfinite(fix.up):
            return None, self.refuse(sample.t_us, "altitude unknown")
        t_us, speaker = sample.t_us, self.reception.speaker
        if self.clock.stray:
            self.refusals.count("seconds late" if self.clock.late else "of another clock")
            return None, ()
        before = self.positions.last
        verdict = self.positions.take(boot_us, fix, (sample.lat_deg, sample.lon_deg))
        jumped = self._jumps.jumps(t_us)
        self._jumps.take(verdict, speaker[:2], t_us, fix)
        if self._jumps.jumps(t_us):
            self.refusals.count(_JUMPS)
            if jumped or not self.refusals.reports.due(_JUMPS, t_us):
                return None, ()
            return None, (self._notice(t_us, "warning", f"positions not used: {_JUMPS}"),)
        if verdict in _REFUSED_VERDICTS:
            return None, self.refuse(t_us, _REFUSED_VERDICTS[verdict])
        self.refusals.reason = "" if verdict in ("new", "standing", "moved") else self.refusals.reason
        if verdict == "moved":
            gap_m = math.dist(fix[:3], before[1][:3]) if before is not None else 0.0
            self.distress.take_jump(t_us, gap_m)
            text = f"position jumped by {gap_m:,.0f} m and stayed there: accepted"
            return self._evidence(t_us, fix), (self._notice(t_us, "alarm", text),)
        if verdict == "new":
            return self._evidence(t_us, fix), ()
        if verdict in _QUIET_VERDICTS:
            self.refusals.count(_QUIET_VERDICTS[verdict])
        return None, ()

    def move(self, before: LocalFrame, now: LocalFrame) -> None:
        """Tells all that is kept of places in another local frame."""
        self.positions.move(before, now, FLEET_SPAN_M)
        self._jumps = Jumps()

    def _evidence(self, t_us: int, fix: Fix) -> Fix | None:
        return None if self.contested(t_us) else fix

    def contested(self, t_us: int) -> bool:
        """Whether two senders use this system id at a Unix time."""
        return self.senders.contested(t_us)

    def contest_notices(self, t_us: int) -> tuple[Notice, ...]:
        """What to say when a second sender was found, or is gone again, or another component speaks."""
        news = self.senders.news(t_us, self.system_id), self._components.news()
        if not (news[0][1] or news[1][1]):
            return ()
        return tuple(self._notice(t_us, level, text) for level, text in news if text)

    @property
    def kind(self) -> str:
        """Type in a word, empty before the first heartbeat."""
        return kind_name(beat.type) if (beat := self._components.heartbeat) else ""

    @property
    def mode(self) -> str:
        """Flight mode in words, empty before the first heartbeat."""
        beat = self._components.heartbeat
        return mode_name(beat.type, beat.autopilot, beat.base_mode, beat.custom_mode) if beat else ""

    def status(self, t_us: int, estimate: Estimate | None, pose: Pose | None) -> VehicleStatus:
        """One line of the fleet table, for a time and what was estimated for it."""
        beat, air, doubt = self._components.heartbeat, self.reception, self.doubt(t_us)
        gps = self._receiver.newest(t_us, self._components.speaking)
        jumps = self._jumps.jumps(t_us)
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
            refused_for=_JUMPS if jumps else self.refusals.reason,
            jumps=jumps,
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
            clock_fault="" if self.contested(t_us) else self._times.fault(self.clock),
            hardware=self.senders.hardware_text,
            doubted_for=doubt.reason if doubt is not None else "",
            compass_doubted=self.distress.compass(t_us),
        )

    def position_state(self, t_us: int, estimate: Estimate | None) -> PositionState:
        """How far the position may be relied on."""
        if self.contested(t_us):
            return "contested"
        if self._jumps.jumps(t_us):
            return "refused"
        refused = self.refusals.last_us > 0 and t_us - self.refusals.last_us < LOST_S * 1e6
        return self.positions.state(estimate, self.refusals.reason if refused else "")

    def _gps_of(self, sample: GlobalPosition) -> GpsRaw | None:
        return self._receiver.fresh(sample.t_us, self.reception.speaker)

    def _notice(self, t_us: int, level: Level, text: str) -> Notice:
        return Notice(t_us=t_us, level=level, kind="vehicle", text=text, system_id=self.system_id)
