from __future__ import annotations

import math
from dataclasses import replace

import pytest

from gcs.tui.draw.freshness import GONE_S, UNKNOWN, USABLE_M, aged, freshness, spread
from gcs.tui.draw.ground_view import MapView
from gcs.tui.draw.map_canvas import chart_cells
from gcs.tui.palette import FAINT, INK, pack
from gcs.tui.panes.fleet import COLUMNS, FleetPane
from gcs.tui.panes.identity import IdentityPane
from mavlink.state import SILENT_S, VehicleCondition
from tests.support.fake_station import WIDE, FakeStation, make_snapshot, polled, running, text_of

OF_ITS_WORD = {
    "MODE": "AUTO",
    "ARM": "armed",
    "FIX": "RTK",
    "±": "1.2 m",
    "LOSS": "3%",
    "VIEW": "in",
}
"""Columns with what a vehicle last sent, and what it was."""


def vehicle(age_s):
    row = FakeStation().snapshot.vehicles[1]
    state = "ok" if age_s <= 1 else "stale" if age_s <= 3 else "lost"
    return replace(
        row,
        heartbeat_age_s=age_s,
        position_age_s=age_s,
        position_state=state,
        standing="no position" if state == "lost" else row.standing,
        confidence=math.nan if state == "lost" else row.confidence,
    )


@pytest.mark.parametrize("age_s", [0.0, 1.0, SILENT_S, SILENT_S + 0.1, 12.0, GONE_S, GONE_S + 1, 420.0, math.inf])
@pytest.mark.parametrize("column", [column for column in COLUMNS if column.title in OF_ITS_WORD], ids=lambda c: c.title)
def test_no_value_of_a_vehicle_looks_newer_than_it_is(column, age_s):
    text, colour = column.aged_cell(vehicle(age_s))
    value = OF_ITS_WORD[column.title]
    if age_s <= SILENT_S:
        assert text == value and colour is not FAINT, "what is fresh is never in the colour of what is old"
    elif age_s <= GONE_S:
        assert text.startswith(value) and colour is FAINT
    else:
        assert (text, colour) == (UNKNOWN, FAINT)


def test_every_column_ages_or_is_no_report_of_the_vehicle():
    ageless = {column.title for column in COLUMNS if column.age_s is None}
    assert ageless == {"ID", "NAME", "TYPE", "HEART", "POS", "TRK", "IDENTITY", "LINK"}


def test_an_old_value_has_its_age_where_there_is_room():
    assert aged("AUTO", INK, 12.0, 8) == ("AUTO 12s", FAINT)
    assert aged("GUIDED", INK, 12.0, 8) == ("GUIDED", FAINT)
    assert aged(UNKNOWN, INK, 12.0, 8) == (UNKNOWN, FAINT)


def test_unknown_ages_are_gone_and_bounds_can_be_given():
    assert freshness(math.nan) == freshness(math.inf) == freshness(GONE_S + 0.1) == "gone"
    assert freshness(10.0, fresh_s=15.0) == "fresh" and freshness(10.0) == "old"


def test_a_spread_that_tells_no_place_is_not_shown():
    assert spread(4.0, 2.0) == "4.0 m" and spread(USABLE_M + 1, 2.0) == spread(math.nan, 2.0) == UNKNOWN
    assert spread(4.0, GONE_S + 1) == UNKNOWN


def test_the_fix_has_the_age_of_the_receiver_where_it_is_known():
    fix = next(column for column in COLUMNS if column.title == "FIX")
    old = replace(vehicle(0.2), condition=VehicleCondition(receiver_age_s=20.0))
    assert fix.aged_cell(old) == ("RTK 20s", FAINT)
    assert fix.aged_cell(replace(old, condition=VehicleCondition(receiver_age_s=0.3))) == ("RTK", INK)


async def test_a_vehicle_lost_for_minutes_shows_nothing_of_it_but_for_how_long():
    async with running(size=WIDE) as (app, pilot, station):
        gone = replace(vehicle(420.0), std_m=114_000.0)
        vehicles = station.snapshot.vehicles
        station.snapshot = replace(station.snapshot, vehicles=(vehicles[0], gone, *vehicles[2:]))
        app.selected = gone.system_id
        await polled(app, pilot)
        row = next(line for line in text_of(app.query_one(FleetPane)).splitlines() if "UGV-11" in line)
        facts = text_of(app.query_one(IdentityPane))
        assert "lost 7m" in row and "lost 7m" in facts
        for word in ("AUTO", "armed", "RTK", "km", "114"):
            assert word not in row and word not in facts, word


@pytest.mark.parametrize(("age_s", "word"), [(0.2, ""), (12.0, " lost 12s"), (420.0, " lost 7m")])
def test_a_mark_on_the_map_is_dimmed_and_dated_with_its_place(age_s, word):
    shown = make_snapshot()
    row = replace(vehicle(age_s), std_m=4.0)
    shown = replace(shown, vehicles=(shown.vehicles[0], row), boxes=(), footprint_enu=None)
    view = MapView(east=-14.0, north=8.0, metres_per_dot=0.2, columns=60, rows=20)
    cells = chart_cells(shown, 0, view)
    text = "\n".join("".join(map(chr, line)) for line in cells.letter.tolist())
    assert f"UGV-11{word}" in text and (word or "lost" not in text)
    mark = cells.ink[10, 30]
    assert (mark == pack(FAINT)) == bool(word)
    dots = sum(0x2800 < letter < 0x2900 for letter in cells.letter.ravel())
    assert (dots == 0) == bool(word), "neither heading nor 1σ of a place that is old"
