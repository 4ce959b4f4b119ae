"""How a vehicle is, from the messages that say so: the lowest battery, unknown values, hostile ones, whose radio."""

import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from mavlink.fleet.fleet import Fleet
from mavlink.protocol.encoder import MavlinkEncoder
from mavlink.protocol.packet import Packet
from tests.support.flights import FIELD, T0, S

UNKNOWN_MV = 65535


class Receiver:
    """A fleet, and what is sent to it, a second after the other."""

    def __init__(self):
        self.fleet, self.t_us = Fleet(1, [11, 12], origin=FIELD), T0
        self.speakers = {}

    def hear(self, name, *values, system_id=11, component=1, link=0, peer=1, **more):
        speaker = self.speakers.setdefault((system_id, component), MavlinkEncoder(system_id, component))
        raw = (
            speaker.heartbeat()
            if name == "heartbeat"
            else speaker.statustext(*values)
            if name == "text"
            else speaker.pack(getattr(dialect, f"MAVLink_{name}_message")(*values, **more))
        )
        self.fleet.add_packet(Packet(self.t_us, raw, link, peer))
        return self

    def battery(self, percent=-1, cells=(), *, number=0, function=1, state=0, component=1, **more):
        cells = [*cells, *[UNKNOWN_MV] * (10 - len(cells))]
        values = number, function, 3, 0, cells, -1, -1, -1, percent
        return self.hear("battery_status", *values, charge_state=state, component=component, **more)

    def sensors(self, *, used=0, health=0, millivolts=UNKNOWN_MV, percent=-1):
        return self.hear("sys_status", used, used, health, 0, millivolts, -1, percent, *[0] * 6)

    def now(self, system_id=11, after_s=1.0):
        self.t_us += round(after_s * S)
        return next(v.condition for v in self.fleet.at(self.t_us).vehicles if v.system_id == system_id)


@pytest.fixture
def air():
    return Receiver().hear("heartbeat")


def same(found, **expected):
    for name, value in expected.items():
        assert (
            getattr(found, name) == pytest.approx(value, nan_ok=True)
            if isinstance(value, float)
            else (getattr(found, name) == value)
        ), name


def test_before_anything_is_said_nothing_is_known(air):
    same(air.now(), voltage_v=math.nan, charge=math.nan, satellites=-1, hdop=math.nan, radio=math.nan)
    same(air.now(), power_age_s=math.inf, receiver_age_s=math.inf, radio_age_s=math.inf, faults=(), arming=())


def test_voltage_and_charge_with_their_age(air):
    air.sensors(millivolts=11_900, percent=42)
    same(air.now(after_s=4), voltage_v=11.9, charge=0.42, power_age_s=4.0)
    air.battery(40, [12_100])
    same(air.now(), voltage_v=12.1, charge=0.40, power_age_s=1.0, left_s=math.nan)


@pytest.mark.parametrize(("sent_s", "left_s"), [(840, 840.0), (0, math.nan), (-1, math.nan)])
def test_how_long_a_battery_lasts_is_what_its_autopilot_reckons(air, sent_s, left_s):
    air.battery(40, [12_100], time_remaining=sent_s)
    same(air.now(), charge=0.40, left_s=left_s)


def test_of_several_batteries_the_lowest_counts_while_it_reports(air):
    air.battery(80, [16_000], number=0).battery(30, [4_000, 4_100], number=1, state=2).battery(5, function=4, number=2)
    same(air.now(), charge=0.3, voltage_v=8.1, battery="low")
    air.battery(20, [9_000], component=180)
    same(air.now(after_s=40), charge=0.2)
    air.battery(80, [16_000])
    same(air.now(after_s=20), charge=0.8, battery="")
    air = Receiver().battery(-1, [12_000]).battery(-1, [11_000], number=1)
    same(air.now(), charge=math.nan, voltage_v=11.0)


