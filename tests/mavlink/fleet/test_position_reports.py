"""Every kind of report that is not the truth, as it comes over the air: left out, counted by reason, never fatal."""

import math
from dataclasses import dataclass

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega

from mavlink.estimation.origin import TOO_FAR
from mavlink.protocol.packet import Packet
from tests.support.flights import FIELD, T0, S, World

INT32_MAX, INT32_MIN, INT16_MAX = 2**31 - 1, -(2**31), 2**15 - 1
WEEK_S = 7 * 86400


@pytest.fixture
def world():
    return World(origin=FIELD)


def position(world, t_us, *, system_id=11, boot_ms=None, **fields):
    """A GLOBAL_POSITION_INT in units of the wire; what is not given is the truth."""
    east, north, _ = world.rover_truth(system_id, t_us) if system_id != 1 else (0.0, 0.0, 0.0)
    lat, lon, alt = FIELD.to_geodetic([east, north, 40.0 if system_id == 1 else 0.0])
    truth = {
        "lat": round(float(lat) * 1e7),
        "lon": round(float(lon) * 1e7),
        "alt": round(float(alt) * 1e3),
        "relative_alt": 40_000 if system_id == 1 else 0,
        "vx": 0 if system_id == 1 else 400,
        "vy": 0,
        "vz": 0,
        "hdg": 0,
    }
    boot_ms = world.boot_ms(system_id, t_us) if boot_ms is None else boot_ms
    message = ardupilotmega.MAVLink_global_position_int_message(boot_ms, **(truth | fields))
    return world.speakers[system_id].pack(message)


def counts(world, system_id=11, t_us=T0):
    status = next(v for v in world.fleet.at(t_us).vehicles if v.system_id == system_id)
    return dict(status.refusals)


@dataclass(frozen=True)
class Case:
    name: str
    fields: dict
    reason: str
    system_id: int = 11


NOWHERE = [
    Case("latitude beyond the pole", {"lat": 900_000_001}, "out of range"),
    Case("longitude beyond the date line", {"lon": 1_800_000_001}, "out of range"),
    Case("0/0", {"lat": 0, "lon": 0}, "no fix (0/0)"),
    Case("353/-129 of an autopilot before its fix", {"lat": 353, "lon": -129}, "no fix (0/0)"),
    Case("just inside a thousandth of a degree", {"lat": 9_999, "lon": -9_999}, "no fix (0/0)"),
    Case("INT32_MAX for unknown", {"lat": INT32_MAX, "lon": INT32_MAX}, "out of range"),
    Case("INT32_MIN for unknown", {"lat": INT32_MIN, "lon": INT32_MIN}, "out of range"),
    Case("a place that nothing drives to", {"lat": -353_580_000}, "farther than it can have driven"),
    Case("the other side of the earth", {"lat": 353_630_000, "lon": -308_350_000}, TOO_FAR),
    Case("the aircraft's altitude unknown", {"alt": INT32_MAX}, "altitude unknown", 1),
    Case("the aircraft's altitude below the sea's floor", {"alt": -12_000_000}, "altitude unknown", 1),
    Case("the aircraft six hundred metres higher", {"alt": 1_224_000}, "higher or lower than it can have flown", 1),
    Case("the aircraft at sea level", {"alt": 0}, "higher or lower than it can have flown", 1),
]


@pytest.mark.parametrize("case", NOWHERE, ids=lambda case: case.name)
def test_a_position_that_is_none(world, case):
    end_us = world.run(5)
    world.fleet.take_reports()
    t_us = end_us + 50_000
    world.feed(position(world, t_us, system_id=case.system_id, **case.fields), t_us)
    assert counts(world, case.system_id)[case.reason] == 1
    assert world.fleet.at(t_us).vehicles[1 if case.system_id == 11 else 0].refused == 1
    assert not (world.fleet.take_reports().t_us >= end_us).any()
    state = world.fleet.at(t_us)
    assert state.p_enu[0, :2] == pytest.approx(world.rover_truth(11, t_us)[:2], abs=0.1)
    assert state.uav.p_enu == pytest.approx([0, 0, 40], abs=0.1) and state.uav.height_m == pytest.approx(40.0)
    world.run(2, start_us=end_us + 100_000)
    assert world.fleet.at(end_us + 2 * S).valid.all()


VALUES = [
    Case("heading 65535", {"hdg": 65535}, ""),
    Case("heading 40000", {"hdg": 40_000}, ""),
    Case("heading across the course", {"hdg": 9_000}, "heading, against course or attitude"),
    Case("velocity beyond the limit", {"vx": 20_000}, "faster than it can be"),
    Case("velocity INT16_MAX", {"vx": INT16_MAX, "vy": INT16_MAX}, ""),
    Case("a rover at sea level", {"alt": 0}, "altitude, far from the ground"),
    Case("a rover's altitude INT32_MAX", {"alt": INT32_MAX}, "altitude, far from the ground"),
]


