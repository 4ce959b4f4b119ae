"""A position that comes over and over is told from one that stops coming, and from that of a parked vehicle."""

import numpy as np
import pytest

from mavlink.protocol.encoder import ROVER
from mavlink.protocol.packet import Packet
from tests.support.flights import FIELD, T0, S, World

STEP_US, MOVING, HANGS_S = S // 4, 2.0, 5.0


def states(report_of, *, seconds=12.0, fills=2, second_us=0):
    """State of a vehicle's position, and whether it is frozen, four times a second.

    Args:
        report_of: by time, s: north, m, its speed, and the time that the report is of; None: none comes.
        fills: attitudes beside each position.
        second_us: by how much later another radio brings each packet once more, 0 without one.
    """
    world, found, due = World(origin=FIELD), [], []
    speaker = world.speakers[11]
    for k in range(round(seconds * S / STEP_US)):
        t_us = T0 + k * STEP_US
        frames = [speaker.attitude(world.boot_ms(11, t_us), 0.0, 0.0, 0.0) for _ in range(fills)]
        frames += [speaker.heartbeat(ROVER)] * (k % 4 == 0)
        if (report := report_of(k * STEP_US / S)) is not None:
            north, v, made_s = report
            lat, lon, alt = (float(x) for x in FIELD.to_geodetic([0.0, north, 0.0]))
            boot_ms = world.boot_ms(11, T0 + round(made_s * S))
            frames.append(speaker.global_position_int(boot_ms, lat, lon, alt, 0.0, (v, 0.0, 0.0), 0.0))
        world.copter(t_us)
        for raw in frames:
            world.feed(raw, t_us)
            due += [(t_us + second_us, raw)] * bool(second_us)
        while due and due[0][0] <= t_us:
            world.fleet.add_packet(Packet(t_us, due.pop(0)[1], 1, 7))
        status = next(each for each in world.fleet.at(t_us).vehicles if each.system_id == 11)
        found.append((status.position_state, status.frozen))
    return found


def drives(t_s):
    return MOVING * t_s, MOVING, t_s


HUNG = {
    "one place, of the time of now": lambda t_s: (*drives(min(t_s, HANGS_S))[:2], t_s),
    "the very same message": lambda t_s: drives(min(t_s, HANGS_S)),
    "the very same message of a vehicle that stood": lambda t_s: (7.0, 0.0, min(t_s, HANGS_S)),
}


@pytest.mark.parametrize("report_of", HUNG.values(), ids=HUNG)
@pytest.mark.parametrize("second_us", [0, 400_000], ids=["one radio", "two radios"])
def test_a_position_that_comes_over_and_over_is_frozen(report_of, second_us):
    found = states(report_of, second_us=second_us)
    assert not any(frozen for _, frozen in found[: round(HANGS_S * 4) + 4])
    assert set(found[round(HANGS_S * 4) + 14 :]) == {("lost", True)}


def test_it_is_frozen_on_when_the_count_of_packets_has_come_round():
    # with so many messages it comes byte for byte again from two seconds after it hung on
    found = states(HUNG["the very same message"], seconds=24.0, fills=30)
    assert set(found[-30:]) == {("lost", True)}


RIGHT = {
    "drives": drives,
    "is parked, and its receiver is noisy": lambda t_s: (float(np.sin(37.0 * t_s)), 0.1, t_s),
    "is parked, and reports one place to the bit": lambda t_s: (7.0, 0.0, t_s),
    "stops at one place to the bit": lambda t_s: (min(MOVING * t_s, 10.0), MOVING * (t_s < HANGS_S), t_s),
    "has fixes once a second": lambda t_s: (MOVING * int(t_s), MOVING, t_s),
    "reports no position any more": lambda t_s: drives(t_s) if t_s < HANGS_S else None,
}


@pytest.mark.parametrize("report_of", RIGHT.values(), ids=RIGHT)
@pytest.mark.parametrize("second_us", [0, 400_000], ids=["one radio", "two radios"])
def test_one_that_moves_is_parked_or_stops_coming_is_not(report_of, second_us):
    found = states(report_of, second_us=second_us)
    assert not any(frozen for _, frozen in found)
    assert {state for state, _ in found[8:20]} == {"ok"}


def test_it_is_over_when_the_vehicle_reports_another_place():
    found = states(lambda t_s: drives(t_s) if t_s > 10.0 else HUNG["one place, of the time of now"](t_s), seconds=14.0)
    assert ("lost", True) in found and found[-1] == ("ok", False)
