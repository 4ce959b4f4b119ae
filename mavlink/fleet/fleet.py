"""The place of every vehicle at any time: one UAV and its ground vehicles, from packets.

Samples are kept by each vehicle's own boot time, so that a clock learnt better later also dates earlier reports better.
A report that cannot be right is counted and reported, never used and never fatal.

RADIO_STATUS and RADIO come under the id of the vehicle behind the modem, or, from SiK radios, under the modem's own
(51): then they are about the link that they came over, and about each vehicle whose packets come that way.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega

from mavlink.estimation.camera_report import CameraReports, CameraSample
from mavlink.estimation.gimbal import Gimbals, GimbalSample
from mavlink.estimation.ground_distance import GroundDistance
from mavlink.estimation.interpolation import ATTITUDE_LOST_S, Fix
from mavlink.estimation.origin import FLEET_SPAN_M, LOCAL_REACH_M, TOO_FAR, Origin
from mavlink.estimation.position_quality import Doubt
from mavlink.estimation.positions import VehicleLimits, altitude_known, in_frame
from mavlink.fleet.stand import Stand
from mavlink.fleet.vehicle import PositionReport, Vehicle
from mavlink.geodesy import R_ENU_NED, LocalFrame, rotation_from_euler
from mavlink.protocol.decode import decode
from mavlink.protocol.dialect import DEFINITIONS, HEARTBEAT, RADIO_STATUS
from mavlink.protocol.messages import (
    Attitude,
    CameraFov,
    CameraInformation,
    CameraSettings,
    DistanceSensor,
    FilterStatus,
    GimbalAttitude,
    GlobalPosition,
    GpsRaw,
    Heartbeat,
    MountOrientation,
    MountStatus,
    RadioStatus,
    SensorHealth,
    StatusText,
    SystemTime,
    TerrainReport,
    TimeSync,
    VideoStreamInformation,
)
from mavlink.protocol.modes import is_vehicle, kind_name
from mavlink.protocol.packet import Auth, Packet
from mavlink.reception.reception import Arrival
from mavlink.state import CameraReport, FleetState, Level, Notice, Reports, UavAttitude, UavState, VehicleStatus

NO_FIX = Fix(*[math.nan] * 10)
_REPORTING_US = 1_000_000
"""Time after which nothing is waited for any more: it stopped, or comes too rarely to interpolate."""
MODEM_MESSAGES = (RADIO_STATUS, ardupilotmega.MAVLINK_MSG_ID_RADIO)
_UAV_LIMITS = VehicleLimits(max_speed=80.0, max_acceleration=12.0)
"""A fast multicopter or a small plane."""
_MAX_UNDATED = 300
"""Attitudes of the gimbal that are held back until the UAV's clock has an anchor."""
_ORIGIN_PATIENCE_US = 10_000_000
"""Time that the origin waits for the UAV's first position: a receiver that has just been switched on needs longer."""
_MAX_WAITING = 2000
"""Reports kept until the origin is known."""
_MAX_REPORTS = 100_000
"""Reports kept until they are collected."""


def uav_attitude(uav: Vehicle, gimbals: Gimbals, t_us: int, *, gimbal: bool) -> UavAttitude:
    """The UAV's attitude at a Unix time, each sample by its own time."""
    boot_us = uav.clock.boot_of(t_us)
    pose = uav.attitudes.at(boot_us)
    roll, pitch, yaw = pose[:3] if pose else (math.nan, math.nan, math.nan)
    fresh = pose is not None and (pose.bracketed or pose.age_s <= ATTITUDE_LOST_S)
    return UavAttitude(
        R_enu_body=R_ENU_NED @ rotation_from_euler(roll, pitch, yaw),
        yaw=yaw % (2.0 * math.pi),
        pitch=pitch,
        roll=roll,
        R_enu_gimbal=gimbals.at(boot_us, yaw) if gimbal else None,
        attitude_valid=fresh and not uav.in_conflict(t_us),
    )


