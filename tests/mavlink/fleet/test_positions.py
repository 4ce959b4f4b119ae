import math

import numpy as np
import pytest

from mavlink.fleet.fleet import Fleet
from mavlink.protocol.encoder import MavlinkEncoder
from tests.support.flights import FIELD, SPEED, T0, S, World
from tests.support.waiting import calls_of


@pytest.fixture
def world():
    return World(origin=FIELD)


def test_everybody_is_where_the_truth_is(world):
    end_us = world.run(10)
    for t_us in (end_us - 3 * S - 70_000, end_us - 120_000, end_us):
        state = world.fleet.at(t_us)
        assert state.p_enu[:, :2] == pytest.approx(
            np.array([world.rover_truth(i, t_us)[:2] for i in world.ids]), abs=0.05
        )
        assert state.v_enu == pytest.approx(np.tile([0.0, SPEED, 0.0], (2, 1)), abs=0.01)
        assert state.valid.all()
        assert state.heading == pytest.approx([0.0, 0.0], abs=1e-6)
        assert state.std_m == pytest.approx([2.0, 2.0], abs=0.1)
        assert [v.position_state for v in state.vehicles] == ["ok"] * 3
    assert state.system_id.tolist() == [11, 12]
    assert state.uav.p_enu == pytest.approx([0, 0, 40], abs=0.02)
    assert state.uav.height_m == pytest.approx(40.0, abs=1e-3)
    assert state.uav.yaw == pytest.approx(0.5, abs=1e-6)
    assert state.uav.position_valid and state.uav.attitude_valid
    assert [v.mode for v in state.vehicles] == ["GUIDED", "AUTO", "AUTO"]
    assert [v.kind for v in state.vehicles] == ["copter", "rover", "rover"]
    assert state.vehicles[1].period_s == pytest.approx(0.2, abs=0.01)
    assert state.vehicles[1].loss == 0.0


def test_before_anything_is_heard():
    state = World(rovers=3).fleet.at(T0)
    assert not state.valid.any()
    assert np.isnan(state.p_enu).all() and np.isinf(state.age_s).all()
    assert [v.position_state for v in state.vehicles] == ["never"] * 4
    assert not state.uav.position_valid and not state.uav.attitude_valid
    assert state.uav.R_enu_gimbal is None and state.uav.camera is None
    assert state.vehicles[0].armed is None
    assert len(World().fleet.take_reports()) == 0


def test_fleet_without_ground_vehicles():
    state = Fleet(1, []).at(T0)
    assert state.p_enu.shape == (0, 3) and state.valid.shape == (0,)


def test_stale_then_lost(world):
    end_us = world.run(5)
    world.run(5, start_us=end_us, ids=[1, 12])
    silent_us = end_us - 200_000  # the last report of rover 11
    states = {dt: world.fleet.at(silent_us + int(dt * S)) for dt in (0.3, 0.9, 1.1, 2.1, 3.1, 4.0)}
    assert [states[dt].vehicles[1].position_state for dt in states] == [
        *("ok", "ok", "stale", "stale", "lost", "lost")  # radios that are a few tenths late are no trouble
    ]
    assert [bool(states[dt].valid[0]) for dt in states] == [True, True, True, False, False, False]
    assert states[4.0].age_s[0] == pytest.approx(4.0, abs=0.02)
    assert states[4.0].vehicles[1].heartbeat_age_s > 4.0
    assert all(state.valid[1] for state in states.values())
    stds = [float(state.std_m[0]) for state in states.values()]
    assert stds == sorted(stds) and stds[-1] > 10.0


def test_attitude_is_lost_after_half_a_second(world):
    end_us = world.run(3)
    last_us = end_us - 50_000
    assert world.fleet.at(last_us + 450_000).uav.attitude_valid
    assert not world.fleet.at(last_us + 550_000).uav.attitude_valid


def test_attitude_between_and_beyond_reports(world):
    world.copter(T0)
    for i in range(10):
        world.attitude(T0 + i * 100_000, yaw=3.0 + 0.05 * i, rate=0.5)
    assert world.fleet.at(T0 + 450_000).uav.yaw == pytest.approx(3.225, abs=1e-5)
    assert world.fleet.at(T0 + 1_100_000).uav.yaw == pytest.approx(3.55, abs=1e-4)
    nose = world.fleet.at(T0 + 450_000).uav.R_enu_body @ [1, 0, 0]
    assert nose == pytest.approx([math.sin(3.225), math.cos(3.225), 0], abs=1e-5)


