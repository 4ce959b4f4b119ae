"""How vehicles are, on the screen: columns once anything is known, facts with their age, colours by the limits."""

import math
from dataclasses import replace

import numpy as np

from gcs.limits import Limits
from gcs.tui.draw.condition import battery, condition_facts, from_uav
from gcs.tui.palette import ALARM, FAINT, INK, WARN
from gcs.tui.panes.fleet import FleetPane, columns_for, condition_columns
from gcs.tui.panes.identity import IdentityPane
from mavlink.state import VehicleCondition
from tests.support.fake_station import WIDE, FakeStation, make_snapshot, running, text_of

BASE = make_snapshot(live=True)
WELL = VehicleCondition(
    voltage_v=12.4, charge=0.87, power_age_s=0.5, satellites=14, hdop=0.8, receiver_age_s=0.5, radio=62.0,
    radio_age_s=0.5, filter_ratio=0.3, filter_age_s=0.5,
)  # fmt: skip


def with_condition(condition, **row):
    rows = list(BASE.vehicles)
    rows[1] = replace(rows[1], condition=condition, **row)
    return replace(BASE, vehicles=tuple(rows))


def facts(condition, **row):
    now = with_condition(condition, **row)
    return {name: (text, colour) for name, text, colour in condition_facts(now.vehicles[1], now, 40)}


def test_a_column_is_there_once_anything_is_known():
    unknown = {column.title for column in condition_columns(BASE)}
    known = {column.title for column in condition_columns(with_condition(WELL))}
    assert unknown == {"FROM UAV"} and known == {"BATT", "SATS", "HDOP", "RADIO", "FROM UAV"}


def test_columns_that_matter_more_stay_on_a_narrow_screen():
    more = condition_columns(with_condition(WELL))
    assert "BATT" in {column.title for column in columns_for(80, more=more)}
    assert "RADIO" not in {column.title for column in columns_for(80, more=more)}
    assert {"NAME", "IDENTITY", "BATT", "LINK"} <= {column.title for column in columns_for(40, more=more)}


async def test_table_and_facts_have_them():
    station = FakeStation(live=True, snapshot=with_condition(WELL))
    async with running(station, (220, 60)) as (app, pilot, _):
        app.selected = 11
        await pilot.press("f", "z")
        table = text_of(app.query_one(FleetPane))
        assert all(word in table for word in ("BATT", "87%", "SATS", " 14 ", "0.8", "62", "17.0 m 315°"))
    async with running(station, WIDE) as (app, pilot, _):
        app.selected = 11
        await pilot.press("i", "z")
        said = text_of(app.query_one(IdentityPane))
        for words in ("87% 12.4 V", "14  HDOP 0.8", "62 above noise", "innovations 0.3 of 1.0", "17.0 m 315°"):
            assert words in said, words


def test_colours_are_by_the_missions_limits():
    row = with_condition(replace(WELL, charge=0.4)).vehicles[1]
    assert battery(row, Limits()) == ("40%", INK) and battery(row, Limits(battery_share=0.5)) == ("40%", ALARM)
    assert battery(row, Limits(battery_v=13.0))[1] == ALARM
    by_volts = with_condition(replace(WELL, charge=math.nan)).vehicles[1]
    assert battery(by_volts, Limits()) == ("12.4V", INK)
    assert facts(replace(WELL, satellites=4))["satellites"] == ("4  HDOP 0.8", WARN)
    assert facts(replace(WELL, filter_ratio=1.4))["filter"][1] == ALARM


def test_what_is_old_looks_old_and_goes():
    assert facts(replace(WELL, left_s=840.0))["battery"] == ("87% 12.4 V 14m left", INK)
    assert facts(replace(WELL, power_age_s=20.0))["battery"] == ("87% 12.4 V 20s", FAINT)
    assert facts(replace(WELL, power_age_s=90.0))["battery"] == ("–", FAINT)


def test_faults_fence_and_place():
    found = facts(replace(WELL, faults=("compass unhealthy",), arming=("Bad fix",)), fence="field", fence_m=-3.2)
    assert found["fault"] == ("compass unhealthy", WARN) and found["no arming"] == ("it says: Bad fix", WARN)
    assert found["fence"] == ("3.2 m BEYOND field", ALARM)
    row = replace(BASE.vehicles[1], p_enu=BASE.uav_enu + np.array([-30.0, 0.0, -40.0]))
    assert from_uav(row, BASE) == ("30.0 m 270°", INK)
    assert from_uav(replace(row, position_state="lost"), BASE)[0] == "–"
    assert from_uav(BASE.vehicles[0], BASE)[0] == "–"