@pytest.mark.parametrize("case", VALUES, ids=lambda case: case.name)
def test_a_value_that_is_none_costs_only_itself(world, case):
    end_us = world.run(5)
    for i in range(12):  # a heading is doubted when it contradicts the course again and again
        t_us = end_us + i * 200_000
        world.copter(t_us)
        world.feed(position(world, t_us, **case.fields), t_us)
    state = world.fleet.at(t_us)
    assert state.valid[0] and state.p_enu[0] == pytest.approx([0.0, world.rover_truth(11, t_us)[1], 0.0], abs=0.1)
    if "hdg" in case.fields:
        assert math.isnan(state.heading[0])
    if "vx" in case.fields:
        assert np.isnan(state.v_enu[0, :2]).all()
    if case.reason:
        assert counts(world, t_us=t_us)[case.reason] >= 1
    assert state.vehicles[1].refused == 0


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 1e30])
@pytest.mark.parametrize("at", range(3))
def test_an_attitude_that_is_none(world, bad, at):
    end_us = world.run(5)
    angles = [0.0, 0.0, 0.5]
    angles[at] = bad
    world.feed(world.speakers[1].attitude(world.boot_ms(1, end_us), *angles), end_us)
    state = world.fleet.at(end_us)
    assert counts(world, 1)["attitude that is none"] == 1
    assert (state.uav.roll, state.uav.pitch, state.uav.yaw) == pytest.approx((0.0, 0.0, 0.5))


@pytest.mark.parametrize("rate", [math.nan, math.inf, 1e30])
def test_a_turning_rate_that_is_none_turns_nothing(world, rate):
    end_us = world.run(2)
    world.feed(world.speakers[1].attitude(world.boot_ms(1, end_us), 0, 0, 0.5, (rate, rate, rate)), end_us)
    uav = world.fleet.at(end_us + 200_000).uav
    assert (uav.roll, uav.pitch, uav.yaw) == pytest.approx((0.0, 0.0, 0.5))


def test_home_is_not_learnt_from_a_height_that_is_none(world):
    end_us = world.run(3)
    world.feed(position(world, end_us, system_id=1, relative_alt=INT32_MAX), end_us)
    world.rover(11, end_us + 10_000, alt=0.0)
    state = world.fleet.at(end_us + 20_000)
    assert state.p_enu[0, 2] == pytest.approx(0.0, abs=0.1)
    assert not state.uav.height_m > 1000


def test_a_position_older_than_two_seconds_is_not_used(world):
    end_us = world.run(5)
    last_us = end_us - 200_000
    assert world.fleet.at(last_us + 1_900_000).valid[0]
    assert not world.fleet.at(last_us + 2_100_000).valid[0]


def test_a_reboot_is_followed_and_nothing_is_interpolated_across_it(world):
    end_us = world.run(5)
    world.booted_us[11] = end_us + S
    world.run(3, start_us=end_us + 1_300_000)
    t_us = end_us + 4 * S
    state = world.fleet.at(t_us)
    assert [n.text for n in world.notices if "reboot" in n.text] == ["system 11 has rebooted"]
    assert state.p_enu[0, 1] == pytest.approx(world.rover_truth(11, t_us)[1], abs=0.1)
    assert not state.vehicles[1].contested
    assert counts(world)["of another clock"] <= 3  # until the new count is believed


def test_the_boot_clock_wraps_after_49_days(world):
    world.booted_us[11] = T0 + 3 * S - (1 << 32) * 1000
    moved = []
    for tick in range(30):
        t_us = T0 + tick * 200_000
        world.copter(t_us)
        boot_ms = world.boot_ms(11, t_us) % (1 << 32)
        world.feed(position(world, t_us, boot_ms=boot_ms), t_us)
        moved.append(world.fleet.at(t_us).p_enu[0, 1] - world.rover_truth(11, t_us)[1])
    assert np.abs(moved).max() < 0.1
    assert not world.fleet.at(t_us).vehicles[1].contested and not counts(world)
    assert not any("reboot" in n.text for n in world.notices)