def test_origin_is_the_first_place_of_the_uav():
    world = World()
    world.rover(11, T0)
    assert world.fleet.origin is None
    world.copter(T0 + 10_000)
    assert world.fleet.origin is not None
    assert world.fleet.origin.lat_deg == pytest.approx(FIELD.lat_deg, abs=1e-6)
    reports = world.fleet.take_reports()
    assert reports.system_id.tolist() == [11]  # what came before the origin is not lost
    state = world.fleet.at(T0)
    assert state.p_enu[0] == pytest.approx([0, 0, -40], abs=0.05)


def test_origin_without_a_uav_comes_after_ten_seconds():
    world = World()
    for i in range(60):
        world.rover(11, T0 + i * 200_000)
    assert world.fleet.origin is not None
    assert world.fleet.at(T0 + 11_800_000).valid[0]
    assert len(world.fleet.take_reports()) == 60


def test_reports_carry_the_vehicles_own_time(world):
    for i in range(100):
        t_us = T0 + i * 200_000
        world.copter(t_us)
        world.rover(11, t_us, delay_us=[0, 30_000, 300_000, 5_000][i % 4])
    reports = world.fleet.take_reports()
    assert len(reports) == 100
    assert reports.t_us == pytest.approx([T0 + i * 200_000 for i in range(100)], abs=4000)
    assert reports.p_enu[:, 1] == pytest.approx(SPEED * 0.2 * np.arange(100), abs=0.02)
    assert (reports.heading == 0.0).all() and (reports.std_m == 2.0).all()
    assert len(world.fleet.take_reports()) == 0


def restart(world, end_us, off_s):
    """Everybody is switched off at a time and on again: boot times begin anew."""
    world.booted_us = dict.fromkeys(world.booted_us, end_us + (off_s - 1) * S)
    return end_us + off_s * S


@pytest.mark.parametrize("off_s", [2, 35, 600])
def test_reports_that_nobody_has_taken_keep_their_time_when_the_vehicle_reboots(world, off_s):
    start_us = restart(world, world.run(5), off_s)
    world.run(5, start_us=start_us)
    reports = world.fleet.take_reports()
    of_one = reports.t_us[reports.system_id == 11]
    before, after = of_one[of_one < start_us], of_one[of_one >= start_us]
    assert before == pytest.approx([T0 + k * 200_000 for k in range(25)], abs=4000)
    assert len(after) >= 20 and after[-1] == pytest.approx(start_us + 4_800_000, abs=4000)


def test_a_reboot_before_the_origin_is_known_does_not_shut_the_vehicle_out():
    world = World()
    start_us = restart(world, world.run(3, ids=[11]), 3)
    world.run(2, start_us=start_us, ids=[11])
    end_us = world.run(5, start_us=start_us + 2 * S)
    assert world.fleet.at(end_us).valid[0]
    assert world.fleet.at(end_us).p_enu[0, 1] == pytest.approx(world.rover_truth(11, end_us)[1], abs=0.1)


def test_nonsense_is_counted_said_once_and_not_used(world):
    end_us = world.run(3)
    world.fleet.take_reports()
    bad = world.speakers[11]
    said = []
    for i, (lat, lon) in enumerate([(0, 0), (353e-7, -129e-7), (214.7483647, 0)]):
        frame = bad.global_position_int(world.boot_ms(11, end_us + i * 200_000), lat, lon, 584)
        said += world.feed(frame, end_us + i * 200_000)
    assert [notice.text for notice in said] == [
        "position not used: no fix (0/0)",
        "position not used: out of range",
    ]
    state = world.fleet.at(end_us + 600_000)
    assert state.vehicles[1].refused == 3
    assert state.vehicles[1].position_state == "refused"
    assert len(world.fleet.take_reports()) == 0
    assert state.p_enu[0, 1] == pytest.approx(SPEED * 3.6, abs=0.2)


def test_waiting_for_the_first_fix_is_no_fault_and_nonsense_is_one(world):
    (said,) = world.feed(world.speakers[11].global_position_int(1000, 0, 0, 0), T0)
    world.feed(world.speakers[12].global_position_int(1000, 214.7483647, 0, 0), T0)
    assert world.fleet.at(T0 + 100_000).vehicles[1].position_state == "never" and said.level == "info"
    assert world.fleet.at(T0 + 100_000).vehicles[2].position_state == "refused"


