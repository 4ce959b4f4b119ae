"""Roster of the vehicles that are heard, with the one that films and those to be named: the mission that follows from
telemetry alone.

Vehicles say in their heartbeats what they are: aircraft film, whatever stays on the ground is the fleet. Live links
and logs without a mission go by this one rule.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Literal

from gcs.errors import ConfigError
from gcs.mission.mission import Mission, MissionVehicle, usual_name
from mavlink.protocol.decode import decode
from mavlink.protocol.dialect import DEFINITIONS
from mavlink.protocol.messages import (
    CameraFov,
    CameraInformation,
    CameraSettings,
    GimbalAttitude,
    GlobalPosition,
    Heartbeat,
    MountOrientation,
    MountStatus,
    VideoStreamInformation,
)
from mavlink.protocol.modes import is_aircraft, is_ground_vehicle, is_vehicle, kind_name
from mavlink.protocol.packet import Auth, Packet

Role = Literal["films", "named", "out"]
"""Carries the camera, is to be told apart, or is left out."""
AUTOPILOTS: Mapping[int, str] = {3: "ArduPilot", 12: "PX4"}
_OF_A_CAMERA = (
    *(CameraFov, CameraInformation, CameraSettings, VideoStreamInformation),
    *(GimbalAttitude, MountOrientation, MountStatus),
)
"""Messages that only a vehicle with a camera sends."""
_RATE_OVER = 20
"""Positions over which their rate is taken."""


@dataclass(slots=True, kw_only=True)
class HeardVehicle:
    """Record of one sender of vehicle telemetry so far."""

    system_id: int
    link: int
    """Index of the link that it was first heard on."""
    type: int = -1
    """MAV_TYPE; −1: no heartbeat of a vehicle yet."""
    autopilot: int = -1
    """MAV_AUTOPILOT."""
    auth: Auth = Auth.OPEN
    """Verdict on the signature of its last packet; refused only where none was accepted so far."""
    signed: bool = False
    """True if that packet has one."""
    packets: int = 0
    """Number of packets that were accepted."""
    positions: deque[int] = field(default_factory=lambda: deque(maxlen=_RATE_OVER))
    """Times of the last positions, Unix µs."""
    lat_deg: float = math.nan
    lon_deg: float = math.nan
    """Longitude of its last position, deg, NaN none."""
    camera: bool = False
    """True if it reports a camera or a gimbal."""
    video: VideoStreamInformation | None = None
    """The video that it offers."""

    @property
    def kind(self) -> str:
        """Type of the vehicle in a word."""
        return kind_name(self.type) if self.type >= 0 else "unknown"

    @property
    def maker(self) -> str:
        """Autopilot of the vehicle in a word, empty where that has none."""
        return AUTOPILOTS.get(self.autopilot, "")

    @property
    def position_hz(self) -> float:
        """Positions a second; 0 before the second one."""
        times_us = self.positions
        return (len(times_us) - 1) * 1e6 / max(times_us[-1] - times_us[0], 1) if len(times_us) > 1 else 0.0

    @property
    def trust(self) -> str:
        """State of its packets' signatures, in a word or two."""
        if self.auth > Auth.GOOD:
            return f"refused: {self.auth.name.lower()}"
        return "signed" if self.auth is Auth.GOOD else "signed, no key" if self.signed else "unsigned"

    @property
    def role(self) -> Role:
        """Role by the vehicle's type."""
        return "films" if is_aircraft(self.type) else "named" if is_ground_vehicle(self.type) else "out"


