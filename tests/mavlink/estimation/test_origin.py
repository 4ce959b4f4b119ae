"""A UAV that says to be elsewhere: at first, for a moment, for good; and the frame that everybody is told in."""

import math

import numpy as np
import pytest

from mavlink.estimation.origin import LOCAL_REACH_M, TOO_FAR
from mavlink.geodesy import separation_m
from tests.support.flights import FIELD, SPEED, T0, S, World

FALSE = {
    "60 km away": (FIELD.lat_deg + 0.54, FIELD.lon_deg),
    "300 km away": (FIELD.lat_deg, FIELD.lon_deg + 3.3),
    "45 degrees of longitude": (FIELD.lat_deg, FIELD.lon_deg - 45.0),
    "85 degrees": (FIELD.lat_deg + 85.0, FIELD.lon_deg),
    "the other hemisphere": (-FIELD.lat_deg, FIELD.lon_deg),
    "the other side of the Earth": (-FIELD.lat_deg, FIELD.lon_deg - 180.0),
    "a pole": (90.0, 0.0),
}

ROVERS = [0, pytest.param(1, marks=pytest.mark.slow), 2, pytest.param(6, marks=pytest.mark.slow)]
"""Two are the fewest that can agree."""


def copter_at(world, t_us, lat, lon, alt=624.0):
    world.attitude(t_us)
    boot_ms = world.boot_ms(1, t_us)
    return world.feed(world.speakers[1].global_position_int(boot_ms, lat, lon, alt, 40.0, (0, 0, 0), 0.5), t_us)


def fly(world, start_us, seconds, place=None):
    """The copter where it is, or at a false place; the rovers where they are."""
    for tick in range(round(seconds * 5)):
        t_us = start_us + tick * 200_000
        world.copter(t_us) if place is None else copter_at(world, t_us, *place)
        for system_id in world.ids:
            world.rover(system_id, t_us + 50_000)
    return start_us + round(seconds * S)


def assert_everybody_is_where_the_truth_is(world, t_us):
    state, origin = world.fleet.at(t_us), world.fleet.origin
    lat, lon, _ = origin.to_geodetic(np.vstack([state.uav.p_enu, state.p_enu]))
    truth = np.array([[0.0, 0.0, 40.0], *(world.rover_truth(i, t_us) for i in world.ids)])
    lat_true, lon_true, _ = FIELD.to_geodetic(truth)
    assert lat == pytest.approx(lat_true, abs=2e-6) and lon == pytest.approx(lon_true, abs=2e-6)
    assert separation_m(FIELD.lat_deg, FIELD.lon_deg, origin.lat_deg, origin.lon_deg) < LOCAL_REACH_M
    assert state.valid.all() and state.uav.position_valid and state.uav.height_m == pytest.approx(40.0, abs=0.1)
    assert [vehicle.position_state for vehicle in state.vehicles] == ["ok"] * (1 + len(world.ids))


@pytest.mark.slow_but_first
@pytest.mark.parametrize("rovers", ROVERS)
@pytest.mark.parametrize("first_s", [0.2, 3.0, 25.0])
@pytest.mark.parametrize("place", FALSE.values(), ids=FALSE)
def test_a_false_first_place_of_the_uav_is_made_good(place, first_s, rovers):
    world = World(rovers=rovers)
    t_us = fly(world, T0, first_s, place)
    t_us = fly(world, t_us, 3.0)
    assert_everybody_is_where_the_truth_is(world, t_us - 200_000)


@pytest.mark.slow_but_first
@pytest.mark.parametrize("rovers", ROVERS)
@pytest.mark.parametrize("for_s", [0.6, 1.6, 12.0])
@pytest.mark.parametrize("place", FALSE.values(), ids=FALSE)
def test_a_false_place_in_flight_is_made_good(place, for_s, rovers):
    world = World(rovers=rovers)
    t_us = fly(world, T0, 5.0)
    t_us = fly(world, t_us, for_s, place)
    t_us = fly(world, t_us, 3.0)
    assert_everybody_is_where_the_truth_is(world, t_us - 200_000)


def test_ground_vehicles_that_agree_say_who_is_wrong():
    world = World(rovers=6)
    t_us = fly(world, T0, 5.0, FALSE["45 degrees of longitude"])
    state = world.fleet.at(t_us - 200_000)
    assert state.vehicles[0].position_state == "refused" and state.vehicles[0].refused_for == TOO_FAR
    assert [vehicle.position_state for vehicle in state.vehicles[1:]] == ["ok"] * 6
    told = [notice for notice in world.notices if "origin moves" in notice.text]
    assert len(told) == 1 and "km to where most vehicles are" in told[0].text and told[0].level == "warning"


def test_one_ground_vehicle_far_away_moves_nobody():
    world = World(rovers=3)
    t_us = fly(world, T0, 3.0)
    origin = world.fleet.origin
    for tick in range(20):
        t_us = T0 + 3 * S + tick * 200_000
        boot_ms = world.boot_ms(11, t_us)
        world.feed(world.speakers[11].global_position_int(boot_ms, 52.0, 13.0, 584.0, 0.0, (SPEED, 0, 0)), t_us)
        world.copter(t_us)
        for system_id in (12, 13):
            world.rover(system_id, t_us)
    state = world.fleet.at(t_us)
    assert world.fleet.origin is origin and state.vehicles[1].refused_for == TOO_FAR
    assert [vehicle.position_state for vehicle in state.vehicles] == ["ok", "refused", "ok", "ok"]


def test_a_uav_that_flies_far_takes_the_origin_along_and_nothing_jumps():
    world = World(rovers=2)
    fly(world, T0, 2.0)
    before = world.fleet.origin
    told = []
    for tick in range(1200):
        t_us = T0 + 2 * S + tick * S
        told += copter_at(world, t_us, FIELD.lat_deg, FIELD.lon_deg + 7.7e-4 * tick)  # 70 m/s
        if tick % 300 == 0:
            for system_id in world.ids:
                world.rover(system_id, t_us + 1000)
    assert separation_m(*_of(before), *_of(world.fleet.origin)) == pytest.approx(LOCAL_REACH_M, rel=0.01)
    assert [notice.text for notice in told] == ["the local origin moves by 50 km to the UAV; names begin anew"]
    assert told[0].level == "info"
    state = world.fleet.at(t_us)
    lat, lon, _ = world.fleet.origin.to_geodetic(state.uav.p_enu)
    assert lon == pytest.approx(FIELD.lon_deg + 7.7e-4 * 1199, abs=1e-6) and lat == pytest.approx(FIELD.lat_deg)


def test_reports_that_wait_move_along():
    world = World(rovers=1)
    fly(world, T0, 1.0, FALSE["60 km away"])
    fly(world, T0 + S, 3.0)
    reports = world.fleet.take_reports()
    lat, lon, _ = world.fleet.origin.to_geodetic(reports.p_enu)
    truth = FIELD.to_geodetic(np.array([world.rover_truth(11, t) for t in reports.t_us.tolist()]))
    assert len(reports) == 20
    assert lat == pytest.approx(truth[0], abs=2e-6) and lon == pytest.approx(truth[1], abs=2e-6)


def test_distances_over_the_globe():
    quarter = 0.5 * math.pi * 6_371_009.0
    assert separation_m(0.0, 0.0, 90.0, 17.0) == pytest.approx(quarter)
    assert separation_m(0.0, 179.5, 0.0, -179.5) == pytest.approx(quarter / 90.0)
    assert separation_m(50.0, 8.0, -50.0, -172.0) == pytest.approx(2.0 * quarter)


def _of(frame):
    return frame.lat_deg, frame.lon_deg
