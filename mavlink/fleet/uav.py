"""The UAV at a time, and whether it is known yet as well as it will be."""

from __future__ import annotations

import math

import numpy as np

from mavlink.estimation.gimbal import Gimbals
from mavlink.estimation.ground_distance import GroundDistance
from mavlink.estimation.interpolation import ATTITUDE_LOST_S, Fix
from mavlink.fleet.vehicle import Vehicle
from mavlink.geodesy import R_ENU_NED, rotation_from_euler
from mavlink.state import CameraReport, UavState

NO_FIX = Fix(*[math.nan] * 10)
_REPORTING_US = 1_000_000
"""Time after which nothing is waited for any more: it stopped, or comes too rarely to interpolate."""


def uav_state(
    uav: Vehicle, gimbals: Gimbals, camera: CameraReport | None, ground: GroundDistance, t_us: int
) -> UavState:
    """The UAV at a Unix time, each sample by its own time.

    Args:
        ground: what it reports of the ground below it.
        t_us: when.
    """
    boot_us = uav.clock.boot_of(t_us)
    estimate, pose = uav.positions.at(boot_us), uav.attitudes.at(boot_us)
    fix = estimate.fix if estimate else NO_FIX
    roll, pitch, yaw = pose[:3] if pose else (math.nan, math.nan, math.nan)
    fresh = pose is not None and (pose.bracketed or pose.age_s <= ATTITUDE_LOST_S)
    return UavState(
        p_enu=np.array(fix[0:3]),
        v_enu=np.array(fix[3:6]),
        height_m=fix.height_m,
        R_enu_body=R_ENU_NED @ rotation_from_euler(roll, pitch, yaw),
        yaw=yaw % (2.0 * math.pi),
        pitch=pitch,
        roll=roll,
        R_enu_gimbal=gimbals.at(boot_us, yaw),
        position_valid=estimate is not None and estimate.usable and uav.is_trusted(t_us),
        attitude_valid=fresh and not uav.in_conflict(t_us),
        camera=camera,
        range_m=ground.range_m(t_us),
        terrain_height_m=ground.terrain_height_m(t_us),
        std_m=fix.std_m,
    )


def is_awaited(uav: Vehicle, gimbals: Gimbals, t_us: int) -> bool:
    """Tell whether a position, attitude or gimbal's attitude that belongs to a Unix time is still to come."""
    boot_us = uav.clock.boot_of(t_us)
    newest = (uav.positions.newest, uav.attitudes.newest, gimbals.newest)
    return any(sample is not None and 0 < boot_us - sample[0] <= _REPORTING_US for sample in newest)
