"""What the UAV measures of the ground below it: rangefinder and terrain map, from packets."""

import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from tests.support.flights import S, World

DOWN = 25


def ranged(distance_cm, *, orientation=DOWN, least_cm=20, most_cm=5000, **more):
    return dialect.MAVLink_distance_sensor_message(1000, least_cm, most_cm, distance_cm, 0, 0, orientation, 255, **more)


def terrain(height_m, *, spacing=100):
    return dialect.MAVLink_terrain_report_message(0, 0, spacing, 500.0, height_m, 0, 24)


def hear(said, *, system_id=1, later_us=0):
    world = World()
    end_us = world.run(2)
    world.feed(world.speakers[system_id].pack(said), end_us)
    return world.fleet.at(end_us + later_us).uav


def test_a_range_downwards_and_a_height_above_the_terrain_are_known_for_a_second():
    assert hear(ranged(3850)).range_m == pytest.approx(38.5)
    assert hear(terrain(41.5)).terrain_height_m == pytest.approx(41.5)
    assert hear(ranged(3850), later_us=S).range_m == pytest.approx(38.5)
    for said in (ranged(3850), terrain(41.5)):
        old = hear(said, later_us=2 * S)
        assert math.isnan(old.range_m) and math.isnan(old.terrain_height_m)


@pytest.mark.parametrize(
    "said",
    [
        ranged(3850, orientation=0),
        ranged(5000),
        ranged(5100),
        ranged(20),
        ranged(0),
        ranged(3850, signal_quality=1),
        terrain(41.5, spacing=0),
        terrain(math.nan),
    ],
    ids=["forward", "at its limit", "too far", "at its least", "nothing", "invalid", "no map", "not a number"],
)
def test_what_measures_nothing_is_left_out(said):
    uav = hear(said)
    assert math.isnan(uav.range_m) and math.isnan(uav.terrain_height_m)


def test_the_ranges_of_ground_vehicles_are_not_the_uavs():
    assert math.isnan(hear(ranged(3850), system_id=11).range_m)


def test_a_range_beyond_its_limit_leaves_the_one_before():
    world = World()
    end_us = world.run(2)
    for later_us, distance_cm in ((0, 3850), (100_000, 6000)):
        world.feed(world.speakers[1].pack(ranged(distance_cm)), end_us + later_us)
    assert world.fleet.at(end_us + 100_000).uav.range_m == pytest.approx(38.5)
