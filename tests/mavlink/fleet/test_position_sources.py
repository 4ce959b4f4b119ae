"""Places that come otherwise than as the autopilot's GLOBAL_POSITION_INT by the autopilot's clock."""

import math

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega

from tests.support.flights import FIELD, ROVER, SPEED, T0, S, World
from tests.support.frames import MessageEncoder

FIRST_S, LAST_S = 6, 20
"""Start of the time in which the rover has to have a place, and end of the flight, s."""


class Bridge:
    """A rover whose autopilot sends heartbeats and attitudes, and whose places somebody else sends."""

    def __init__(self, *, component_id=1, boot_ms=None, raw=False, rate_hz=5, fix_type=3):
        self.world = World(rovers=2, origin=FIELD)
        self.sender = MessageEncoder(11, component_id)
        self.boot_ms, self.raw, self.rate_hz, self.fix_type = boot_ms, raw, rate_hz, fix_type

    def place(self, t_us, north_m=0.0):
        """One report, ``north_m`` beside the truth."""
        lat, lon, alt = (
            float(a) for a in FIELD.to_geodetic(self.world.rover_truth(11, t_us) + np.array([0.0, north_m, 0.0]))
        )
        own_ms = self.world.boot_ms(11, t_us)
        if self.raw:
            place = round(lat * 1e7), round(lon * 1e7), round(alt * 1e3)
            message = ardupilotmega.MAVLink_gps_raw_int_message(
                own_ms * 1000, self.fix_type, *place, 80, 100, round(SPEED * 100), 0, 17, h_acc=300
            )
            frame = self.sender.pack(message)
        else:
            boot_ms = own_ms if self.boot_ms is None else self.boot_ms(t_us)
            frame = self.sender.global_position_int(boot_ms, lat, lon, alt, 0.0, (SPEED, 0, 0), 0.0)
        self.world.feed(frame, t_us)

    def states(self):
        """Fly; yield time and state from ``FIRST_S`` on."""
        world = self.world
        for tick in range(LAST_S * 20):
            t_us = T0 + tick * 50_000
            for system_id in (1, 11):
                world.attitude(t_us, system_id=system_id, yaw=0.0)
            if tick % 4 == 0:
                world.copter(t_us)
                world.rover(12, t_us)
            if tick % (20 // self.rate_hz) == 0:
                self.place(t_us)
            if tick % 20 == 0:
                world.feed(world.speakers[11].heartbeat(ROVER, custom_mode=10), t_us)
            if tick >= FIRST_S * 20:
                yield t_us, world.fleet.at(t_us)

    def run(self):
        """Fly; return how far the rover's places are from the truth, m."""
        errors_m = []
        for t_us, state in self.states():
            assert state.valid[0], f"no position after {(t_us - T0) / S:.2f} s"
            errors_m.append(float(np.linalg.norm(state.p_enu[0] - self.world.rover_truth(11, t_us))))
        return errors_m

    def texts(self):
        return [notice.text for notice in self.world.notices if notice.system_id == 11 and notice.level != "info"]


def epoch_ms(t_us):
    return t_us // 1000 % (1 << 32)


@pytest.mark.parametrize("rate_hz", [1, 5, 10])
@pytest.mark.parametrize("boot_ms", [lambda t_us: 0, epoch_ms], ids=["without boot time", "by Unix time"])
@pytest.mark.parametrize("component_id", [1, 191])
def test_positions_by_another_count_than_attitudes(component_id, boot_ms, rate_hz):
    bridge = Bridge(component_id=component_id, boot_ms=boot_ms, rate_hz=rate_hz)
    assert max(bridge.run()) < 0.5
    assert bridge.texts() == []


def test_positions_of_a_companion_are_used_where_the_autopilot_has_none():
    bridge = Bridge(component_id=191)
    assert max(bridge.run()) < 0.1
    assert bridge.world.fleet.at(T0 + LAST_S * S).vehicles[1].fix == "", "nothing tells of its receiver"
    notices = [notice for notice in bridge.world.notices if "positions are those" in notice.text]
    assert [(n.system_id, n.level, n.text) for n in notices] == [
        (11, "info", "positions are those of component 191, since its autopilot reports none")
    ]


def test_a_companion_never_replaces_an_autopilot_that_has_reported_a_place():
    bridge = Bridge(component_id=191)
    world = bridge.world
    world.run(6)
    for tick in range(40 * 5):
        t_us = T0 + 6 * S + tick * S // 5
        world.attitude(t_us, system_id=11)
        bridge.place(t_us, north_m=3.0)
    assert not world.fleet.at(t_us).valid[0]
    assert not any("positions are those" in notice.text for notice in world.notices)


def test_an_autopilot_that_reports_again_is_used_at_once():
    bridge = Bridge(component_id=191)
    bridge.run()
    t_us = T0 + LAST_S * S
    bridge.world.rover(11, t_us, shift=1.0)
    state = bridge.world.fleet.at(t_us)
    assert state.p_enu[0] == pytest.approx(bridge.world.rover_truth(11, t_us) + np.array([1.0, 0.0, 0.0]), abs=0.01)
    assert bridge.world.notices[-1].text == "positions are those of its autopilot"


def test_a_receiver_is_used_where_nothing_else_reports_a_place():
    bridge = Bridge(raw=True)
    assert max(bridge.run()) < 0.5
    assert bridge.texts() == []
    state = bridge.world.fleet.at(T0 + LAST_S * S)
    assert math.isclose(state.std_m[0], 0.3, rel_tol=0.2) and state.vehicles[1].fix == "3D"


def test_a_receiver_without_a_full_fix_tells_no_place():
    bridge = Bridge(raw=True, fix_type=2)
    assert not any(state.valid[0] for _, state in bridge.states())


def test_another_sender_that_counts_otherwise_is_still_found_out():
    bridge = Bridge(boot_ms=epoch_ms)
    world = bridge.world
    for tick in range(10 * 20):
        t_us = T0 + tick * 50_000
        world.attitude(t_us, system_id=11)
        if tick % 4 == 0:
            world.rover(11, t_us)
        if tick % 4 == 2:
            bridge.place(t_us, north_m=4.0)
    assert world.fleet.at(t_us).vehicles[1].contested
