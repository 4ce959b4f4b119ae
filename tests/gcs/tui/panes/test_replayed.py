"""What is not analysed, provisional, or reported by the flight or its replay alone is marked as that on the screens."""

from __future__ import annotations

from dataclasses import replace

import pytest

from gcs.report.vehicle_names import text_with_sender
from gcs.snapshot import Alarm, Event
from gcs.tui.pane_area import PaneArea
from gcs.tui.panes.alarms import AlarmPane
from gcs.tui.panes.banner import Banner
from gcs.tui.panes.event_log import EventPane
from gcs.tui.panes.identity import IdentityPane
from gcs.tui.panes.pane import Pane
from gcs.tui.panes.status import StatusBar
from tests.support.fake_station import START_US, WIDE, FakeStation, make_snapshot, polled, running, screen_text, text_of

YET = "not analysed yet"


def blank():
    return replace(make_snapshot(), analysed=False, vehicles=(), boxes=(), alarms=(), frame=2000)


async def test_a_place_that_is_not_analysed_shows_nothing_old():
    async with running(FakeStation(), WIDE) as (app, pilot, station):
        await pilot.press("a")
        await polled(app, pilot)
        assert "97%" in screen_text(app)
        rows = app.query_one(PaneArea).state.fleet_rows
        station.snapshot = blank()
        await polled(app, pilot)
        assert screen_text(app).count(YET) == 1 and YET in text_of(app.query_one(StatusBar)), "once is enough"
        assert "not known yet" in text_of(app.query_one(Banner))
        assert "none" not in text_of(app.query_one(AlarmPane))
        text = "".join(text_of(pane) for pane in app.query(Pane) if pane.id != "events")
        assert "confirmed" not in text and "%" not in text and "no alarms" not in screen_text(app)
        assert app.query_one(PaneArea).state.fleet_rows == rows, "no pane moves"


def test_senders_have_their_names_where_a_place_is_not_analysed():
    said = Event(t_us=blank().t_us, level="info", kind="text", text="UAV says: Mission: 3 WP", system_id=1)
    assert text_with_sender(said, replace(blank(), names={1: "UAV"}).name_of) == "UAV says: Mission: 3 WP"


async def test_provisional_names_are_told_as_such():
    async with running(FakeStation(snapshot=replace(make_snapshot(), provisional=True, alarms=())), WIDE) as (
        app,
        pilot,
        _,
    ):
        await polled(app, pilot)
        app.selected = 11
        await pilot.pause()
        assert "2/7 confirmed, provisional" in text_of(app.query_one(StatusBar))
        assert "provisional" in text_of(app.query_one(IdentityPane))
        assert "no alarms" not in text_of(app.query_one(Banner))


def alarm(key, text, **change):
    base = make_snapshot()
    return Alarm(
        key=key, level="alarm", kind="vehicle", text=text, advice="look", since_us=base.t_us - 9_000_000, **change
    )


async def test_alarms_of_the_flight_or_its_replay_alone_are_marked_and_acknowledged_ones_are_quiet():
    told = (
        alarm("a", "disk full"),
        alarm("b 11", "UGV-11: position lost", system_id=11, reported="then"),
        alarm("c 12", "UGV-12: no heartbeat", system_id=12, reported="now"),
        alarm("d 13", "UGV-13: no heartbeat", system_id=13, acknowledged=True),
    )
    async with running(FakeStation(snapshot=replace(make_snapshot(), alarms=told)), WIDE) as (app, pilot, _):
        await pilot.press("a")
        await polled(app, pilot)
        text = text_of(app.query_one(AlarmPane))
        assert "then: UGV-11: position lost" in text and "now recomputed: UGV-12: no heartbeat" in text
        assert "3 new" in text and text.count("seen    ") == 1


@pytest.mark.parametrize(("size", "told"), [(WIDE, " 10:33:07 "), ((80, 24), ":33:07 ")])
async def test_a_narrow_log_tells_that_the_hour_is_left_out(size, told):
    station = FakeStation()
    station.said = [Event(t_us=START_US - 5_000_000, level="info", kind="link", text="a link came")]
    async with running(station, size) as (app, pilot, _):
        await polled(app, pilot)
        row = next(row for row in text_of(app.query_one(EventPane)).splitlines() if "a link came" in row)
        assert row.startswith(told)


@pytest.mark.parametrize(("reported", "before"), [("then", "then: "), ("now", "now recomputed: "), ("", "")])
async def test_events_are_marked_too_also_when_that_turns_out_later(reported, before):
    base = make_snapshot()
    said = [Event(t_us=base.t_us - k, level="info", kind="identity", text=f"track {k} is lost") for k in (3, 2, 1)]
    station = FakeStation()
    station.said = said
    async with running(station, WIDE) as (app, pilot, _):
        await polled(app, pilot)
        station.said = [said[0], replace(said[1], reported=reported), said[2]]
        await polled(app, pilot)
        rows = text_of(app.query_one(EventPane)).splitlines()
        assert any(f" {before}track 2 is lost" in row for row in rows)
        assert sum("then" in row or "recomputed" in row for row in rows) == bool(reported)


async def test_the_log_shows_the_event_that_was_jumped_to_between_two_frames():
    async with running(FakeStation(), WIDE) as (app, pilot, station):
        at_us = station.snapshot.now_us + 40_000
        station.said.append(Event(t_us=at_us, level="info", kind="text", text="the next frame is yet to come"))
        await polled(app, pilot)
        assert "is yet to come" not in text_of(app.query_one(EventPane))
        station.timeline.seek(at_us)
        await polled(app, pilot)
        assert "is yet to come" in text_of(app.query_one(EventPane))
