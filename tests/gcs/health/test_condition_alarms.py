"""Alarms by the mission's limits: when they come, when they go, and what they do not take for trouble."""

import math
from dataclasses import replace

import numpy as np
import pytest

from gcs.health.alarms import Alarms
from gcs.limits import Limits
from gcs.snapshot import Health, VehicleRow
from gcs.tui.panes.alarms import alike, text_of
from mavlink.state import VehicleCondition
from tests.support.fake_station import START_US, make_snapshot

WELL = VehicleCondition(
    charge=0.9, voltage_v=12.4, power_age_s=1.0, satellites=14, hdop=0.8, receiver_age_s=1.0, filter_ratio=0.1
)
ROWS = tuple(
    VehicleRow(
        system_id=i, name=f"UGV-{i}", role="ugv", heartbeat_age_s=0.3, position_age_s=0.2, position_state="ok",
        fix="3D", std_m=1.0, p_enu=np.array([10.0 * i, 0.0, 0.0]), condition=WELL, loss=0.0,
    )
    for i in (11, 12, 13)
)  # fmt: skip
BASE = replace(make_snapshot(), boxes=(), image=None, health=Health(video="ok"))


class Watch:
    def __init__(self, **limits):
        self.alarms, self.t_us, self.limits, self.events = Alarms(), START_US, Limits(**limits), []
        self.conflicts = frozenset()

    def see(self, seconds, *rows):
        """Keys and levels at the end, of the first vehicles as given and the others well."""
        for _ in range(round(seconds * 5)):
            self.t_us += 200_000
            now = replace(BASE, t_us=self.t_us, vehicles=(*rows, *ROWS[len(rows) :]), limits=self.limits)
            now = replace(now, conflicts=self.conflicts)
            active, events = self.alarms.update(now)
            self.events += events
            self.active = active
        return {alarm.key: alarm.level for alarm in active}


def row(index=0, **change):
    condition = {k: change.pop(k) for k in list(change) if k in VehicleCondition.__dataclass_fields__}
    return replace(ROWS[index], condition=replace(WELL, **condition), **change)


def test_all_is_well():
    assert Watch(separation_m=5).see(30) == {}


def test_a_battery_that_gets_empty_and_is_changed():
    watch = Watch()
    assert watch.see(10, row(charge=0.26)) == {}
    assert watch.see(4, row(charge=0.24)) == {}, "a moment only"
    assert watch.see(4, row(charge=0.24)) == {"battery 11": "warning"}
    assert watch.active[0].text == "UGV-11: battery low: 24%, 12.4 V"
    assert watch.see(10, row(charge=0.28)) == {"battery 11": "warning"}, "near its limit"
    assert watch.see(10, row(charge=0.12)) == {"battery 11": "alarm"}
    assert watch.see(20, row(charge=0.9)) == {}


@pytest.mark.parametrize(
    "change",
    [
        {"charge": 0.1, "power_age_s": 45.0},
        {"charge": 0.1, "contested": True, "clock_fault": ""},
        {"charge": math.nan, "voltage_v": math.nan},
        {"satellites": -1, "hdop": math.nan},
        {"satellites": 3, "receiver_age_s": 60.0},
    ],
)
def test_what_is_old_unknown_or_anybodys_raises_nothing(change):
    assert set(Watch(battery_v=11.0).see(20, row(**change))) <= {"contested 11"}


def test_limits_switch_alarms_off():
    poor = row(charge=0.01, satellites=0, hdop=9.0, fix="none", loss=0.9)
    on = Watch().see(20, poor)
    assert on == {"battery 11": "alarm", "reception 11": "alarm", "loss 11": "alarm"}
    assert Watch(battery_share=0, satellites=0, hdop=0, loss=1).see(20, poor) == {}


def test_reception_comes_and_goes_with_a_margin():
    watch = Watch()
    assert watch.see(8, row(satellites=5)) == {"reception 11": "warning"}
    assert watch.active[0].text == "UGV-11: its satellite reception is poor: 5 satellites, HDOP 0.8"
    assert watch.see(8, row(satellites=6)) == {"reception 11": "warning"}
    assert watch.see(8, row(satellites=7)) == {}
    assert watch.see(15, row(satellites=2, fix="none")) == {"reception 11": "alarm"}


def test_a_silent_vehicle_keeps_what_was_wrong_with_it():
    watch = Watch()
    watch.see(10, row(charge=0.2))
    silent = watch.see(20, row(charge=0.2, power_age_s=60.0, heartbeat_age_s=20.0, position_state="lost"))
    assert silent == {"battery 11": "warning", "silent 11": "alarm"}


def test_a_fence_by_distance_spread_and_age():
    watch = Watch()
    assert watch.see(5, row(fence="field", fence_m=1.5)) == {}
    assert watch.see(5, row(fence="field", fence_m=0.8)) == {"fence 11": "warning"}
    assert watch.see(5, row(fence="field", fence_m=-3.2)) == {"fence 11": "alarm"}
    assert watch.active[0].text == "UGV-11: it is beyond a fence: field"
    lost = row(fence="field", fence_m=40.0, std_m=900.0, position_state="lost", heartbeat_age_s=9.0)
    assert watch.see(10, lost)["fence 11"] == "alarm", "nobody knows where it is now"
    assert watch.see(10, row(fence="field", fence_m=0.5))["fence 11"] == "warning"
    assert "fence 11" not in watch.see(30, row(fence="field", fence_m=4.0))


def test_two_that_are_too_near_are_one_alarm_of_their_own_row():
    watch = Watch(separation_m=5)
    place = ROWS[1].p_enu + np.array([-4.0, 0.0, 30.0])
    assert watch.see(3, row(p_enu=place)) == {"near 11 12": "alarm"}
    assert watch.active[0].text == "UGV-11 and UGV-12: too near each other: 4.0 m"
    empty = watch.see(10, row(p_enu=place, charge=0.01))
    assert empty == {"near 11 12": "alarm", "battery 11": "alarm"}
    assert sorted(text_of(group) for group in alike(watch.active))[0].startswith("UGV-11 and UGV-12: too near")
    assert len(alike(watch.active)) == 2
    further = row(p_enu=ROWS[1].p_enu + np.array([-5.5, 0.0, 0.0]))
    assert watch.see(10, further) == {"near 11 12": "warning"}
    assert watch.see(30, row()) == {}
    assert Watch().see(3, row(p_enu=place)) == {}, "without a limit any distance is right"


def test_where_the_video_contradicts_a_vehicle_what_it_reports_may_be_so():
    watch = Watch(separation_m=5)
    watch.conflicts = frozenset({11})
    beyond = row(p_enu=ROWS[1].p_enu + np.array([-4.0, 0.0, 0.0]), fence="field", fence_m=-30.0)
    told = watch.see(5, beyond)
    assert (told["fence 11"], told["near 11 12"]) == ("warning", "warning")
    watch.conflicts = frozenset()
    told = watch.see(5, beyond)
    assert (told["fence 11"], told["near 11 12"]) == ("alarm", "alarm")


def test_positions_of_no_worth_are_near_nobody():
    watch = Watch(separation_m=5)
    assert "near 11 12" not in watch.see(3, row(p_enu=ROWS[1].p_enu, position_state="contested", contested=True))
    assert "near 11 12" not in watch.see(3, row(p_enu=np.full(3, np.nan), position_state="never"))
