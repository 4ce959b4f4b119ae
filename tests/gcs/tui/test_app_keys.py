from __future__ import annotations

import re

import pytest

from gcs.snapshot import Event
from gcs.tui.keys import BINDINGS
from gcs.tui.panes.event_log import EventPane
from gcs.tui.panes.map import MapPane
from gcs.tui.panes.timeline import TimelineBar
from gcs.tui.screens.prompts import Prompt
from tests.support.fake_station import (
    SMALL,
    START_US,
    STOP_US,
    WIDE,
    FakeStation,
    on_screen,
    polled,
    running,
    screen_text,
    text_of,
)


async def test_seeking_keys():
    async with running() as (_, pilot, station):
        now_us = station.timeline.now_us
        for keys, want_s in (
            (["right"], 256.4),
            (["left"], 246.4),
            (["shift+right"], 281.4),
            (["shift+left"], 221.4),
            (["home"], 0.0),
            (["home", "left"], 0.0),
            (["end"], 754.0),
            (["end", "right"], 754.0),
            (["p"], 240.0),  # event before
            (["p", "p"], 180.4),
            (["home", "n"], 2.0),  # next event
        ):
            station.timeline.now_us = now_us
            await pilot.press(*keys)
            assert (station.timeline.now_us - START_US) / 1e6 == pytest.approx(want_s, abs=1e-3), keys


async def test_all_cameras_are_beside_each_other():
    station = FakeStation(live=True)
    async with running(station, WIDE) as (app, pilot, _):
        video = app.query_one("#video")
        await pilot.press("4")
        assert video.tiles == () and "there is one camera" in {each.message for each in app._notifications}
        station.other_view = other = FakeStation(live=True)
        other.title = "North"
        await pilot.press("4")
        assert {"▸live", " North"} <= {row.strip("\n").rstrip() for row in text_of(video).split("\n")}
        other.snapshot = None
        await polled(app, pilot)
        assert "waiting for the first frame" in text_of(video)
        await pilot.press("4")
        assert "North" not in text_of(video)


async def test_the_next_camera_comes_into_focus():
    station, other = FakeStation(), FakeStation()
    station.other_view, other.other_view, other.title = other, station, "from UAV-2"
    async with running(station) as (app, pilot, _):
        for title in ("from UAV-2", station.title):
            await pilot.press("C")
            await polled(app, pilot)
            assert title in screen_text(app)
        other.other_view = None
        await pilot.press("C", "C", "space")
        assert other.timeline.playing and not station.timeline.playing


async def test_play_step_and_speed_keys():
    async with running() as (app, pilot, station):
        await pilot.press("space")
        assert station.timeline.playing
        await polled(app, pilot)
        assert "play" in text_of(app.query_one(TimelineBar))
        await pilot.press("comma", "full_stop", "full_stop")
        assert station.timeline.steps == [-1, 1, 1] and not station.timeline.playing
        await pilot.press("right_square_bracket")
        assert station.timeline.speed == 2
        await pilot.press(*["right_square_bracket"] * 9)
        assert station.timeline.speed == 20
        await pilot.press(*["left_square_bracket"] * 12)
        assert station.timeline.speed == 0.1


