"""The fleet's state: frozen records of arrays, in configured order."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Level = Literal["info", "warning", "alarm"]
ARMING_FAILURES = ("PreArm: ", "Arm: ", "Preflight Fail: ")
"""Start of ArduPilot's and PX4's status texts on why a vehicle cannot be armed."""
SILENT_S = 3.5
"""A vehicle or a link without a packet for this long is silent: three heartbeats of one a second are missing, which is
longer than the delay of a slow radio."""
PositionState = Literal["ok", "stale", "lost", "never", "refused", "contested"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Notice:
    """Something that an operator should know."""

    t_us: int
    level: Level
    kind: str
    """``vehicle``, ``camera``, ``text`` or ``link``."""
    text: str
    """Plain text, control characters replaced; never markup."""
    system_id: int = 0
    """0 for what is about no vehicle."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraReport:
    """A camera as the UAV describes it; at least one of its angles is known."""

    width: int
    """Width of the image, px; 0 unknown."""
    height: int
    hfov: float
    """Rad across the image, NaN unknown."""
    vfov: float
    source: str
    """Name of the message with the field of view, or of the known camera and where its own is from."""
    rotation_deg: int = 0
    """Rotation of the image, clockwise: 0, 90, 180 or 270."""
    zoom_percent: float = math.nan
    """Percent of the camera's whole range of zoom, NaN unknown."""
    zoom_max: float = 1.0
    """Magnification of the field of view at 100 % of it; 1: unknown, or the field of view is that of now."""
    model: str = ""
    uri: str = ""
    """Address of its video stream, empty unknown."""


@dataclass(frozen=True, slots=True, kw_only=True)
class UavAttitude:
    """Attitude of the UAV and of its gimbal at one time."""

    R_enu_body: Array
    """(3, 3), NaN unknown."""
    yaw: float
    """Radians, clockwise from north."""
    pitch: float
    roll: float
    R_enu_gimbal: Array | None
    """(3, 3) gimbal (x along the optical axis, FRD) → ENU, None when not reported in the last second."""
    attitude_valid: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class UavState(UavAttitude):
    """The UAV at one time."""

    p_enu: Array
    """(3,) metres, NaN unknown."""
    v_enu: Array
    """(3,) m/s."""
    height_m: float
    """Height above home, m, NaN unknown."""
    position_valid: bool
    camera: CameraReport | None
    range_m: float = math.nan
    """Distance to the ground along the body's own vertical axis, by its rangefinder, m; NaN not reported in the last
    second."""
    terrain_height_m: float = math.nan
    """Height above the ground by the autopilot's own map of the terrain, m; NaN not reported in the last second."""
    std_m: float = math.nan
    """1σ of the position per axis, level, by its receiver; NaN unknown."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ChannelStatus:
    """Reception of one vehicle's packets from one address on one link."""

    link: int
    """Index of the link."""
    peer: int
    """Number of the address on that link, 0 where there is none."""
    packets: int
    rate_hz: float
    """Packets a second lately, duplicates of those of other channels included."""
    loss: float
    """Share of packets lost lately, 0..1, NaN unknown: missing by sequence number, and by what comes regularly."""
    age_s: float
    """Time since its last packet, s."""
    late_s: float
    """Delay after another channel that brings the same packets, 0 when it is first or the only one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class VehicleCondition:
    """Condition of a vehicle by its own word; NaN and empty are unknown, inf is the age of what was never received."""

    voltage_v: float = math.nan
    charge: float = math.nan
    """Charge of its battery, 0..1; of several the lowest."""
    battery: str = ""
    """State of its battery, by its monitor, where it is not well: ``low``, ``critical``, ``failed`` …"""
    left_s: float = math.nan
    """Time until that battery is empty by its autopilot's reckoning."""
    power_age_s: float = math.inf
    """Age of voltage, charge and that time."""
    satellites: int = -1
    """Number of satellites in use, −1 unknown."""
    hdop: float = math.nan
    receiver_age_s: float = math.inf
    """Age of satellites and HDOP."""
    radio: float = math.nan
    """Signal above noise at the worse end of its radio link, in the radio's own units."""
    radio_age_s: float = math.inf
    filter_ratio: float = math.nan
    """Largest innovation of its filter over what the filter allows: from 1 on a measurement is rejected."""
    filter_age_s: float = math.inf
    faults: tuple[str, ...] = ()
    """Sensors and other parts that it reports as failing now, in words."""
    arming: tuple[str, ...] = ()
    """Reason why it cannot be armed now, in its own words: plain text from the air."""


