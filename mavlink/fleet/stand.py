"""The stand of a camera that is on no aircraft: in the fleet it takes the place of the UAV, and never moves."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mavlink.geodesy import R_ENU_NED, LocalFrame, rotation_from_euler
from mavlink.state import UavState, VehicleStatus


@dataclass(frozen=True, slots=True, kw_only=True)
class Stand:
    """Place of a camera that stands, and the way that is ahead there."""

    lat_deg: float
    lon_deg: float
    alt_m: float
    """Altitude above sea level, m, NaN unknown."""
    height_m: float
    """Height above the ground, m, NaN unknown."""
    heading: float
    """Radians, clockwise from north."""

    @property
    def ground_alt_m(self) -> float:
        """Altitude of the ground, NaN unknown."""
        return self.alt_m - self.height_m

    def state(self, frame: LocalFrame | None) -> UavState:
        """State of a UAV that would hang there; without a frame its place is unknown."""
        nowhere = np.full(3, np.nan)
        yaw = self.heading % (2.0 * math.pi)
        return UavState(
            p_enu=nowhere if frame is None else np.array(frame.to_enu_point(self.lat_deg, self.lon_deg, self.alt_m)),
            v_enu=np.zeros(3),
            height_m=self.height_m,
            R_enu_body=R_ENU_NED @ rotation_from_euler(0.0, 0.0, yaw),
            yaw=yaw,
            pitch=0.0,
            roll=0.0,
            R_enu_gimbal=None,
            position_valid=frame is not None,
            attitude_valid=True,
            camera=None,
        )

    def status(self, system_id: int) -> VehicleStatus:
        """Status of what sends nothing and needs to send nothing."""
        return VehicleStatus(system_id=system_id, kind="mast", position_age_s=0.0, position_state="ok")