@pytest.mark.parametrize("rollovers", [-1, 1, 2])
def test_gps_weeks_rolled_over_are_told_and_move_nothing(world, rollovers):
    world.run(5)
    before = world.fleet.at(T0 + 5 * S)
    wrong_us = T0 + 5 * S + rollovers * 1024 * WEEK_S * S
    assert world.feed(world.speakers[11].system_time(world.boot_ms(11, T0 + 5 * S), wrong_us), T0 + 5 * S) == ()
    state = world.fleet.at(T0 + 5 * S)
    fault = f"its date is {rollovers * 1024:+d} weeks off (GPS week number rollover)"
    assert state.vehicles[1].clock_fault == fault
    assert state.vehicles[1].clock_error_s == pytest.approx(rollovers * 1024 * WEEK_S, abs=1)
    assert np.array_equal(state.p_enu, before.p_enu)


def test_reports_out_of_order_do_not_move_anybody_back(world):
    for tick in range(0, 50, 2):
        for k in (1, 0):  # pairs the wrong way round
            t_us = T0 + (tick + k) * 200_000
            world.rover(11, t_us, delay_us=(1 - k) * 250_000)
        world.copter(t_us)
    now_us = t_us + 250_000
    assert world.fleet.at(now_us).p_enu[0, 1] == pytest.approx(world.rover_truth(11, now_us)[1], abs=1.0)
    assert not world.fleet.at(now_us).vehicles[1].contested


@pytest.mark.parametrize("loss", [0.0, 0.3], ids=["copies only", "copies and first-hand news ten seconds old"])
def test_a_second_link_ten_seconds_late_never_moves_anybody(world, loss):
    rng = np.random.default_rng(1)
    sent, off = [], []
    for tick in range(300):
        t_us = T0 + tick * 100_000
        world.copter(t_us)
        frame = position(world, t_us) if tick % 2 else world.speakers[11].heartbeat()
        sent.append((t_us, frame))
        if tick < 50 or rng.random() >= loss:
            world.fleet.add_packet(Packet(t_us, frame, 0, 1))
        if tick >= 100:
            late = world.fleet.add_packet(Packet(t_us + 50_000, sent[tick - 100][1], 1, 1))
            assert late == ()
        now_us = t_us + 60_000
        if tick > 10:
            off.append(world.fleet.at(now_us).p_enu[0, 1] - world.rover_truth(11, now_us)[1])
    state = world.fleet.at(now_us)
    assert np.abs(off).max() < 0.2
    assert not state.vehicles[1].contested and state.valid[0]
    assert state.vehicles[1].copies > 100
    assert [round(channel.late_s) for channel in state.vehicles[1].channels] == [0, 10]
    if loss:
        assert sum(counts(world).values()) > 10


def test_only_the_late_link_is_left(world):
    """What is ten seconds old is not taken for now, when it is known that its link is late."""
    sent = []
    for tick in range(400):
        t_us = T0 + tick * 100_000
        frame = position(world, t_us)
        sent.append(frame)
        world.copter(t_us)
        if tick < 200:
            world.fleet.add_packet(Packet(t_us, frame, 0, 1))
        if tick >= 100:
            world.fleet.add_packet(Packet(t_us + 50_000, sent[tick - 100], 1, 1))
    assert not world.fleet.at(t_us).valid[0]
    assert counts(world)["over a link that is seconds late"] == 100


def test_a_clock_that_jumps_is_followed_and_then_the_place_is_right_again(world):
    end_us = world.run(5)
    world.booted_us[11] -= 500 * S  # the count is 500 s ahead from now on
    world.run(6, start_us=end_us)
    t_us = end_us + 6 * S
    assert world.fleet.at(t_us).p_enu[0, 1] == pytest.approx(world.rover_truth(11, t_us)[1], abs=0.1)
    assert not world.fleet.at(t_us).vehicles[1].contested
    assert 0 < counts(world)["of another clock"] <= 20


def test_a_height_that_leaps_and_comes_back_is_one_bad_receiver():
    world = World(origin=FIELD)
    world.run(3)
    for tick in range(60):
        world.copter(T0 + 3 * S + tick * 200_000, up=100.0 if 5 <= tick < 25 else 40.0)
    alarms = [notice.text for notice in world.notices if notice.level == "alarm"]
    assert alarms == ["position jumped by 60 m and stayed there: accepted"] * 2, "and no second sender"
    assert not world.fleet.at(T0 + 15 * S).vehicles[0].contested


def test_a_reboot_without_a_fix_yet_is_no_bad_receiver():
    world = World(origin=FIELD)
    reboots_us = world.run(5)
    states = set()
    for k in range(20):
        t_us = reboots_us + S + k * 100_000
        world.feed(world.speakers[11].global_position_int(1500 + k * 100, 0, 0, 0), t_us)
        states.add(world.fleet.at(t_us).vehicles[1].position_state)
    assert states == {"stale", "never"}