class Roster:
    """Everyone who sends the telemetry of a vehicle; stations, cameras and gimbals do not.

    Attributes:
        news_us: when something new was heard last: a vehicle, what it is, its first position, a video. Unix µs.
    """

    def __init__(self) -> None:
        self._heard: dict[int, HeardVehicle] = {}
        self.news_us = 0

    @property
    def vehicles(self) -> tuple[HeardVehicle, ...]:
        """Senders that are vehicles as far as is known, by system id."""
        return tuple(each for _, each in sorted(self._heard.items()) if each.type >= 0 or each.positions)

    def add_packet(self, packet: Packet) -> None:
        """Take one packet in, in order of arrival; of one that is refused only that."""
        if packet.message_id not in DEFINITIONS:
            return
        system_id = packet.system_id
        if (vehicle := self._heard.get(system_id)) is None:
            vehicle = self._heard[system_id] = HeardVehicle(system_id=system_id, link=packet.link)
        refused = packet.auth > Auth.GOOD
        if refused and vehicle.packets:
            return  # who sends in the name of a vehicle that is believed takes nothing from it
        if not refused and vehicle.auth > Auth.GOOD:
            vehicle.type = -1
        vehicle.auth, vehicle.signed = packet.auth, packet.signed
        vehicle.packets += not refused
        sample = decode(packet)
        if isinstance(sample, Heartbeat) and vehicle.type < 0 and _is_of_a_vehicle(sample):
            vehicle.type, vehicle.autopilot, self.news_us = sample.type, sample.autopilot, packet.t_us
        if not refused:
            self._add_accepted(vehicle, sample)

    def _add_accepted(self, vehicle: HeardVehicle, sample: object) -> None:
        if isinstance(sample, GlobalPosition) and (sample.lat_deg or sample.lon_deg):
            if not vehicle.positions:
                self.news_us = sample.t_us
            vehicle.positions.append(sample.t_us)
            vehicle.lat_deg, vehicle.lon_deg = sample.lat_deg, sample.lon_deg
        if isinstance(sample, _OF_A_CAMERA) and not vehicle.camera:
            vehicle.camera, self.news_us = True, sample.t_us
        if isinstance(sample, VideoStreamInformation) and vehicle.video is None:
            vehicle.video, self.news_us = sample, sample.t_us


def _is_of_a_vehicle(sample: Heartbeat) -> bool:
    """Tell whether a heartbeat tells what a vehicle is; its gimbal, its companion and stations send them too."""
    return is_aircraft(sample.type) or is_ground_vehicle(sample.type) or is_vehicle(sample.type, sample.autopilot)


@dataclass(frozen=True, slots=True, kw_only=True)
class FleetChoice:
    """The fleet that is to fly, by what was heard and by the operator's choice."""

    roles: Mapping[int, Role]
    """Vehicles by system id."""
    names: Mapping[int, str] = field(default_factory=dict)
    """Names of those that have one of their own."""
    chosen: frozenset[int] = frozenset()
    """System ids whose role is the operator's choice."""
    video: str | None = None
    """Source of its video; None: what is offered or heard."""


def proposed_roles(
    vehicles: Iterable[HeardVehicle], chosen: Mapping[int, Role], *, whole_fleet: bool = True
) -> dict[int, Role]:
    """Propose the role of each vehicle, by system id: as the operator chose, else by what a vehicle is; out where its
    packets are refused.

    Of several aircraft the only one that reports a camera films.

    Args:
        vehicles: that are heard.
        chosen: roles by system id, also of vehicles that are not heard. Where one films no other aircraft does.
        whole_fleet: whether ground vehicles that were not chosen are in it too.
    """
    vehicles = tuple(vehicles)
    believed = [each for each in vehicles if each.auth <= Auth.GOOD and each.role == "films"]
    with_camera = [each.system_id for each in believed if each.camera and chosen.get(each.system_id) != "out"]
    one_films = "films" in chosen.values()
    proposed: dict[int, Role] = {}
    for vehicle in vehicles:
        films = not one_films and (len(with_camera) != 1 or vehicle.system_id in with_camera)
        in_it = vehicle.auth <= Auth.GOOD and (whole_fleet if vehicle.role == "named" else films)
        proposed[vehicle.system_id] = vehicle.role if in_it else "out"
    return proposed | dict(chosen)


def mission_of(roles: Mapping[int, Role], names: Mapping[int, str] | None = None) -> Mission:
    """The mission of these vehicles, its camera as the UAV reports it or the flight shows it.

    Args:
        roles: by system id.
        names: by system id, of those that have one of their own.

    Raises:
        ConfigError: not one films, or nobody is to be named.
    """
    names = names or {}
    films = sorted(i for i, role in roles.items() if role == "films")
    named = sorted(i for i, role in roles.items() if role == "named")
    if len(films) > 1:
        raise ConfigError(f"aircraft {', '.join(map(str, films))} are heard: name the one that films with --uav")
    if not films or not named:
        missing = "aircraft that films" if not films else "ground vehicle"
        raise ConfigError(f"no {missing} is heard; name it with {'--uav' if not films else '--ugv'}")
    return Mission(
        uav=MissionVehicle(system_id=films[0], name=names.get(films[0], usual_name(films[0], films=True))),
        ugv=tuple(MissionVehicle(system_id=i, name=names.get(i, usual_name(i, films=False))) for i in named),
    )