def test_what_is_sent_as_unknown_is_unknown(air):
    air.battery(-1).sensors(millivolts=UNKNOWN_MV, percent=-1)
    same(air.now(), charge=math.nan, voltage_v=math.nan)
    air.sensors(millivolts=0, percent=-1)
    same(air.now(), voltage_v=math.nan)
    air.hear("gps_raw_int", 0, 3, 0, 0, 0, 65535, 65535, 65535, 65535, 255)
    same(air.now(), satellites=-1, hdop=math.nan)
    air.hear("radio_status", 255, 255, 100, 40, 40, 0, 0)
    same(air.now(), radio=math.nan)


@pytest.mark.parametrize("percent", [101, 127, -2, -128])
def test_a_charge_that_cannot_be_is_left_out_and_counted(air, percent):
    air.battery(percent, [12_000]).sensors(percent=percent)
    same(air.now(), charge=math.nan, voltage_v=12.0)
    status = air.fleet.at(air.t_us).vehicles[1]
    assert dict(status.refusals)["battery charge that cannot be"] == 2


def test_satellites_of_the_better_receiver(air):
    air.hear("gps_raw_int", 0, 3, 0, 0, 0, 250, 65535, 65535, 65535, 5)
    same(air.now(), satellites=5, hdop=2.5)
    air.hear("gps2_raw", 0, 5, 0, 0, 0, 80, 65535, 65535, 65535, 14, 0, 0)
    same(air.now(), satellites=14, hdop=0.8, receiver_age_s=1.0)
    air.hear("gps_raw_int", 0, 3, 0, 0, 0, 90, 65535, 65535, 65535, 200)
    same(air.now(), satellites=14)
    assert dict(air.fleet.at(air.t_us).vehicles[1].refusals)["satellites that cannot be"] == 1


def test_the_filter_and_values_that_are_no_numbers(air):
    air.hear("ekf_status_report", 0x33F, 0.2, 0.7, 0.1, math.nan, 0.0)
    same(air.now(), filter_ratio=pytest.approx(0.7))
    air.hear("ekf_status_report", 0x33F, math.nan, math.inf, -5.0, 0.1, 0.0)
    assert 0.0 <= air.now().filter_ratio <= 1e3


def test_unhealthy_parts_in_words_and_no_remote_control(air):
    compass, remote, battery = 1 << 2, 1 << 16, 1 << 25
    air.sensors(used=compass | remote | battery, health=battery)
    same(air.now(), faults=("compass unhealthy",))
    air.sensors(used=compass | remote, health=compass)
    same(air.now(), faults=())


def test_reasons_against_arming_hold_until_they_pass_or_are_not_repeated(air):
    check = 1 << 28
    air.hear("text", "PreArm: GPS 1: Bad fix", 2).sensors(used=check)
    same(air.now(), arming=("GPS 1: Bad fix",))
    air.sensors(used=check, health=check)
    same(air.now(), arming=())
    air.sensors(used=check)
    same(air.now(after_s=28), arming=("GPS 1: Bad fix",))
    same(air.now(after_s=62), arming=())
    air.sensors(used=check)
    same(air.now(), arming=("no reason given",))
    for k in range(100):
        air.hear("text", f"Arm: reason {k}", 2)
    assert len(air.now().arming) == 8


def test_a_radio_is_that_of_the_vehicle_or_of_the_link(air):
    modem = {"system_id": 51, "component": 68}
    air.hear("heartbeat", link=1, peer=3).hear("heartbeat", system_id=12, link=0, peer=2)
    air.hear("radio_status", 200, 150, 100, 40, 50, 0, 0, **modem, link=1, peer=3)
    same(air.now(), radio=100.0, radio_age_s=1.0)
    same(air.now(12), radio=math.nan)
    air.hear("heartbeat", system_id=12, link=1, peer=3)
    air.hear("radio", 200, 150, 100, 40, 50, 0, 0, **modem, link=1, peer=3)
    same(air.now(12), radio=160.0)
    air.hear("radio_status", 90, 80, 100, 40, 50, 0, 0, component=68, link=0, peer=9)
    same(air.now(), radio=30.0)


def test_floods_of_ids_stay_bounded(air):
    for number in range(256):
        for component in (1, 180):
            air.battery(50, number=number, component=component)
    assert len(air.fleet._vehicles[11].conditions._batteries) <= 16