async def test_the_time_line_shows_which_part_is_analysed():
    async with running() as (app, pilot, station):
        station.timeline.analysed = [(START_US, START_US + (STOP_US - START_US) // 4)]
        station.timeline.now_us = START_US
        await polled(app, pilot)
        track = text_of(app.query_one(TimelineBar))
        part = track[track.index("●") : track.rindex("┄") + 1]
        assert 0.6 < part.count("┄") / len(part) < 0.9 and "┄" not in part[: len(part) // 5]
        station.timeline.analysed = [(START_US, STOP_US)]
        await polled(app, pilot)
        assert "┄" not in text_of(app.query_one(TimelineBar))


async def test_play_at_the_end_starts_again():
    async with running() as (_, pilot, station):
        await pilot.press("end", "space")
        assert station.timeline.now_us == START_US and station.timeline.playing


async def test_next_event_follows_the_level_filter_and_says_when_there_is_none():
    async with running() as (app, pilot, station):
        await pilot.press("l", "l", "home", "n")
        assert app.query_one(EventPane).least == "alarm"
        assert station.timeline.now_us == START_US + 130_000_000
        await pilot.press("n")
        assert station.timeline.now_us == START_US + 130_000_000
        assert len(app._notifications) == 1


async def test_go_to_time():
    async with running() as (app, pilot, station):
        await pilot.press("g", *"1:30", "enter")
        assert station.timeline.now_us == START_US + 90_000_000
        await pilot.press("g", *"soon", "enter")
        assert isinstance(app.screen, Prompt)
        assert "not a time" in screen_text(app)
        await pilot.press("escape")
        assert not isinstance(app.screen, Prompt)
        assert station.timeline.now_us == START_US + 90_000_000
        await pilot.press("g", *"9:00:00", "enter")
        assert station.timeline.now_us == STOP_US


async def test_pane_keys_focus_then_hide_then_show():
    async with running() as (app, pilot, _):
        for key, pane in (("v", "video"), ("f", "fleet"), ("i", "identity"), ("e", "events")):
            await pilot.press(key)
            assert app.focused is not None and app.focused.id == pane
            await pilot.press(key)
            assert pane not in on_screen(app) and app.focused is None
            await pilot.press(key)
            assert pane in on_screen(app) and app.focused.id == pane


async def test_map_key_finds_room_on_a_small_screen():
    async with running() as (app, pilot, _):
        await pilot.press("M")
        assert "map" in on_screen(app) and app.focused.id == "map"
        assert app.query_one(MapPane).size.height >= 8


async def test_all_panes_can_be_hidden():
    async with running(size=WIDE) as (app, pilot, _):
        for key in "vMfie":
            await pilot.press(key, key)
        assert on_screen(app) == set()
        await pilot.press("2")
        assert "map" in on_screen(app)


@pytest.mark.slow_but_first
@pytest.mark.parametrize("size", [SMALL, (200, 60), (40, 12), (12, 4)])
async def test_layouts_and_maximising_at_every_size(size):
    async with running(size=size) as (app, pilot, _):
        for key in "123":
            await pilot.press(key)
            shown = on_screen(app)
            assert shown
            await pilot.press("z")
            assert len(on_screen(app)) == 1
            await pilot.press("escape")
            assert on_screen(app) == shown


async def test_layouts_change_what_is_large():
    async with running(size=WIDE) as (app, pilot, _):
        areas = {}
        for key in "123":
            await pilot.press(key)
            await pilot.pause()
            areas[key] = {pane: app.query_one(f"#{pane}").size.area for pane in ("video", "map")}
        assert areas["1"]["video"] > 2 * areas["1"]["map"]
        assert areas["2"]["map"] > 2 * areas["2"]["video"]
        assert areas["3"]["map"] == pytest.approx(areas["3"]["video"], rel=0.05)


async def test_maximised_pane_takes_the_deck_and_another_key_swaps_it():
    async with running() as (app, pilot, _):
        await pilot.press("f", "z")
        assert on_screen(app) == {"fleet"}
        await pilot.pause()
        assert app.query_one("#fleet").size.width == 80
        assert "HEART" in text_of(app.query_one("#fleet"))
        await pilot.press("M")
        assert on_screen(app) == {"map"}
        await pilot.press("M")
        assert "video" in on_screen(app)


async def test_picking_a_vehicle_stresses_it_everywhere():
    async with running(size=WIDE) as (app, pilot, _):
        await pilot.press("down", "down")
        assert app.selected == 11
        assert re.search("▸ *UGV-11", text_of(app.query_one("#fleet")))
        assert "confirmed 97%" in text_of(app.query_one("#identity"))
        await pilot.press("up", "up", "up")
        assert app.selected == 17
        assert "no usable position" in " ".join(text_of(app.query_one("#identity")).split())
        await pilot.press("escape")
        assert app.selected == 0


async def test_map_keys():
    async with running(size=WIDE) as (app, pilot, _):
        chart = app.query_one(MapPane)
        before = text_of(chart)
        await pilot.press("plus", "plus")
        assert chart.zoom == 2 and text_of(chart) != before
        await pilot.press("minus", "minus", "minus")
        assert chart.zoom == -1
        await pilot.press("0")
        assert chart.zoom == 0 and text_of(chart) == before
        await pilot.press("c")
        assert chart.follow == "UAV"
        await pilot.press("down", "down", "c")
        assert chart.follow == "selected" and "follows selected" in text_of(chart)
        await pilot.press("c")
        assert chart.follow == "all"


async def test_event_log_filters_and_scrolls():
    async with running() as (app, pilot, station):
        station.said += [
            Event(t_us=START_US + 250_000_000 + i, level="info", kind="text", text=f"line {i}") for i in range(50)
        ]
        await polled(app, pilot)
        log = app.query_one(EventPane)
        assert "line 49" in text_of(log)
        await pilot.press("e", "up", "up", "pageup")
        assert "line 49" not in text_of(log) and "newer below" in text_of(log)
        await pilot.press("pagedown", "pagedown")
        assert "line 49" in text_of(log)
        await pilot.press("l")
        assert "line 49" not in text_of(log) and "UGV-17 position lost" in text_of(log)
        await pilot.press("l")
        assert "tentative" not in text_of(log) and "UGV-17 position lost" in text_of(log)


def test_every_key_has_an_id_and_a_tooltip():
    ids = [binding.id for binding in BINDINGS]
    assert len(set(ids)) == len(ids) and all(ids)
    assert all(binding.tooltip for binding in BINDINGS)


async def test_screenshot_is_saved_once_and_never_over_a_file(tmp_path):
    goal = tmp_path / "shot.svg"
    async with running() as (app, pilot, _):
        for _ in range(2):
            await pilot.press("S")
            app.screen.query_one("#answer").value = str(goal)
            await pilot.press("enter")
        assert isinstance(app.screen, Prompt) and "exists" in screen_text(app)
        app.screen.query_one("#answer").value = str(tmp_path / "none" / "x.svg")
        await pilot.press("enter")
        assert isinstance(app.screen, Prompt)
        await pilot.press("escape")
    drawing = goal.read_text()
    assert drawing.startswith("<svg") and "UGV-11" in drawing and "Save the screen" not in drawing
    assert [path.name for path in tmp_path.iterdir()] == ["shot.svg"]


async def test_clicks_pick_vehicles_and_seek():
    async with running() as (app, pilot, station):
        await pilot.click("#fleet", offset=(3, 3))
        assert app.selected == 12
        await pilot.click("#video", offset=(9, 4))
        assert app.selected == 11
        await pilot.click("#video", offset=(2, 20 - 7))
        assert app.selected == 0
        await pilot.click("#timeline", offset=(64, 0))
        assert station.timeline.now_us > START_US + 600_000_000
