"""What the fleet says about itself: frozen records of arrays, order as configured."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

__all__ = ["CameraReport", "FleetState", "Level", "Notice", "PositionState", "Reports", "UavState", "VehicleStatus"]

Array = NDArray[np.float64]
Level = Literal["info", "warning", "alarm"]
PositionState = Literal["ok", "stale", "lost", "never", "refused"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Notice:
    """Something that an operator should know."""

    t_us: int
    level: Level
    kind: str
    """``vehicle``, ``camera`` or ``text``."""
    text: str
    """Plain text, control characters replaced; never markup."""
    system_id: int


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraReport:
    """A camera as the UAV describes it; at least one of its angles is known."""

    width: int
    """Of the picture, px; 0 unknown."""
    height: int
    hfov: float
    """Rad across the picture, NaN unknown."""
    vfov: float
    source: str
    """Name of the message that tells the field of view."""
    rotation_deg: int = 0
    """By which the picture is turned, clockwise: 0, 90, 180 or 270."""
    zoom_percent: float = math.nan
    """Of the camera's whole range of zoom, NaN unknown."""
    model: str = ""
    uri: str = ""
    """Where its video stream is, empty unknown."""


@dataclass(frozen=True, slots=True, kw_only=True)
class UavState:
    """The UAV at one time."""

    p_enu: Array
    """(3,) metres, NaN unknown."""
    v_enu: Array
    """(3,) m/s."""
    height_m: float
    """Above home, NaN unknown."""
    R_enu_body: Array
    """(3, 3), NaN unknown."""
    yaw: float
    """Radians, clockwise from north."""
    pitch: float
    roll: float
    R_enu_gimbal: Array | None
    """(3, 3) gimbal (x along the optical axis, FRD) → ENU, None when not reported in the last second."""
    position_age_s: float
    attitude_age_s: float
    position_valid: bool
    attitude_valid: bool
    camera: CameraReport | None


@dataclass(frozen=True, slots=True, kw_only=True)
class VehicleStatus:
    """How one vehicle and its link are doing."""

    system_id: int
    kind: str
    """``copter``, ``rover`` ..., empty before the first heartbeat."""
    mode: str
    armed: bool | None
    fix: str
    """``none``, ``2D``, ``3D``, ``DGPS``, ``RTK float``, ``RTK``."""
    satellites: int
    heartbeat_age_s: float
    """inf never."""
    position_age_s: float
    attitude_age_s: float
    position_state: PositionState
    period_s: float
    """Usual time between positions, NaN unknown."""
    loss: float
    """Share of packets missing by sequence number, lately, 0..1."""
    refused: int
    """Positions that could not be right, and were not used."""
    last_text: str
    contested: bool = False
    """Two senders use this system id: its reports are not used."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FleetState:
    """Everybody at one time; n ground vehicles in configured order."""

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
    """(n,) 1σ of the horizontal position; grows while nothing is heard."""
    valid: NDArray[np.bool_]
    """(n,) position may be used: state ``ok`` or ``stale``, and not contested."""
    vehicles: tuple[VehicleStatus, ...]
    """The UAV first, then the ground vehicles."""


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