@pytest.mark.parametrize("alt", [0.14, 1167.9, 2147483.647])
def test_rover_with_the_wrong_altitude_stands_on_the_home_plane(world, alt):
    world.copter(T0)
    world.rover(11, T0, alt=alt)
    state = world.fleet.at(T0)
    assert state.p_enu[0] == pytest.approx([0, 0, 0], abs=0.05)
    assert state.valid[0]


def test_slope_within_reason_is_kept(world):
    world.copter(T0)
    world.rover(11, T0, alt=596.0)
    assert world.fleet.at(T0).p_enu[0, 2] == pytest.approx(12.0, abs=0.05)


def test_uav_without_altitude_has_no_position(world):
    frame = world.speakers[1].global_position_int(1000, FIELD.lat_deg, FIELD.lon_deg, 2147483.647, 40.0)
    assert [n.text for n in world.feed(frame, T0)] == ["position not used: altitude unknown"]
    assert not world.fleet.at(T0).uav.position_valid


def test_accuracy_comes_from_the_receiver(world):
    world.copter(T0)
    world.feed(world.speakers[11].gps_raw_int(0, 1, 2, 3, fix_type=6, satellites=17, h_acc_m=0.3), T0)
    world.rover(11, T0)
    state = world.fleet.at(T0)
    assert state.std_m[0] == pytest.approx(0.3)
    assert (state.vehicles[1].fix, state.vehicles[1].condition.satellites) == ("RTK", 17)
    said = world.feed(world.speakers[11].gps_raw_int(0, 1, 2, 3, fix_type=1), T0 + S)
    assert [(n.level, n.text) for n in said] == [("warning", "GPS fix none, was RTK")]
    assert "no GPS fix" in world.rover(11, T0 + S)[0].text


def test_heading_unknown_is_nan(world):
    world.copter(T0)
    world.rover(11, T0, heading=math.nan)
    assert math.isnan(world.fleet.at(T0).heading[0])


def test_heading_that_contradicts_the_attitude_is_nan(world):
    world.copter(T0)
    world.attitude(T0 - 10_000, yaw=1.0, system_id=11)
    world.rover(11, T0, heading=0.0)
    assert math.isnan(world.fleet.at(T0).heading[0])


def test_impossible_velocity_is_not_used(world):
    world.copter(T0)
    world.rover(11, T0, v=120.0)
    state = world.fleet.at(T0 + S)
    assert np.isnan(state.v_enu[0, :2]).all()
    assert state.p_enu[0, :2] == pytest.approx([0, 0], abs=0.02)


def test_copies_that_come_ten_seconds_late_change_nothing(world):
    end_us = world.run(12)
    expected = world.fleet.at(end_us - 50_000)
    world.fleet.take_reports()
    for i in range(20):
        world.rover(11, end_us - 10 * S + i * 200_000, delay_us=10 * S - i * 190_000)
    state = world.fleet.at(end_us - 50_000)
    assert state.p_enu == pytest.approx(expected.p_enu, abs=1e-6)
    assert state.valid.all()
    assert len(world.fleet.take_reports()) == 0
    assert not [n for n in world.notices if n.level != "info"]


def test_other_components_do_not_move_the_vehicle(world):
    end_us = world.run(2)
    lat, lon, alt = (float(a) for a in FIELD.to_geodetic([3.0, 3.0, 0.0]))
    frame = MavlinkEncoder(11, 191).global_position_int(world.boot_ms(11, end_us), lat, lon, alt, 0, (0, 0, 0), 1.0)
    world.feed(frame, end_us)
    assert world.fleet.at(end_us).p_enu[0] == pytest.approx(world.rover_truth(11, end_us), abs=0.05)


def calls_of_a_look(rovers, seconds):
    world = World(rovers=rovers, origin=FIELD)
    end_us = world.run(seconds)
    return calls_of(lambda: world.fleet.at(end_us - 10_000))


def test_looking_at_a_large_fleet_is_cheap():
    assert calls_of_a_look(50, 2) < min(5.5 * calls_of_a_look(10, 2), 300 * 50)
    assert calls_of_a_look(10, 6) <= 1.1 * calls_of_a_look(10, 2), "what was heard before costs nothing"