@dataclass(frozen=True, slots=True, kw_only=True)
class VehicleStatus:
    """Status of one vehicle and its link."""

    system_id: int
    kind: str = ""
    """Vehicle type in a word (``copter``, ``rover``), empty before the first heartbeat."""
    mode: str = ""
    armed: bool | None = None
    fix: str = ""
    """``none``, ``2D``, ``3D``, ``DGPS``, ``RTK float``, ``RTK``; empty where it sends no GPS_RAW_INT."""
    heartbeat_age_s: float = math.inf
    """inf never."""
    position_age_s: float = math.inf
    position_state: PositionState = "never"
    period_s: float = math.nan
    """Usual time between positions, NaN unknown."""
    loss: float = math.nan
    """Share of packets lost lately, 0..1, NaN unknown: missing by sequence number, and by what comes regularly."""
    refused: int = 0
    """Positions that were rejected."""
    last_text: str = ""
    frozen: bool = False
    """True if a position that is stale or lost comes over and over: of one place though it drives, or of one time."""
    contested: bool = False
    """True if two senders use this system id (an id conflict): its reports are not used."""
    jumps: bool = False
    """True if its position jumps to and fro, as with a receiver that is jammed or fails: its reports are not used."""
    refusals: Mapping[str, int] = field(default_factory=dict)
    """Counts of what was left out, by reason: positions, and single values of positions that were used without them."""
    refused_for: str = ""
    """Reason why the latest position was not used, empty when it was."""
    copies: int = 0
    """Duplicates: packets that had come before, over another link or twice over one."""
    signed: int = 0
    """Packets with a signature that was verified."""
    unsigned: int = 0
    """Packets without one that was verified, rejected where a key is set."""
    bad_signature: int = 0
    """Packets rejected for their signature: another key, a replay, from the future."""
    replayed: int = 0
    """Packets among these of a recording that is played again."""
    held: int = 0
    """Packets with a right signature that are held: nothing proves that they are made now."""
    held_s: float = math.nan
    """Delay of their timestamps, while every packet is held; else NaN."""
    signs: bool = False
    """Packets were verified and none rejected in the last seconds."""
    link: int = -1
    """Index of the link of its newest packet, −1 before any."""
    channels: tuple[ChannelStatus, ...] = ()
    """The channels that bring its packets, in order of first use."""
    drift_ppm: float = math.nan
    """Rate by which Unix time runs faster than the vehicle's clock, NaN unknown."""
    round_trip_s: float = math.nan
    """Least round trip of TIMESYNC lately; NaN while no request is sent."""
    clock_error_s: float = math.nan
    """The vehicle's own Unix time minus ours; NaN before it has one. Reported, never used."""
    clock_fault: str = ""
    """Fault of its clocks, in words; empty while nothing is. No position depends on it."""
    doubted_for: str = ""
    """Reason why its positions may be wrong by its own report, empty without doubt; they are used, with a wide 1σ."""
    compass_doubted: bool = False
    """True if its compass contradicts its filter: its heading may be wrong."""
    condition: VehicleCondition = VehicleCondition()
    hardware: str = ""
    """Hardware id in hexadecimal, empty before AUTOPILOT_VERSION."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FleetState:
    """All vehicles at one time; n ground vehicles in configured order."""

    t_us: int
    uav: UavState
    system_id: NDArray[np.int64]
    """(n,)"""
    p_enu: Array
    """(n, 3) metres, NaN unknown."""
    v_enu: Array
    """(n, 3) m/s, NaN unknown."""
    heading: Array
    """(n,) radians clockwise from north, NaN unknown."""
    age_s: Array
    """(n,) of the position, inf never."""
    std_m: Array
    """(n,) 1σ of the horizontal position; grows while no report comes."""
    up_std_m: Array
    """(n,) 1σ of the height in ``p_enu``; NaN where the vehicle reports none that is possible."""
    valid: NDArray[np.bool_]
    """(n,) position may be used: reported within two seconds, and not in an id conflict."""
    vehicles: tuple[VehicleStatus, ...]
    """The UAV first, then the ground vehicles."""

    @property
    def contested(self) -> frozenset[int]:
        """System ids with two senders: no track may carry one of these names, and the UAV's puts all in doubt."""
        return frozenset(status.system_id for status in self.vehicles if status.contested)


@dataclass(frozen=True, slots=True, kw_only=True)
class Reports:
    """Accepted positions of ground vehicles, k rows in order of arrival."""

    t_us: NDArray[np.int64]
    """(k,) when they were measured, Unix µs by the vehicle's own corrected clock."""
    system_id: NDArray[np.int64]
    p_enu: Array
    v_enu: Array
    heading: Array
    std_m: Array

    def __len__(self) -> int:
        return self.t_us.size