def uav_state(
    uav: Vehicle, gimbals: Gimbals, camera: CameraReport | None, ground: GroundDistance, t_us: int
) -> UavState:
    """The UAV at a Unix time, each sample by its own time."""
    attitude, estimate = uav_attitude(uav, gimbals, t_us, gimbal=True), uav.estimate(t_us)
    fix = estimate.fix if estimate else NO_FIX
    return UavState(
        p_enu=np.array(fix[0:3]),
        v_enu=np.array(fix[3:6]),
        height_m=fix.height_m,
        R_enu_body=attitude.R_enu_body,
        yaw=attitude.yaw,
        pitch=attitude.pitch,
        roll=attitude.roll,
        R_enu_gimbal=attitude.R_enu_gimbal,
        position_valid=estimate is not None and estimate.usable and uav.is_trusted(t_us),
        attitude_valid=attitude.attitude_valid,
        camera=camera,
        range_m=ground.range_m(t_us),
        terrain_height_m=ground.terrain_height_m(t_us),
        std_m=fix.std_m,
    )


def is_awaited(uav: Vehicle, gimbals: Gimbals, t_us: int) -> bool:
    """Tell whether a position, attitude or gimbal's attitude that belongs to a Unix time is still to come."""
    boot_us = uav.clock.boot_of(t_us)
    for newest in (uav.positions.newest, uav.attitudes.newest, gimbals.newest):
        if newest is not None and 0 < boot_us - newest[0] <= _REPORTING_US:
            return True
    return False


def add_radio_status(packet: Packet, vehicles: Mapping[int, Vehicle]) -> None:
    """Give a modem's report to the vehicles that it is about."""
    sample = decode(packet)
    if packet.auth > Auth.GOOD or not isinstance(sample, RadioStatus):
        return
    if packet.system_id in vehicles:
        vehicles[packet.system_id].conditions.add_radio(sample, shared=False)
        return
    channel = packet.link, packet.peer
    behind = [vehicle for vehicle in vehicles.values() if vehicle.conditions.channel == channel]
    for vehicle in behind:
        vehicle.conditions.add_radio(sample, shared=len(behind) > 1)


class _AcceptedPosition(NamedTuple):
    """An accepted position that has not been collected yet."""

    vehicle: Vehicle
    boot_us: int
    fix: Fix
    restarts: int
    """Restarts of the clock that boot_us is on."""
    dated_us: int
    """Unix µs of boot_us by that clock, as it was when the report came."""

    @property
    def made_us(self) -> int:
        """Unix µs of boot_us: by the clock as it is known now, unless it was restarted since, as after a reboot."""
        clock = self.vehicle.clock
        return clock.unix_of(self.boot_us) if clock.restarts == self.restarts else self.dated_us


