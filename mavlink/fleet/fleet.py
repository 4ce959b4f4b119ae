"""Who is where, when: one UAV and its ground vehicles, from packets.

Samples are kept by each vehicle's own boot time, so that a clock learnt better later also dates earlier reports better.
A report that cannot be right is counted and said, never used and never fatal.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np

from mavlink.duplicate_id.autopilot_id import AUTOPILOT_VERSION
from mavlink.estimation.attitudes import ATTITUDE_LOST_S, Pose
from mavlink.estimation.camera_report import CameraReports, CameraSample
from mavlink.estimation.distress import Doubt
from mavlink.estimation.gimbal import Gimbals, GimbalSample
from mavlink.estimation.origin import FLEET_SPAN_M, LOCAL_REACH_M, TOO_FAR, Origin
from mavlink.estimation.position_validation import GateParams
from mavlink.estimation.positions import Estimate, Fix, in_frame
from mavlink.fleet.vehicle import Vehicle
from mavlink.geodesy import R_ENU_NED, LocalFrame, rotation_from_euler
from mavlink.protocol.decode import decode
from mavlink.protocol.dialect import DEFINITIONS
from mavlink.protocol.messages import (
    Attitude,
    CameraFov,
    CameraInformation,
    CameraSettings,
    FilterStatus,
    GimbalAttitude,
    GlobalPosition,
    GpsRaw,
    Heartbeat,
    MountOrientation,
    MountStatus,
    SensorHealth,
    StatusText,
    SystemTime,
    TimeSync,
    VideoStreamInformation,
)
from mavlink.protocol.modes import is_vehicle, kind_name
from mavlink.protocol.packet import Auth, Packet
from mavlink.state import CameraReport, FleetState, Level, MessageRate, Notice, Reports, UavState, VehicleStatus

__all__ = ["CameraReport", "Fleet", "FleetState", "Notice", "Reports", "UavState", "VehicleStatus"]

_UAV_SPEED, _UAV_ACCELERATION = 80.0, 12.0
_USABLE_S = 2.0  # a position is carried on for no longer
_ORIGIN_PATIENCE_US = 10_000_000
_WAITING = 2000  # reports kept until the origin is known
_REPORTS = 100_000  # reports kept until somebody takes them
_OF_MODEMS = (109, 166)  # RADIO_STATUS, RADIO
_NOWHERE = Fix(*[math.nan] * 9)


class _Report(NamedTuple):
    """A position that nobody has taken yet."""

    vehicle: Vehicle
    boot_us: int
    fix: Fix
    restarts: int
    """Of the clock that boot_us is on."""
    dated_us: int
    """Unix µs of boot_us by that clock, as it was when the report came."""

    @property
    def made_us(self) -> int:
        """Unix µs of boot_us: by the clock as it is known now, unless that is another since, as after a reboot."""
        clock = self.vehicle.clock
        return clock.unix_of(self.boot_us) if clock.restarts == self.restarts else self.dated_us


class Fleet:
    """Folds packets into the fleet's state.

    Args:
        uav_id: system id of the UAV.
        ugv_ids: system ids of the ground vehicles; their order is that of all arrays.
        origin: of the ENU frame; None: the UAV's first position, or that of the first ground vehicle that has reported
            for ten seconds without the UAV.
        params: what a ground vehicle can do.
        camera_id: which of the UAV's cameras, by device id 1-6 or component id; 0: the first that tells its field of
            view.
        gimbal_id: which of its gimbals, the same way; 0: the camera's, else the first that speaks.
        links: names of the links by index, for what is told.
        address: of a link's index and a peer's number, in words; empty where it is not known.
    """

    def __init__(
        self,
        uav_id: int,
        ugv_ids: Sequence[int],
        origin: LocalFrame | None = None,
        params: GateParams | None = None,
        *,
        camera_id: int = 0,
        gimbal_id: int = 0,
        links: Sequence[str] = (),
        address: Callable[[int, int], str] = lambda link, peer: "",
    ) -> None:
        self._origin = Origin(origin)
        self._ids = np.array(ugv_ids, dtype=np.int64)
        names, params = tuple(links), params or GateParams()
        flies = GateParams(max_speed=_UAV_SPEED, max_acceleration=_UAV_ACCELERATION)
        self._uav = Vehicle(uav_id, drives=False, params=flies, links=names, address=address)
        self._ugvs = [
            Vehicle(system_id, drives=True, params=params, links=names, address=address) for system_id in ugv_ids
        ]
        self._vehicles = {vehicle.system_id: vehicle for vehicle in [self._uav, *self._ugvs]}
        self._strangers: set[int] = set()
        self._waiting: deque[tuple[Vehicle, int, int, GlobalPosition]] = deque(maxlen=_WAITING)
        self._waiting_since_us = 0
        self._reports: deque[_Report] = deque(maxlen=_REPORTS)
        self._gimbals = Gimbals(gimbal_id)
        self._camera = CameraReports(camera_id)
        self._take: dict[type, Callable[[Vehicle, Any], Iterable[Notice]]] = {
            Heartbeat: _heartbeat,
            GpsRaw: lambda vehicle, sample: vehicle.take_gps(sample, self.origin),
            FilterStatus: lambda vehicle, sample: vehicle.take_health(sample),
            SensorHealth: lambda vehicle, sample: vehicle.take_health(sample),
            StatusText: lambda vehicle, sample: vehicle.take_text(sample),
            SystemTime: lambda vehicle, sample: vehicle.take_times(sample),
            TimeSync: lambda vehicle, sample: vehicle.take_times(sample),
            Attitude: self._attitude,
            GlobalPosition: self._position,
            GimbalAttitude: self._gimbal,
            MountOrientation: self._gimbal,
            MountStatus: self._gimbal,
            CameraInformation: self._camera_message,
            CameraSettings: self._camera_message,
            CameraFov: self._camera_message,
            VideoStreamInformation: self._camera_message,
        }

    def feed(self, packet: Packet) -> tuple[Notice, ...]:
        """Takes one packet, in order of arrival; returns what an operator should know."""
        message_id = packet.message_id
        if message_id not in DEFINITIONS:
            return ()  # not checked by anything, so not even its sender is known
        if message_id in _OF_MODEMS:
            return ()  # says how a radio is doing, in the name of whoever is behind it
        vehicle = self._vehicles.get(packet.system_id)
        if packet.auth > Auth.GOOD:
            return vehicle.refuse_packet(packet) if vehicle is not None else ()
        if vehicle is None:
            return self._stranger(packet)
        if not vehicle.heard(packet, message_id):
            return ()
        if message_id == AUTOPILOT_VERSION:
            return self._told(vehicle, vehicle.take_hardware(packet))
        sample = decode(packet)
        take = self._take.get(type(sample))
        return self._told(vehicle, tuple(take(vehicle, sample))) if take is not None else ()

    def at(self, t_us: int, heard_us: int = 0) -> FleetState:
        """Everybody at a Unix time in µs: interpolated between reports, carried on for two seconds after the last.

        Args:
            t_us: when.
            heard_us: Whatever came before this Unix time was fed. Where that is earlier, ages and what follows from
                them are told for then: nobody is silent who was not listened to. 0: all was.
        """
        told_us = min(t_us, heard_us) if heard_us else t_us
        estimates = [vehicle.positions.at(vehicle.clock.boot_of(t_us)) for vehicle in self._ugvs]
        statuses = [_status(vehicle, told_us) for vehicle in self._ugvs]
        rows = np.array([e.fix if e else _NOWHERE for e in estimates], dtype=np.float64).reshape(-1, len(_NOWHERE))
        uav_status = _status(self._uav, told_us)
        uav = self._uav_at(t_us, uav_status)
        return FleetState(
            t_us=t_us,
            uav=uav,
            system_id=self._ids,
            p_enu=rows[:, 0:3],
            v_enu=rows[:, 3:6],
            heading=rows[:, 6],
            age_s=np.array([s.position_age_s for s in statuses], dtype=np.float64),
            std_m=np.array([_widened(std, v.doubt(t_us)) for std, v in zip(rows[:, 7], self._ugvs, strict=True)]),
            valid=np.array([_usable(e, s) for e, s in zip(estimates, statuses, strict=True)], dtype=np.bool_),
            vehicles=(uav_status, *statuses),
        )

    def rates(self, t_us: int) -> tuple[MessageRate, ...]:
        """How often which message comes from whom over which link, measured; to be asked once a second or so."""
        return tuple(
            rate for vehicle in self._vehicles.values() for rate in vehicle.reception.rates(vehicle.system_id, t_us)
        )

    @property
    def origin(self) -> LocalFrame | None:
        """Of the ENU frame, None until a place is known; another one once the UAV turns out to be elsewhere."""
        return self._origin.frame

    @property
    def video_offer(self) -> VideoStreamInformation | None:
        """The video stream that the UAV offers, None while it offers none."""
        return self._camera.stream

    def take_reports(self) -> Reports:
        """Positions of ground vehicles accepted since the last call."""
        taken, self._reports = self._reports, deque(maxlen=_REPORTS)
        rows = np.array([report.fix for report in taken], dtype=np.float64).reshape(-1, len(_NOWHERE))
        return Reports(
            t_us=np.array([report.made_us for report in taken], dtype=np.int64),
            system_id=np.array([report.vehicle.system_id for report in taken], dtype=np.int64),
            p_enu=rows[:, 0:3],
            v_enu=rows[:, 3:6],
            heading=rows[:, 6],
            std_m=rows[:, 7],
        )

    def _told(self, vehicle: Vehicle, notices: tuple[Notice, ...]) -> tuple[Notice, ...]:
        """Passes notices on; reports not yet taken of a vehicle that turns out to have two senders are dropped."""
        if notices and self._reports and vehicle.contested(notices[-1].t_us):
            kept = (report for report in self._reports if report.vehicle is not vehicle)
            self._reports = deque(kept, maxlen=_REPORTS)
        return notices

    def _stranger(self, packet: Packet) -> tuple[Notice, ...]:
        """Says once that a vehicle is on the air that is not in the mission."""
        if packet.system_id in self._strangers or packet.message_id != 0:
            return ()
        sample = decode(packet)
        if not isinstance(sample, Heartbeat) or not is_vehicle(sample.type, sample.autopilot):
            return ()
        self._strangers.add(packet.system_id)
        text = f"{kind_name(sample.type)} {packet.system_id} is on the air and not in the mission: ignored"
        return (Notice(t_us=packet.t_us, level="info", kind="vehicle", text=text, system_id=packet.system_id),)

    def _attitude(self, vehicle: Vehicle, sample: Attitude) -> tuple[Notice, ...]:
        if not vehicle.counts(sample.component_id, sample.t_us):
            return ()
        boot_us, notices = vehicle.learn_time(sample.boot_ms, sample)
        vehicle.take_attitude(boot_us, sample)
        return notices

    def _position(self, vehicle: Vehicle, sample: GlobalPosition) -> tuple[Notice, ...]:
        vehicle.compare_place(sample)
        if not vehicle.counts(sample.component_id, sample.t_us):
            return vehicle.contest_notices(sample.t_us)
        boot_us, notices = vehicle.learn_time(sample.boot_ms, sample)
        reason = vehicle.nonsense(sample)
        if reason and vehicle.clock.stray:
            vehicle.refusals.count(reason)  # a reboot that is not yet believed begins without a fix
            return notices
        far = not reason and self._origin.distance_m(sample) > FLEET_SPAN_M
        if not reason and self._outlying(vehicle, sample, far):
            reason = TOO_FAR
        if reason:
            return notices + vehicle.refuse(sample.t_us, reason)
        if self.origin is None and not self._found_origin(vehicle, boot_us, sample):
            return notices
        if far and vehicle is not self._uav:
            notices += self._move_origin(sample)
        return notices + self._place(vehicle, boot_us, sample)

    def _outlying(self, vehicle: Vehicle, sample: GlobalPosition, far: bool) -> bool:
        """Whether a vehicle is too far from the others to be right.

        Where most agree on a place, who is not there is wrong. Where they do not, the UAV is believed: it may jump, and
        takes the origin with it, and a ground vehicle must be near.
        """
        if not vehicle.clock.stray and not vehicle.contested(sample.t_us):
            self._origin.hear(sample)
        if self.origin is not None and not far:
            return False
        with_most = self._origin.with_most(sample)
        return with_most is False or (with_most is None and far and vehicle is not self._uav)

    def _found_origin(self, vehicle: Vehicle, boot_us: int, sample: GlobalPosition) -> bool:
        """Sets the origin if this report may; else keeps the report for when it is known."""
        self._waiting_since_us = self._waiting_since_us or sample.t_us
        if vehicle is not self._uav and sample.t_us - self._waiting_since_us < _ORIGIN_PATIENCE_US:
            self._waiting.append((vehicle, vehicle.clock.epoch, boot_us, sample))
            return False
        self._origin.put(sample)
        if vehicle is self._uav:
            self._origin.learn_home(sample)
        for spoke, epoch, since_us, said in self._waiting:
            # boot times from before a reboot are those of another count
            if epoch == spoke.clock.epoch and self._origin.distance_m(said) <= FLEET_SPAN_M:
                self._place(spoke, since_us, said)
        self._waiting.clear()
        return True

    def _place(self, vehicle: Vehicle, boot_us: int, sample: GlobalPosition) -> tuple[Notice, ...]:
        assert self.origin is not None
        fix, notices = vehicle.take_position(boot_us, sample, self.origin, self._origin.home_alt_m)
        if fix is not None and vehicle is self._uav:
            self._origin.learn_home(sample)
            if math.hypot(*fix[:3]) > LOCAL_REACH_M:
                notices += self._move_origin(sample)
        elif fix is not None:
            clock = vehicle.clock
            doubt = vehicle.doubt(sample.t_us)
            fix = fix._replace(
                std_m=_widened(fix.std_m, doubt),
                heading=math.nan if vehicle.distress.compass(sample.t_us) else fix.heading,
            )
            self._reports.append(_Report(vehicle, boot_us, fix, clock.restarts, clock.unix_of(boot_us)))
        return notices

    def _move_origin(self, sample: GlobalPosition) -> tuple[Notice, ...]:
        """Puts the origin where a vehicle is; what is kept of places moves along, what is too far away is dropped."""
        before, distance_m = self.origin, self._origin.distance_m(sample)
        self._origin.put(sample)
        now = self.origin
        assert before is not None and now is not None
        for vehicle in self._vehicles.values():
            vehicle.move(before, now)
        moved = in_frame([report.fix for report in self._reports], before, now)
        reports = (report._replace(fix=fix) for report, fix in zip(self._reports, moved, strict=True))
        near = (report for report in reports if math.hypot(*report.fix[:3]) <= FLEET_SPAN_M)
        self._reports = deque(near, maxlen=_REPORTS)
        whom = "the UAV" if sample.system_id == self._uav.system_id else "where most vehicles are"
        text = f"the local origin moves by {distance_m * 1e-3:,.0f} km to {whom}; names begin anew"
        level: Level = "warning" if distance_m > 2.0 * LOCAL_REACH_M else "info"
        return (Notice(t_us=sample.t_us, level=level, kind="vehicle", text=text, system_id=self._uav.system_id),)

    def _gimbal(self, vehicle: Vehicle, sample: GimbalSample) -> tuple[Notice, ...]:
        if vehicle is not self._uav or vehicle.reception.late:
            return ()
        # stamped on arrival: gimbals of their own have a clock of their own
        boot_us = vehicle.clock.boot_of(sample.t_us)
        pose = vehicle.attitudes.at(boot_us)
        texts = self._gimbals.take(boot_us, sample, pose.yaw if pose else math.nan)
        return self._camera_notices(sample.t_us, texts)

    def _camera_message(self, vehicle: Vehicle, sample: CameraSample) -> tuple[Notice, ...]:
        if vehicle is not self._uav:
            return ()
        notices = self._camera_notices(sample.t_us, self._camera.take(sample))
        self._gimbals.link(self._camera.gimbal_id)
        return notices + (self._gimbal(vehicle, sample) if isinstance(sample, CameraFov) else ())

    def _camera_notices(self, t_us: int, texts: list[str]) -> tuple[Notice, ...]:
        uav = self._uav.system_id
        return tuple(
            Notice(
                t_us=t_us, level="warning" if "not used" in text else "info", kind="camera", text=text, system_id=uav
            )
            for text in texts
        )

    def _uav_at(self, t_us: int, status: VehicleStatus) -> UavState:
        boot_us = self._uav.clock.boot_of(t_us)
        estimate, pose = self._uav.positions.at(boot_us), self._uav.attitudes.at(boot_us)
        fix = estimate.fix if estimate else _NOWHERE
        roll, pitch, yaw = pose[:3] if pose else (math.nan, math.nan, math.nan)
        return UavState(
            p_enu=np.array(fix[0:3]),
            v_enu=np.array(fix[3:6]),
            height_m=fix.height_m,
            R_enu_body=R_ENU_NED @ rotation_from_euler(roll, pitch, yaw),
            yaw=yaw % (2.0 * math.pi),
            pitch=pitch,
            roll=roll,
            R_enu_gimbal=self._gimbals.at(boot_us, yaw),
            position_age_s=status.position_age_s,
            attitude_age_s=status.attitude_age_s,
            position_valid=_usable(estimate, status),
            attitude_valid=_fresh(pose) and not status.contested,
            camera=self._camera.report,
        )


def _status(vehicle: Vehicle, t_us: int) -> VehicleStatus:
    boot_us = vehicle.clock.boot_of(t_us)
    return vehicle.status(t_us, vehicle.positions.at(boot_us), vehicle.attitudes.at(boot_us))


def _heartbeat(vehicle: Vehicle, sample: Heartbeat) -> Iterable[Notice]:
    """Gimbals, cameras and relayed stations beat too, and are no vehicles."""
    return vehicle.take_heartbeat(sample) if is_vehicle(sample.type, sample.autopilot) else ()


def _widened(std_m: float, doubt: Doubt | None) -> float:
    """1σ of a position with what its vehicle doubts of it."""
    return math.hypot(std_m, doubt.std_m) if doubt is not None else std_m


def _fresh(pose: Pose | None) -> bool:
    return pose is not None and (pose.bracketed or pose.age_s <= ATTITUDE_LOST_S)


def _usable(estimate: Estimate | None, status: VehicleStatus) -> bool:
    """Whether a position may be used: heard in the last two seconds, from one sender only, and that at one place."""
    if estimate is None or status.contested or status.jumps:
        return False
    return estimate.bracketed or estimate.age_s <= _USABLE_S
