"""Everything heard from one vehicle: its clock, positions, attitudes, receiver, mode and words."""

from __future__ import annotations

import math
from collections.abc import Iterator

from mavlink.attitudes import Attitudes, Pose
from mavlink.clock import VehicleClock
from mavlink.gate import GateParams, altitude_known, nonsense, position_std
from mavlink.geodesy import LocalFrame
from mavlink.modes import fix_name, is_vehicle, kind_name, mode_name
from mavlink.packet import Packet
from mavlink.positions import LOST_S, Estimate, Fix, Positions
from mavlink.samples import Attitude, GlobalPosition, GpsRaw, Heartbeat, StatusText
from mavlink.sequence import SequenceLoss
from mavlink.state import Level, Notice, PositionState, VehicleStatus

__all__ = ["Vehicle"]

_GPS_FRESH_US = 5_000_000
_REPEATED_TEXT_US = 5_000_000
_REPEATED_REFUSAL_US = 30_000_000
_STRANGERS, _STRANGER_US = 5, 10_000_000


class Vehicle:
    """One configured vehicle.

    Args:
        system_id: whose packets :meth:`heard` and the others get.
        drives: a ground vehicle: its course fits its heading, its altitude may be wrong.
        params: limits of what it can do.
    """

    def __init__(self, system_id: int, *, drives: bool, params: GateParams) -> None:
        self.system_id = system_id
        self.clock = VehicleClock()
        self.positions = Positions(params, drives=drives)
        self.attitudes = Attitudes()
        self.refused = 0
        self._drives = drives
        self._params = params
        self._loss = SequenceLoss()
        self._heartbeat: Heartbeat | None = None
        self._component = 0  # whose positions and attitudes count; 0 until somebody speaks
        self._gps: GpsRaw | None = None
        self._refusal = ""
        self._refused_us = 0
        self._refusals_told: dict[str, int] = {}
        self._text = ""
        self._text_us = 0
        self._pieces: dict[tuple[int, int], str] = {}
        self._strangers = 0
        self._stranger_us = 0
        self._contested_told = False

    def heard(self, packet: Packet) -> None:
        """Counts a packet of a known message, whatever it says."""
        self._loss.take(packet.link, packet.component_id, packet.seq)

    def take_heartbeat(self, sample: Heartbeat) -> Iterator[Notice]:
        """HEARTBEAT; those of gimbals, cameras and relayed stations are none of the vehicle's."""
        if not is_vehicle(sample.type, sample.autopilot):
            return
        before, self._heartbeat = self._heartbeat, sample
        self._component = sample.component_id
        if before is None:
            yield self._notice(sample.t_us, "info", f"{self.kind} {self.system_id} is there, {self.mode}")
            return
        if before.type != sample.type and kind_name(before.type) != self.kind:
            text = f"system {self.system_id} was a {kind_name(before.type)} and says it is a {self.kind}"
            yield self._notice(sample.t_us, "warning", text)
        if before.armed != sample.armed:
            yield self._notice(sample.t_us, "info", "armed" if sample.armed else "disarmed")
        if before.custom_mode != sample.custom_mode:
            yield self._notice(sample.t_us, "info", f"mode {self.mode}")

    def take_gps(self, sample: GpsRaw) -> Iterator[Notice]:
        """GPS_RAW_INT."""
        before, self._gps = self._gps, sample
        if before is not None and fix_name(before.fix_type) != fix_name(sample.fix_type):
            worse = sample.fix_type < min(before.fix_type, 3)
            text = f"GPS fix {fix_name(sample.fix_type)}, was {fix_name(before.fix_type)}"
            yield self._notice(sample.t_us, "warning" if worse else "info", text)

    def take_text(self, sample: StatusText) -> Iterator[Notice]:
        """STATUSTEXT; pieces of long texts are put together, repetitions within seconds are left out."""
        text = sample.text
        if sample.text_id:
            text = self._joined(sample)
        if not text or (text == self._text and sample.t_us - self._text_us < _REPEATED_TEXT_US):
            return
        self._text, self._text_us = text, sample.t_us
        level: Level = "alarm" if sample.severity <= 3 else "warning" if sample.severity == 4 else "info"
        yield Notice(t_us=sample.t_us, level=level, kind="text", text=text, system_id=self.system_id)

    def learn_time(self, boot_ms: int, sample: Attitude | GlobalPosition) -> tuple[int, tuple[Notice, ...]]:
        """Boot time in µs of a sample, and what the clock noticed."""
        epoch, reboots, was_stray = self.clock.epoch, self.clock.reboots, self.clock.stray
        boot_us = self.clock.learn(boot_ms, sample.t_us)
        if self.clock.epoch != epoch:
            self.positions.clear()
            self.attitudes.clear()
        if self.clock.reboots != reboots:
            return boot_us, (self._notice(sample.t_us, "warning", f"system {self.system_id} has rebooted"),)
        if self.clock.stray and not was_stray and not self.positions.has(boot_us):
            self._note_stranger(sample.t_us)
        return boot_us, self._contest_notice(sample.t_us)

    def counts(self, component_id: int) -> bool:
        """Whether positions and attitudes of this component are the vehicle's: its autopilot's, once that is known."""
        self._component = self._component or component_id
        return component_id == self._component

    def take_attitude(self, boot_us: int, sample: Attitude) -> None:
        """ATTITUDE or ATTITUDE_QUATERNION."""
        if not self.clock.stray:
            self.attitudes.take(boot_us, sample)

    def refuse(self, t_us: int, reason: str) -> Iterator[Notice]:
        """Counts a position that is not used; says so when the reason is new or was not given for a while."""
        self.refused += 1
        self._refused_us = t_us
        self._refusal = reason
        if abs(t_us - self._refusals_told.get(reason, -_REPEATED_REFUSAL_US)) >= _REPEATED_REFUSAL_US:
            self._refusals_told[reason] = t_us
            yield self._notice(t_us, "warning", f"position not used: {reason}")

    def nonsense(self, sample: GlobalPosition) -> str:
        """Why a report is no place at all, empty when it may be one."""
        return nonsense(sample, self._fresh_gps(sample.t_us))

    def take_position(
        self, boot_us: int, sample: GlobalPosition, frame: LocalFrame, home_up: float
    ) -> tuple[Fix | None, tuple[Notice, ...]]:
        """Judges a report that is a place.

        Args:
            boot_us: from :meth:`learn_time`.
            sample: GLOBAL_POSITION_INT.
            frame: ENU.
            home_up: ENU height of the home plane in metres, NaN unknown.

        Returns:
            The position if it is new evidence, and notices.
        """
        fix = self._fix(boot_us, sample, frame, home_up)
        if not math.isfinite(fix.up):
            return None, tuple(self.refuse(sample.t_us, "altitude unknown"))
        if self.clock.stray:
            return None, ()
        verdict = self.positions.take(boot_us, fix, (sample.lat_deg, sample.lon_deg))
        if verdict == "jump":
            return None, tuple(self.refuse(sample.t_us, "farther than it can have driven"))
        if verdict == "moved":
            self._refusal = ""
            return fix, (self._notice(sample.t_us, "warning", "position jumped and stayed there: accepted"),)
        if verdict in ("new", "standing"):
            self._refusal = ""
        return (fix if verdict == "new" and not self.contested(boot_us) else None), ()

    def contested(self, boot_us: int) -> bool:
        """Whether two senders use this system id now."""
        strangers = self._strangers >= _STRANGERS and self.clock.unix_of(boot_us) < self._stranger_us + _STRANGER_US
        return strangers or boot_us < self.positions.contested_us

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
        beat, gps = self._heartbeat, self._fresh_gps(t_us)
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
            loss=self._loss.share,
            refused=self.refused,
            last_text=self._text,
            contested=self.contested(self.clock.boot_of(t_us)),
        )

    def position_state(self, t_us: int, estimate: Estimate | None) -> PositionState:
        """How far the position may be relied on: stale after twice its own period, lost after three seconds."""
        refused = self._refused_us > 0 and t_us - self._refused_us < LOST_S * 1e6
        if estimate is None:
            return "refused" if refused else "never"
        period_s = self.positions.period_s
        if estimate.bracketed or estimate.age_s <= (1.0 if math.isnan(period_s) else 2.0 * period_s):
            return "ok"
        if refused and self._refusal:
            return "refused"
        return "stale" if estimate.age_s <= LOST_S else "lost"

    def _fix(self, boot_us: int, sample: GlobalPosition, frame: LocalFrame, home_up: float) -> Fix:
        alt_m = sample.alt_m if altitude_known(sample.alt_m) else math.nan
        east, north, up = frame.to_enu_point(
            sample.lat_deg, sample.lon_deg, frame.alt_m if math.isnan(alt_m) else alt_m
        )
        if math.isnan(alt_m):
            up = math.nan
        if self._drives and not abs(up - home_up) <= self._params.height_gap_m:
            # rovers report sea level as their altitude until their filter has started, and more after
            up = home_up if math.isfinite(home_up) else up if math.isfinite(up) else 0.0
        v_east, v_north = sample.v_east, sample.v_north
        if math.hypot(v_east, v_north) > self._params.max_speed:
            v_east = v_north = math.nan
        pose = self.attitudes.at(boot_us)
        yaw = pose.yaw if pose is not None and pose.age_s < 0.5 else math.nan
        return Fix(
            east,
            north,
            up,
            v_east,
            v_north,
            -sample.v_down,
            self.positions.judged_heading(sample, yaw),
            position_std(self._fresh_gps(sample.t_us), self._params),
            sample.relative_alt_m,
        )

    def _fresh_gps(self, t_us: int) -> GpsRaw | None:
        return self._gps if self._gps is not None and t_us - self._gps.t_us < _GPS_FRESH_US else None

    def _joined(self, sample: StatusText) -> str:
        """A long text once its last piece is there (a piece shorter than full), empty before."""
        key = (sample.component_id, sample.text_id)
        text = self._pieces.pop(key, "") + sample.text
        if len(sample.text.encode()) >= 50 and len(text) < 1000:
            while len(self._pieces) >= 8:
                del self._pieces[next(iter(self._pieces))]
            self._pieces[key] = text
            return ""
        return text

    def _note_stranger(self, t_us: int) -> None:
        if t_us - self._stranger_us > _STRANGER_US:
            self._strangers = 0
        self._strangers += 1
        self._stranger_us = t_us

    def _contest_notice(self, t_us: int) -> tuple[Notice, ...]:
        contested = self.contested(self.clock.boot_of(t_us))
        told, self._contested_told = self._contested_told, contested
        if contested and not told:
            text = f"two senders use system id {self.system_id}: its positions are not used"
            return (self._notice(t_us, "alarm", text),)
        return ()

    def _notice(self, t_us: int, level: Level, text: str) -> Notice:
        return Notice(t_us=t_us, level=level, kind="vehicle", text=text, system_id=self.system_id)