class Fleet:
    """The state of all vehicles, from packets in order of arrival.

    Args:
        uav_id: system id of the UAV.
        ugv_ids: system ids of the ground vehicles; their order is that of all arrays.
        origin: of the ENU frame; None: the UAV's first position, or that of the first ground vehicle that has reported
            for ten seconds without the UAV.
        camera_id: which of the UAV's cameras, by device id 1-6 or component id; 0: the first that reports its field
            of view.
        gimbal_id: which of its gimbals, the same way; 0: the camera's, else the first that reports.
        links: names of the links by index, for messages to the operator.
        address: of a link's index and a peer's number, in words; empty where it is not known.
        stand: of a camera that is on no aircraft, and takes the place of the UAV.
    """

    def __init__(
        self,
        uav_id: int,
        ugv_ids: Sequence[int],
        origin: LocalFrame | None = None,
        limits: VehicleLimits | None = None,
        *,
        camera_id: int = 0,
        gimbal_id: int = 0,
        links: Sequence[str] = (),
        address: Callable[[int, int], str] = lambda link, peer: "",
        stand: Stand | None = None,
    ) -> None:
        self._origin, self._stand = Origin(origin), stand
        if stand and math.isfinite(stand.alt_m):
            self._place_stand(stand)
        names, limits = tuple(links), limits or VehicleLimits()
        self._uav = Vehicle(uav_id, drives=False, limits=_UAV_LIMITS, links=names, address=address)
        self._new_ugv = partial(Vehicle, drives=True, limits=limits, links=names, address=address)
        self._vehicles = {uav_id: self._uav}
        self._unknown_ids: set[int] = set()
        self._waiting: deque[tuple[Vehicle, int, PositionReport]] = deque(maxlen=_MAX_WAITING)
        self._waiting_since_us = 0
        self._evidence: deque[_AcceptedPosition] = deque(maxlen=_MAX_REPORTS)
        self.set_ugvs(ugv_ids)
        self._gimbals, self._gimbal_epoch = Gimbals(gimbal_id), 0
        self._undated: deque[GimbalSample] = deque(maxlen=_MAX_UNDATED)
        """Attitudes of the gimbal from before the UAV's clock was known."""
        self._camera = CameraReports(camera_id)
        self._ground_distance = GroundDistance()
        self._handlers: dict[type, Callable[[Vehicle, Any, Arrival], Iterable[Notice]]] = {
            Heartbeat: _add_heartbeat,
            GpsRaw: self._add_gps,
            FilterStatus: lambda vehicle, sample, arrival: vehicle.add_health(sample, arrival),
            SensorHealth: lambda vehicle, sample, arrival: vehicle.add_health(sample, arrival),
            StatusText: lambda vehicle, sample, arrival: vehicle.add_text(sample),
            SystemTime: lambda vehicle, sample, arrival: vehicle.add_time(sample, arrival),
            TimeSync: lambda vehicle, sample, arrival: vehicle.add_time(sample, arrival),
            Attitude: _add_attitude,
            GlobalPosition: self._add_position,
            GimbalAttitude: self._add_gimbal,
            MountOrientation: self._add_gimbal,
            MountStatus: self._add_gimbal,
            CameraInformation: self._add_camera,
            CameraSettings: self._add_camera,
            CameraFov: self._add_camera,
            VideoStreamInformation: self._add_camera,
            DistanceSensor: self._add_ground_distance,
            TerrainReport: self._add_ground_distance,
        }

    def set_ugvs(self, ugv_ids: Sequence[int]) -> None:
        """Follow these ground vehicles from now on; of those who were followed before all that is known is kept."""
        before = self._vehicles
        self._ids = np.array(ugv_ids, dtype=np.int64)
        self._ugvs = [before.get(system_id) or self._new_ugv(system_id) for system_id in ugv_ids]
        self._vehicles = {vehicle.system_id: vehicle for vehicle in [self._uav, *self._ugvs]}
        self._unknown_ids |= before.keys() - self._vehicles.keys()  # who was left out is no news
        for kept in (self._waiting, self._evidence):
            mine = [each for each in kept if self._vehicles.get(each[0].system_id) is each[0]]
            kept.clear()
            kept.extend(mine)  # type: ignore[arg-type]

    def add_packet(self, packet: Packet) -> tuple[Notice, ...]:
        """Add one packet, in order of arrival; return what an operator should know."""
        message_id = packet.message_id
        if message_id not in DEFINITIONS:
            return ()  # its checksum could not be verified, so not even its sender is known
        if message_id in MODEM_MESSAGES:
            add_radio_status(packet, self._vehicles)
            return ()
        vehicle = self._vehicles.get(packet.system_id)
        if packet.auth > Auth.GOOD:
            return vehicle.reject_packet(packet) if vehicle is not None else ()
        if vehicle is None:
            return self._unknown_vehicle(packet)
        arrival = vehicle.count_packet(packet, message_id)
        if arrival is None:
            return ()
        if message_id == ardupilotmega.MAVLINK_MSG_ID_AUTOPILOT_VERSION:
            return self._after(vehicle, vehicle.add_hardware_id(packet, arrival))
        sample = decode(packet)
        if not arrival.late:
            vehicle.conditions.add(sample, arrival.sender[:2])
        handler = self._handlers.get(type(sample))
        return self._after(vehicle, tuple(handler(vehicle, sample, arrival))) if handler is not None else ()

    def at(self, t_us: int, heard_us: int = 0) -> FleetState:
        """All vehicles at a Unix time in µs: interpolated between reports, extrapolated for two seconds after the last.

        Args:
            t_us: when.
            heard_us: all packets before this Unix time were added. Where it is earlier, ages and what follows from them
                are those of then: a vehicle whose packets are still queued is not silent. 0: none are queued.
        """
        status_us = min(t_us, heard_us) if heard_us else t_us
        estimates = [vehicle.estimate(t_us) for vehicle in self._ugvs]
        heard = estimates if status_us == t_us else [vehicle.estimate(status_us) for vehicle in self._ugvs]
        statuses = [vehicle.status(status_us, e) for vehicle, e in zip(self._ugvs, heard, strict=True)]
        rows = np.array([e.fix if e else NO_FIX for e in estimates], dtype=np.float64).reshape(-1, len(NO_FIX))
        valid = [
            estimate is not None and estimate.usable and not (status.contested or status.jumps)
            for estimate, status in zip(estimates, statuses, strict=True)
        ]
        return FleetState(
            t_us=t_us,
            uav=self._uav_at(t_us),
            system_id=self._ids,
            p_enu=rows[:, 0:3],
            v_enu=rows[:, 3:6],
            heading=rows[:, 6],
            age_s=np.array([s.position_age_s for s in statuses], dtype=np.float64),
            std_m=np.array([_widened(std, v.doubt(t_us)) for std, v in zip(rows[:, 7], self._ugvs, strict=True)]),
            up_std_m=rows[:, 9],
            valid=np.array(valid, dtype=np.bool_),
            vehicles=(self._uav_status(status_us), *statuses),
        )

    def _uav_at(self, t_us: int) -> UavState:
        if self._stand:
            return self._stand.state(self.origin)
        return uav_state(self._uav, self._gimbals, self._camera.report, self._ground_distance, t_us)

    def attitude_at(self, t_us: int, *, gimbal: bool) -> UavAttitude:
        """The UAV's attitude alone at a Unix time in µs, with that of its gimbal if it is asked for."""
        if self._stand:
            return self._stand.state(self.origin)
        return uav_attitude(self._uav, self._gimbals, t_us, gimbal=gimbal)

    def attitude_times(self, after_us: int, until_us: int) -> list[int]:
        """Times at which the UAV's attitude was measured after one Unix time and up to another, µs."""
        if self._stand:
            return [until_us]  # it is known at any time
        clock = self._uav.clock
        return [clock.unix_of(t) for t in self._uav.attitudes.times(clock.boot_of(after_us), clock.boot_of(until_us))]

    def awaits(self, t_us: int) -> bool:
        """Tell whether reports of the UAV's pose about a Unix time, which is interpolated, are still to come."""
        return is_awaited(self._uav, self._gimbals, t_us)

    def _uav_status(self, t_us: int) -> VehicleStatus:
        uav = self._uav
        return self._stand.status(uav.system_id) if self._stand else uav.status(t_us, uav.estimate(t_us))

    @property
    def uav_delay_us(self) -> float:
        """Delay of most messages of the UAV behind the quickest of them, µs."""
        return self._uav.usual_delay_us

    @property
    def origin(self) -> LocalFrame | None:
        """Origin of the ENU frame; None until a place is known; it moves when the UAV turns out to be elsewhere."""
        return self._origin.frame

    @property
    def video_offer(self) -> VideoStreamInformation | None:
        """The video stream that the UAV advertises, None while there is none."""
        return self._camera.stream

    def take_reports(self) -> Reports:
        """Positions of ground vehicles accepted since the last call."""
        collected, self._evidence = self._evidence, deque(maxlen=_MAX_REPORTS)
        rows = np.array([report.fix for report in collected], dtype=np.float64).reshape(-1, len(NO_FIX))
        return Reports(
            t_us=np.array([report.made_us for report in collected], dtype=np.int64),
            system_id=np.array([report.vehicle.system_id for report in collected], dtype=np.int64),
            p_enu=rows[:, 0:3],
            v_enu=rows[:, 3:6],
            heading=rows[:, 6],
            std_m=rows[:, 7],
        )

    def _after(self, vehicle: Vehicle, notices: tuple[Notice, ...]) -> tuple[Notice, ...]:
        """Drop positions not yet collected of a vehicle that turns out to have two senders; return the notices."""
        if notices and self._evidence and vehicle.in_conflict(notices[-1].t_us):
            kept = (report for report in self._evidence if report.vehicle is not vehicle)
            self._evidence = deque(kept, maxlen=_MAX_REPORTS)
        return notices

    def _unknown_vehicle(self, packet: Packet) -> tuple[Notice, ...]:
        """Report once that a vehicle is on the air that is not in the mission."""
        if packet.system_id in self._unknown_ids or packet.message_id != HEARTBEAT:
            return ()
        sample = decode(packet)
        if not isinstance(sample, Heartbeat) or not is_vehicle(sample.type, sample.autopilot):
            return ()
        self._unknown_ids.add(packet.system_id)
        text = f"{kind_name(sample.type)} {packet.system_id} is on the air and not in the mission: ignored"
        return (Notice(t_us=packet.t_us, level="info", kind="vehicle", text=text, system_id=packet.system_id),)

    def _add_gps(self, vehicle: Vehicle, sample: GpsRaw, arrival: Arrival) -> tuple[Notice, ...]:
        notices = tuple(vehicle.add_gps(sample, arrival, self.origin))
        place = vehicle.raw_position(sample)
        return notices + (self._add_position(vehicle, place, arrival, raw=True) if place is not None else ())

    def _add_position(
        self, vehicle: Vehicle, sample: GlobalPosition, arrival: Arrival, *, raw: bool = False
    ) -> tuple[Notice, ...]:
        reason = vehicle.compare_place(sample, arrival)
        if not (vehicle.is_position_source(sample, raw=raw) and vehicle.is_in_time(arrival)):
            return vehicle.conflict_notices(sample.t_us)
        reading, notices = vehicle.learn_clock(sample, arrival)
        report = PositionReport(sample, arrival, reading)
        if reason and not reading.fit.fits:
            vehicle.rejections.count(reason)  # a reboot that is not accepted yet begins without a fix
            return notices
        far = not reason and self._origin.is_far(sample)
        if not reason and self._is_outlying(vehicle, report, far):
            reason = TOO_FAR
        if reason:
            return notices + vehicle.reject_position(sample.t_us, reason)
        if self.origin is None and not self._found_origin(vehicle, report):
            return notices
        if far and vehicle is not self._uav:
            notices += self._move_origin(sample)
        return notices + self._keep_position(vehicle, report)

    def _is_outlying(self, vehicle: Vehicle, report: PositionReport, far: bool) -> bool:
        """Tell whether a vehicle is too far from the others to be right.

        Where most agree on a place, one that is not there is wrong. Where they do not, the UAV is right: it may jump,
        and the origin moves with it, and a ground vehicle must be near.
        """
        sample = report.sample
        if report.reading.fit.fits and not vehicle.in_conflict(sample.t_us):
            self._origin.add_report(sample)
        if self.origin is not None and not far:
            return False
        near_majority = self._origin.near_majority(sample)
        return near_majority is False or (near_majority is None and far and vehicle is not self._uav)

    def _found_origin(self, vehicle: Vehicle, report: PositionReport) -> bool:
        """Set the origin if this report may; else keep the report for when it is known."""
        sample, stand = report.sample, self._stand
        self._waiting_since_us = self._waiting_since_us or sample.t_us
        has_altitude = vehicle is self._uav or (stand is not None and altitude_known(sample.alt_m))
        if not has_altitude and sample.t_us - self._waiting_since_us < _ORIGIN_PATIENCE_US:
            self._waiting.append((vehicle, vehicle.clock.epoch, report))
            return False
        if stand:  # its height is above the ground of the vehicle that is heard first
            self._place_stand(replace(stand, alt_m=(sample.alt_m if has_altitude else 0.0) + stand.height_m))
        else:
            self._origin.move_to(sample)
        if vehicle is self._uav:
            self._origin.set_home_altitude(sample)
        for other, epoch, waiting in self._waiting:
            # boot times from before a reboot are those of another count
            if epoch == other.clock.epoch and not self._origin.is_far(waiting.sample):
                self._keep_position(other, waiting)
        self._waiting.clear()
        return True

    def _place_stand(self, stand: Stand) -> None:
        """Take the stand, whose altitude is known, for the origin."""
        self._stand, self._origin.home_alt_m = stand, stand.ground_alt_m
        self._origin.frame = LocalFrame(stand.lat_deg, stand.lon_deg, stand.alt_m)

    def _keep_position(self, vehicle: Vehicle, report: PositionReport) -> tuple[Notice, ...]:
        assert self.origin is not None
        sample, boot_us = report.sample, report.reading.boot_us
        if self._stand and math.isnan(self._origin.home_alt_m) and altitude_known(sample.alt_m):
            self._origin.home_alt_m = sample.alt_m
        fix, notices = vehicle.add_position(report, self.origin, self._origin.home_alt_m)
        if fix is not None and vehicle is self._uav:
            self._origin.set_home_altitude(sample)
            if math.hypot(*fix[:3]) > LOCAL_REACH_M:
                notices += self._move_origin(sample)
        elif fix is not None:
            clock = vehicle.clock
            if (doubt := vehicle.doubt(sample.t_us)) is not None:
                fix = fix._replace(std_m=_widened(fix.std_m, doubt))
            if vehicle.doubts.compass_doubted(sample.t_us):
                fix = fix._replace(heading=math.nan)
            self._evidence.append(_AcceptedPosition(vehicle, boot_us, fix, clock.restarts, clock.unix_of(boot_us)))
        return notices

    def _move_origin(self, sample: GlobalPosition) -> tuple[Notice, ...]:
        """Put the origin where a vehicle is; positions are converted, and those too far away dropped."""
        before, distance_m = self.origin, self._origin.distance_m(sample)
        self._origin.move_to(sample)
        now = self.origin
        assert before is not None and now is not None
        for vehicle in self._vehicles.values():
            vehicle.change_frame(before, now)
        moved = in_frame([report.fix for report in self._evidence], before, now)
        reports = (report._replace(fix=fix) for report, fix in zip(self._evidence, moved, strict=True))
        near = (report for report in reports if math.hypot(*report.fix[:3]) <= FLEET_SPAN_M)
        self._evidence = deque(near, maxlen=_MAX_REPORTS)
        where = "the UAV" if sample.system_id == self._uav.system_id else "where most vehicles are"
        text = f"the local origin moves by {distance_m * 1e-3:,.0f} km to {where}; names begin anew"
        level: Level = "warning" if distance_m > 2.0 * LOCAL_REACH_M else "info"
        return (Notice(t_us=sample.t_us, level=level, kind="vehicle", text=text, system_id=self._uav.system_id),)

    def _add_gimbal(self, vehicle: Vehicle, sample: GimbalSample, arrival: Arrival) -> tuple[Notice, ...]:
        if vehicle is not self._uav or arrival.late:
            return ()
        if vehicle.clock.epoch != self._gimbal_epoch:
            self._gimbal_epoch = vehicle.clock.epoch
            self._gimbals.clear()
        self._undated.append(sample)
        texts = []
        while self._undated and (boot_us := vehicle.boot_time(self._undated[0])) is not None:
            pose = vehicle.attitudes.at(boot_us)
            texts += self._gimbals.add(boot_us, self._undated.popleft(), pose.yaw if pose else math.nan)
        return self._camera_notices(sample.t_us, texts)

    def _add_camera(self, vehicle: Vehicle, sample: CameraSample, arrival: Arrival) -> tuple[Notice, ...]:
        if vehicle is not self._uav:
            return ()
        notices = self._camera_notices(sample.t_us, self._camera.add(sample))
        self._gimbals.set_camera_gimbal(self._camera.gimbal_id)
        return notices + (self._add_gimbal(vehicle, sample, arrival) if isinstance(sample, CameraFov) else ())

    def _add_ground_distance(
        self, vehicle: Vehicle, sample: DistanceSensor | TerrainReport, arrival: Arrival
    ) -> tuple[Notice, ...]:
        if vehicle is self._uav and not arrival.late:
            self._ground_distance.add(sample)
        return ()

    def _camera_notices(self, t_us: int, texts: list[str]) -> tuple[Notice, ...]:
        uav = self._uav.system_id
        return tuple(
            Notice(
                t_us=t_us, level="warning" if "not used" in text else "info", kind="camera", text=text, system_id=uav
            )
            for text in texts
        )


def _add_heartbeat(vehicle: Vehicle, sample: Heartbeat, arrival: Arrival) -> Iterable[Notice]:
    """Add a vehicle's heartbeat; gimbals, cameras and relayed stations send some too, and are no vehicles."""
    return vehicle.add_heartbeat(sample, arrival) if is_vehicle(sample.type, sample.autopilot) else ()


def _add_attitude(vehicle: Vehicle, sample: Attitude, arrival: Arrival) -> tuple[Notice, ...]:
    if not (vehicle.is_from_autopilot(sample) and vehicle.is_in_time(arrival)):
        return ()
    reading, notices = vehicle.learn_clock(sample, arrival)
    vehicle.add_attitude(sample, arrival, reading)
    return notices


def _widened(std_m: float, doubt: Doubt | None) -> float:
    """1σ of a position, with that of a doubt about it."""
    return math.hypot(std_m, doubt.std_m) if doubt is not None else std_m
