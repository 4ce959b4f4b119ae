"""The map by keys and mouse: pan, home, ruler, trails, fences, picking."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from textual.events import MouseScrollUp as ScrollUp

from gcs.snapshot import Alarm, Standing
from gcs.trails import Trails
from gcs.tui.actions import actions
from gcs.tui.draw.ground_view import MapView
from gcs.tui.draw.map_canvas import BOX_MARK, STANDING_MARKS, UAV_MARK, MapExtras, chart_cells, map_labels, marked_at
from gcs.tui.draw.map_lines import CURSOR_MARK, HOME_MARK, PICK_MARKS, Ruler, ruler_texts
from gcs.tui.palette import ALARM, pack
from gcs.tui.panes.map import MapPane
from gcs.tui.screens.legend import LEGEND
from mavlink.geodesy import LocalFrame
from tests.support.fake_station import START_US, FakeStation, make_snapshot, polled, running, text_of

WIDE = (160, 48)
ORIGIN = LocalFrame(47.397742, 8.545594)
SNAPSHOT = replace(make_snapshot(), origin=ORIGIN)
VIEW = MapView(east=0.0, north=0.0, metres_per_dot=0.5, columns=80, rows=24)


def said(cells):
    return [strip.text for strip in cells.strips()]


@pytest.mark.parametrize(("column", "row"), [(0, 0), (40, 12), (79, 23)])
def test_a_cell_and_its_ground(column, row):
    assert VIEW.cell(VIEW.ground(column, row)) == (column, row)
    closer = VIEW.zoomed(2, column, row)
    assert closer.metres_per_dot < VIEW.metres_per_dot
    assert closer.ground(column, row) == pytest.approx(VIEW.ground(column, row))
    assert VIEW.moved(3, -2).ground(column, row) == pytest.approx(VIEW.ground(column + 3, row - 2))


def test_every_standing_has_a_mark_of_its_own():
    standings = Standing.__args__
    assert set(STANDING_MARKS) == set(standings)
    assert (
        len({*STANDING_MARKS.values(), UAV_MARK, BOX_MARK, CURSOR_MARK, HOME_MARK, *PICK_MARKS}) == len(standings) + 6
    )
    for standing in standings:
        row = replace(SNAPSHOT.vehicles[1], standing=standing)
        alone = replace(SNAPSHOT, vehicles=(row,), boxes=(), uav_enu=np.full(3, np.nan))
        assert any(STANDING_MARKS[standing] in line for line in said(chart_cells(alone, 0, VIEW)))


def test_a_vehicle_on_whose_name_nobody_is_to_act_is_marked_as_on_the_video():
    told = Alarm(key="", level="alarm", kind="", text="", advice="", since_us=0, system_id=12, doubts_name=True)
    doubted = replace(SNAPSHOT, alarms=(told,))
    texts = {place.text for place in map_labels(doubted, 0, VIEW).texts}
    assert "!UGV-12" in texts and "UGV-11" in texts
    cells = chart_cells(doubted, 0, VIEW)
    column, row = VIEW.cell(SNAPSHOT.vehicles[2].p_enu)
    assert chr(cells.letter[row, column]) == STANDING_MARKS["confirmed"] and cells.ink[row, column] == pack(ALARM)


def test_the_ruler_measures_as_the_map_does():
    ruler = Ruler(cursor=(3.0, 4.0), picks=((0.0, 0.0),))
    away, place, metres = ruler_texts(ruler, SNAPSHOT)
    assert away == "5.0 m 037°" and metres == "E +3.0 N +4.0 m"
    lat, lon = map(float, place.split())
    assert ORIGIN.to_enu(lat, lon, 0.0)[:2] == pytest.approx([3.0, 4.0], abs=0.1)
    both = replace(ruler, picks=((0.0, 0.0), (-10.0, 0.0)))
    assert ruler_texts(both, SNAPSHOT)[0] == "10.0 m 270°"
    assert ruler_texts(Ruler(), SNAPSHOT) == []


def test_a_trail_fades_and_ends_where_the_vehicle_is():
    trails = Trails()
    for n in range(20):
        row = replace(SNAPSHOT.vehicles[1], p_enu=np.array([-30.0 + 2 * n, 0.0, 0.0]))
        trails.add(replace(SNAPSHOT, t_us=START_US + n * 1_000_000, vehicles=(row,)))
    alone = replace(SNAPSHOT, vehicles=(row,), boxes=(), footprint_enu=None, uav_enu=np.full(3, np.nan))
    lines = trails.before(START_US + 19_000_000, 30.0, ORIGIN)
    bare, drawn = (chart_cells(alone, 0, VIEW, None, MapExtras(trails=each)) for each in ((), lines))
    new = (drawn.letter != bare.letter) & (drawn.letter > 0x2800)
    columns = np.flatnonzero(new.any(axis=0))
    assert columns.min() == VIEW.cell(np.array([-30.0, 0.0]))[0]
    row_of = VIEW.cell(np.array([0.0, 0.0]))[1]
    bright = [(drawn.ink[row_of, x] >> 8) & 255 for x in columns if new[row_of, x]]
    assert bright[0] < bright[len(bright) // 3]


def test_a_fence_is_drawn_where_it_is():
    fence = np.array([(-20.0, -8.0), (20.0, -8.0), (20.0, 8.0), (-20.0, 8.0)])
    bare, fenced = (chart_cells(replace(SNAPSHOT, fence_enu=each), 0, VIEW) for each in ((), (fence,)))
    new = np.argwhere((fenced.letter != bare.letter) & (fenced.letter > 0x2800))
    assert len(new) > 40
    rows = {VIEW.cell(np.array([0.0, north]))[1] for north in (-8.0, 8.0)}
    columns = {VIEW.cell(np.array([east, 0.0]))[0] for east in (-20.0, 20.0)}
    assert all(row in rows or column in columns for row, column in new)


def test_clicks_find_vehicles_and_boxes_without_a_name():
    twelve = next(row for row in SNAPSHOT.vehicles if row.system_id == 12)
    assert marked_at(SNAPSHOT, VIEW, *VIEW.cell(twelve.p_enu)) == (12, 0)
    unknown = next(box for box in SNAPSHOT.boxes if not box.system_id and box.track_id)
    elsewhere = replace(unknown, p_enu=np.array([-30.0, -9.0, 0.0]))
    assert marked_at(replace(SNAPSHOT, boxes=(elsewhere,)), VIEW, *VIEW.cell(elsewhere.p_enu)) == (0, unknown.track_id)
    assert marked_at(SNAPSHOT, VIEW, 1, 1) == (0, 0)


async def test_keys_of_the_map_count_with_the_focus_only():
    async with running(FakeStation(snapshot=SNAPSHOT), size=WIDE) as (app, pilot, station):
        chart = app.query_one(MapPane)
        now_us = station.timeline.now_us
        await pilot.press("right")
        assert station.timeline.now_us != now_us and chart.follow == "all"
        now_us, selected = station.timeline.now_us, app.selected
        await pilot.press("M", "right", "down")
        before = chart.view
        await pilot.press("left")
        assert chart.view == before.moved(-8, 0) and not chart.follow
        assert station.timeline.now_us == now_us and app.selected == selected
        await pilot.press("j")
        assert app.selected != selected
        await pilot.press("h")
        assert (chart.view.east, chart.view.north) == (0.0, 0.0) and HOME_MARK in text_of(chart)
        scale = chart.view.metres_per_dot
        await pilot.press("plus")
        assert chart.view.metres_per_dot < scale and (chart.view.east, chart.view.north) == pytest.approx((0.0, 0.0))
        await pilot.press("c")
        assert chart.follow == "all"
        await pilot.press("left", "0")
        assert chart.follow == "all" and chart.zoom == 0


async def test_ruler_keys():
    async with running(FakeStation(snapshot=SNAPSHOT), size=WIDE) as (app, pilot, _):
        chart = app.query_one(MapPane)
        await pilot.press("M", "enter", "r")
        assert CURSOR_MARK in text_of(chart) and "47.39" in text_of(chart)
        await pilot.press("enter", "right", "right", "down")
        step = 2 * chart.view.metres_per_dot
        away = math.hypot(2 * step, 2 * step)
        assert f"{away:.1f} m 135°" in text_of(chart)
        await pilot.press("enter", "up")
        assert PICK_MARKS[1] in text_of(chart) and len(chart.ruler.picks) == 2
        await pilot.press("enter")
        assert len(chart.ruler.picks) == 1
        await pilot.press("r")
        assert chart.ruler == Ruler() and "47.39" not in text_of(chart)


async def test_what_is_pointed_at_goes_when_the_origin_moves():
    station = FakeStation(snapshot=SNAPSHOT)
    async with running(station, size=WIDE) as (app, pilot, _):
        chart = app.query_one(MapPane)
        await pilot.press("M", "r", "enter", "r", "left")
        station.snapshot = replace(SNAPSHOT, origin=LocalFrame(48.0, 9.0))
        await polled(app, pilot)
        assert chart.ruler == Ruler() and chart.follow == "all"


async def test_what_is_pointed_at_stays_where_it_is_about_another_origin():
    """A place ahead of the analysis has an origin of its own, and no home."""
    station = FakeStation(snapshot=SNAPSHOT)
    async with running(station, size=WIDE) as (app, pilot, _):
        chart = app.query_one(MapPane)
        await pilot.press("M", "left", "r", "enter", "right")
        places = [ORIGIN.to_geodetic((*place, 0.0))[:2] for place in (*chart.ruler.picks, chart.ruler.cursor)]
        places.append(ORIGIN.to_geodetic((chart.view.east, chart.view.north, 0.0))[:2])
        origin = LocalFrame(ORIGIN.lat_deg + 0.01, ORIGIN.lon_deg - 0.01)
        station.snapshot = replace(SNAPSHOT, origin=origin, provisional=True)
        await polled(app, pilot)
        now = (*chart.ruler.picks, chart.ruler.cursor, (chart.view.east, chart.view.north))
        for (lat, lon), (east, north) in zip(places, now, strict=True):
            assert origin.to_enu(lat, lon, 0.0)[:2] == pytest.approx([east, north], abs=0.1)
        before = chart.view
        await pilot.press("h")
        assert chart.view == before and HOME_MARK not in text_of(chart)


async def test_trails_of_a_replay_come_from_what_was_worked_out_not_from_what_was_shown():
    station = FakeStation(snapshot=SNAPSHOT)
    for n in range(20):
        rows = tuple(replace(row, p_enu=row.p_enu - [0.5 * (20 - n), 0.0, 0.0]) for row in SNAPSHOT.vehicles)
        station.timeline.past.add(replace(SNAPSHOT, vehicles=rows, t_us=SNAPSHOT.t_us - (20 - n) * 1_000_000))
    async with running(station, size=WIDE) as (app, pilot, _):
        chart = app.query_one(MapPane)
        await pilot.press("M")
        assert "trail 30s" in text_of(chart)
        drawn = text_of(chart)
        await pilot.press("T", "T", "T")
        assert "trail off" in text_of(chart) and text_of(chart).count("⠒") < drawn.count("⠒")


async def test_trails_of_a_flight_are_what_was_shown():
    station = FakeStation(live=True, snapshot=SNAPSHOT)
    async with running(station, size=WIDE) as (app, pilot, _):
        chart = app.query_one(MapPane)
        for n in range(12):
            rows = tuple(replace(row, p_enu=row.p_enu + 0.5 * n) for row in SNAPSHOT.vehicles)
            station.snapshot = replace(SNAPSHOT, vehicles=rows, t_us=SNAPSHOT.t_us + n * 1_000_000)
            await polled(app, pilot)
        await pilot.press("M")
        with_trails = text_of(chart)
        await pilot.press("T", "T", "T")
        without = text_of(chart)
        dots = [sum(0x2800 < ord(letter) <= 0x28FF for letter in text) for text in (with_trails, without)]
        assert "trail off" in without and dots[0] > dots[1]


async def test_the_mouse_picks_zooms_and_pans():
    async with running(FakeStation(snapshot=SNAPSHOT), size=WIDE) as (app, pilot, _):
        chart = app.query_one(MapPane)
        twelve = next(row for row in SNAPSHOT.vehicles if row.system_id == 12)
        column, row = chart.view.cell(twelve.p_enu)
        await pilot.click(MapPane, offset=(column, row + 1))
        assert app.selected == 12
        before = chart.view
        await pilot._post_mouse_events([ScrollUp], MapPane, offset=(column, row + 1))
        assert chart.view.metres_per_dot < before.metres_per_dot
        assert chart.view.cell(twelve.p_enu) == pytest.approx((column, row), abs=1)
        held = chart.view
        await pilot.mouse_down(MapPane, offset=(30, 9))
        await pilot.hover(MapPane, offset=(36, 11))
        await pilot.mouse_up(MapPane, offset=(36, 11))
        assert chart.view == held.moved(-6, -2) and app.selected == 12


def test_help_lists_the_keys_of_the_map():
    listed = {action.words for action in actions([MapPane(id="map")], live=True)}
    assert {binding.tooltip for binding in MapPane.BINDINGS} <= listed
    signs = " ".join(sign for _, entries in LEGEND for sign, *_ in entries)
    for mark in (*STANDING_MARKS.values(), HOME_MARK, CURSOR_MARK, *PICK_MARKS):
        assert mark in signs


@pytest.mark.parametrize(("name", "shown"), [("Kestrel", "Kestrel"), ("UGV-11", "UAV"), ("K" * 40, "UAV")])
def test_the_uav_is_called_as_the_mission_calls_it(name, shown):
    rows = tuple(replace(row, name=name) if row.role == "uav" else row for row in SNAPSHOT.vehicles)
    texts = {place.text for place in map_labels(replace(SNAPSHOT, vehicles=rows), 0, VIEW).texts}
    assert shown in texts
