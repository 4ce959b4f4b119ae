from __future__ import annotations

from dataclasses import replace

import pytest
from textual.binding import Binding

from gcs.snapshot import Alarm
from gcs.tui.keys import BINDINGS, COMMAND_HINTS, LIVE_HINTS, PANE_HINTS, REPLAY_HINTS, hints_for, signs_in
from gcs.tui.panes.event_log import EventPane
from gcs.tui.panes.fleet import FleetPane
from gcs.tui.panes.key_hints import KeyHints
from gcs.tui.panes.pane import Pane
from gcs.tui.panes.status import StatusBar
from gcs.tui.panes.timeline import TimelineBar
from tests.support.fake_station import START_US, WIDE, FakeStation, on_screen, polled, running, screen_text, text_of


def cell_of(widget, words, row=0):
    """Where some words begin in a row of a widget."""
    return text_of(widget).splitlines()[row].index(words), row


@pytest.mark.parametrize("hints", [LIVE_HINTS, COMMAND_HINTS, REPLAY_HINTS, *PANE_HINTS.values()])
async def test_every_key_that_is_hinted_at_does_something(hints):
    async with running() as (app, _, _):
        own = [binding for pane in app.query(Pane) for binding in pane.BINDINGS]
        keys = {key for binding in (*BINDINGS, *own) for key in binding.key.split(",")}
        assert {key for signs, _ in hints for key in signs_in(signs).values()} <= keys
        assert set(PANE_HINTS) == {pane.id for pane in app.query(Pane)}
        assert all(isinstance(binding, Binding) for binding in own)


def test_six_hints_begin_with_what_acts_where_the_focus_is_and_end_with_how_to_leave():
    row = hints_for(REPLAY_HINTS, "events")
    assert tuple(row[:4]) == PANE_HINTS["events"] and row[4:] == [("?", "help"), ("q", "quit")]
    signs = [sign for keys, _ in row for sign in signs_in(keys)]
    assert len(set(signs)) == len(signs), "no key twice"
    assert len(hints_for(REPLAY_HINTS, "")) == 6


async def test_keys_are_told_where_they_act():
    async with running(size=WIDE) as (app, pilot, _):
        log, hints = app.query_one(EventPane), app.query_one(KeyHints)
        assert "scroll" not in text_of(log) and "scroll" not in text_of(hints)
        await pilot.press("e")
        await pilot.pause()
        heading = text_of(log).splitlines()[0]
        assert "↑↓ scroll" in heading and "l level" in heading and "all" in heading
        assert text_of(hints).startswith(" ↑↓ scroll  l level")
        await pilot.press("f")
        await pilot.pause()
        assert "scroll" not in text_of(log) and "↑↓/ vehicle" in text_of(hints)


async def test_a_click_on_a_hinted_key_presses_it():
    async with running(size=WIDE) as (app, pilot, station):
        hints = app.query_one(KeyHints)
        await pilot.click(hints, offset=cell_of(hints, "play"))
        await pilot.pause()
        assert station.timeline.playing
        x, _ = cell_of(hints, "←→")
        for offset, at_s in ((x, -5), (x + 1, 0)):
            await pilot.click(hints, offset=(offset, 0))
            await pilot.pause()
            assert station.timeline.now_us == START_US + 251_400_000 + at_s * 1_000_000


async def test_a_click_on_an_event_shows_its_time_and_its_vehicle():
    async with running(size=WIDE) as (app, pilot, station):
        log = app.query_one(EventPane)
        row = next(y for y, line in enumerate(text_of(log).splitlines()) if "UGV-17 position lost" in line)
        await pilot.click(log, offset=(30, row))
        await pilot.pause()
        assert station.timeline.now_us == START_US + 130_000_000 and app.selected == 17 and not log.has_focus
        await pilot.click(log, offset=(30, 0))
        await pilot.pause()
        assert log.has_focus


async def test_the_time_line_plays_and_quickens_by_clicks():
    async with running(size=WIDE) as (app, pilot, station):
        bar = app.query_one(TimelineBar)
        await pilot.click(bar, offset=cell_of(bar, "pause"))
        await pilot.pause()
        assert station.timeline.playing
        await pilot.click(bar, offset=cell_of(bar, "×1"))
        await pilot.pause()
        assert station.timeline.speed > 1


async def test_a_click_on_the_status_brings_the_pane_that_has_more_about_it():
    station = FakeStation(live=True)
    alarm = Alarm(key="x", level="alarm", kind="link", text="x", advice="look", since_us=START_US)
    station.snapshot = replace(station.snapshot, alarms=(alarm,))
    async with running(station, WIDE) as (app, pilot, _):
        await polled(app, pilot)
        bar = app.query_one(StatusBar)
        for words, pane in (("1 alarm", "alarms"), ("confirmed", "identity"), ("links 1/2", "alarms")):
            await pilot.press("escape", "v")
            await pilot.click(bar, offset=cell_of(bar, words))
            await pilot.pause()
            assert pane in on_screen(app) and app.focused.id == pane, words


async def test_a_click_on_a_row_of_the_fleet_picks_its_vehicle():
    async with running() as (app, pilot, _):
        fleet = app.query_one(FleetPane)
        await pilot.click(fleet, offset=(3, 3))
        await pilot.pause()
        assert app.selected == 12 and "▸UGV-12" in screen_text(app)
