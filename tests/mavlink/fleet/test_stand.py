"""A camera on a mast takes the UAV's place in the fleet."""

import math

import numpy as np
import pytest

from mavlink.fleet.stand import Stand
from tests.support.flights import FIELD, T0, World

LAT, LON, _ = (float(x) for x in FIELD.to_geodetic([0.0, -60.0, 0.0]))


@pytest.mark.parametrize(
    ("alt_m", "height_m", "at_once"),
    [
        (math.nan, 12.0, False),  # above the ground of whoever is heard first
        (FIELD.alt_m + 20.0, 12.0, True),
        (FIELD.alt_m + 20.0, math.nan, True),
    ],
)
def test_it_stands_where_the_mission_has_it(alt_m, height_m, at_once):
    stand = Stand(lat_deg=LAT, lon_deg=LON, alt_m=alt_m, height_m=height_m, heading=math.radians(-90.0))
    world = World(stand=stand)
    assert world.fleet.at(T0).uav.position_valid == at_once
    end_us = world.run(3, ids=world.ids)
    state = world.fleet.at(end_us)
    assert state.uav.position_valid and state.uav.attitude_valid and not world.fleet.awaits(end_us)
    up_m = 12.0 if math.isnan(alt_m) else 20.0
    assert state.p_enu[0] - state.uav.p_enu == pytest.approx([0.0, 60.0 + 4.0 * 3.0, -up_m], abs=0.3)
    assert np.isfinite(state.up_std_m).all(), "altitudes tell how high the ground is"
    assert state.uav.R_enu_body[:, 0] == pytest.approx([-1.0, 0.0, 0.0])
    assert [v.position_state for v in state.vehicles] == ["ok"] * 3 and state.vehicles[0].kind == "mast"
    assert {notice.level for notice in world.notices} == {"info"}


def test_vehicles_far_from_where_it_is_said_to_be_are_the_origin():
    lat, lon, _ = (float(x) for x in FIELD.to_geodetic([0.0, -300_000.0, 0.0]))
    stand = Stand(lat_deg=lat, lon_deg=lon, alt_m=math.nan, height_m=12.0, heading=0.0)
    world = World(rovers=3, stand=stand)
    state = world.fleet.at(world.run(5, ids=world.ids))
    assert state.valid.all() and np.linalg.norm(state.uav.p_enu) > 1e5
