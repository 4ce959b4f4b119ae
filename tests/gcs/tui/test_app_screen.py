from __future__ import annotations

import math
from dataclasses import replace

from gcs.errors import FlightError
from gcs.snapshot import Event
from gcs.tui import app as app_module
from gcs.tui.draw.pane_layout import PANES
from gcs.tui.panes.banner import Banner
from gcs.tui.panes.event_log import EventPane
from gcs.tui.panes.map import MapPane
from gcs.tui.panes.timeline import TimelineBar
from gcs.tui.screens.prompts import Prompt
from tests.support.fake_station import (
    START_US,
    WIDE,
    FakeStation,
    comes_true,
    make_snapshot,
    on_screen,
    polled,
    running,
    screen_text,
    text_of,
)


async def test_small_screen_shows_video_fleet_identity_events_and_every_vehicle():
    async with running() as (app, _, _):
        assert on_screen(app) == {"video", "fleet", "identity", "events"}
        said = screen_text(app)
        for word in (
            "UAV-1",
            "UGV-11",
            "UGV-17",
            "confirmed 97%",
            "tentative 61%",
            "coasting 88%",
            "pos 1.4s",
            "lost 12s",
        ):
            assert word in said, word
        for word in ("unknown", "out of view", "no position", "UGV-13? 61%", "~UGV-14 88%", "10:37:23Z", "04:11"):
            assert word in said, word
        assert all(len(row) == 80 for row in said.split("\n"))


async def test_roomy_screen_adds_the_map():
    async with running(size=WIDE) as (app, _, _):
        assert on_screen(app) == set(PANES)
        assert "20 m" in text_of(app.query_one(MapPane)) and "N↑" in text_of(app.query_one(MapPane))


async def test_live_has_no_replay_keys_and_no_timeline():
    async with running(FakeStation(live=True)) as (app, pilot, _):
        assert not app.query(TimelineBar)
        await pilot.press("space", "left", "g", "n", "comma", "home", "right_square_bracket")
        assert not isinstance(app.screen, Prompt)
        said = screen_text(app)
        assert "● REC 04:11" in said and "links 1/2" in said


async def test_live_status_counts_time_and_warns_when_nothing_is_recorded():
    async with running(FakeStation(live=True), WIDE) as (app, pilot, station):
        old = station.snapshot
        health = replace(old.health, write_failing_s=12.0, free_bytes=900_000_000, video="stalled", links=())
        station.snapshot = replace(old, t_us=old.t_us + 65_000_000, health=health)
        await polled(app, pilot)
        said = screen_text(app)
        for word in ("DISK FAILS 12s", "no video", "no link"):
            assert word in said, word
        station.snapshot = replace(station.snapshot, health=replace(health, write_failing_s=0.0))
        await polled(app, pilot)
        assert "● REC disk LOW" in screen_text(app)


async def test_a_replay_log_ends_at_the_frame():
    async with running() as (app, pilot, station):
        station.snapshot = replace(station.snapshot, t_us=START_US + 100_000_000)
        await polled(app, pilot)
        said = text_of(app.query_one(EventPane))
        assert "UGV-11 confirmed" in said and "UGV-17 position lost" not in said and "alarm" not in said
        await pilot.press("end", "p")
        assert station.timeline.now_us == START_US + 240_000_000


async def test_the_title_may_change_and_texts_say_whose_they_are():
    async with running() as (app, pilot, station):
        station.title = "flight (analysed 40%)"
        station.said.append(Event(t_us=START_US + 1, level="info", kind="text", text="Reached waypoint", system_id=12))
        await polled(app, pilot)
        assert "flight (analysed 40%)" in screen_text(app)
        assert "UGV-12 says: Reached waypoint" in " ".join(text_of(app.query_one(EventPane)).split())


async def test_every_event_of_a_vehicle_says_whose_it_is_and_a_text_cannot_pretend():
    async with running() as (app, pilot, station):
        for kind, text in (
            ("vehicle", "position not used"),
            ("text", "UGV-13: well, UGV-12"),
            ("text", "UGV-12: no heartbeat"),
            ("text", "UGV-12 says: once"),
            ("text", "512 more, most often: UGV-12 says: a × 9"),
            ("link", "UGV-12: late"),
        ):
            station.said.append(Event(t_us=START_US + 1, level="info", kind=kind, text=text, system_id=12))
        await polled(app, pilot)
        await pilot.press("e", "z")
        log = text_of(app.query_one(EventPane))
        assert "UGV-12: position not used" in log and " UGV-12 says: UGV-13: well" in log
        assert "UGV-12 says: UGV-12: no heartbeat" in log and " UGV-12 says: once" in log
        assert " 512 more, most often: UGV-12 says: a × 9" in log
        assert "UGV-12: late" in log and "UGV-12: UGV-12" not in log


async def test_a_focused_log_shows_long_texts_whole():
    async with running() as (app, pilot, station):
        words = " ".join(f"word{i}" for i in range(30))
        station.said.append(Event(t_us=START_US + 1, level="info", kind="link", text=words))
        await polled(app, pilot)
        log = app.query_one(EventPane)
        assert "word29" not in text_of(log)
        await pilot.press("e", "z")
        assert all(f"word{i}" in text_of(log) for i in range(30))
        await pilot.press("pageup")
        assert "newer below" not in text_of(log), "all of it is on screen"
        await pilot.press("z", "pageup")
        assert "newer below" in text_of(log) and "word29" not in text_of(log)


async def test_a_flight_without_a_camera_begins_with_the_map():
    station = FakeStation(live=True)
    base = station.snapshot
    station.snapshot = replace(base, image=None, health=replace(base.health, video="none"))
    async with running(station) as (app, pilot, _):
        assert {"map", "fleet"} <= on_screen(app) and "video" not in on_screen(app)
        station.snapshot = replace(base, health=replace(base.health, video="ok"))
        await polled(app, pilot)
        assert "video" in on_screen(app)
        await pilot.press("2")
        station.snapshot = replace(base, health=replace(base.health, video="ok"))
        await polled(app, pilot)
        assert "video" not in on_screen(app), "the operator has chosen"


async def test_what_of_a_flight_does_not_work_any_more_is_told_without_ending_it():
    station = FakeStation(live=True)
    async with running(station, WIDE) as (app, pilot, _):
        station.error = FlightError("naming: ValueError: x; telemetry and video are recorded all the same")
        await polled(app, pilot)
        said = text_of(app.query_one(Banner))
        assert "naming: ValueError: x" in said and "stopped" not in said and "q quits" not in said


async def test_snapshot_is_drawn_once_and_again_only_when_it_is_another():
    async with running() as (app, pilot, station):
        video = app.query_one("#video")
        drawn = []
        body = video.body
        video.body = lambda *size: drawn.append(size) or body(*size)
        await pilot.pause(0.3)
        assert drawn == []
        station.snapshot = replace(station.snapshot, frame=1235)
        assert await comes_true(pilot, lambda: drawn)
        await pilot.pause(0.3)
        assert len(drawn) == 1 and "frame 1235" in text_of(video)


async def test_before_the_first_snapshot():
    station = FakeStation(live=True)
    station.snapshot, station.said = None, []
    async with running(station, WIDE) as (app, pilot, _):
        said = screen_text(app)
        for word in ("waiting for the first frame", "no vehicle received yet", "waiting for positions", "nothing yet"):
            assert word in said, word
        await pilot.press(
            "down", "up", "plus", "z", "escape", "question_mark", "escape", "S", "escape", "m", "escape", "s"
        )


async def test_no_frame_no_pose_no_vehicles():
    base = make_snapshot()
    bare = replace(
        base,
        image=None,
        width=0,
        height=0,
        boxes=(),
        vehicles=(),
        footprint_enu=None,
        uav_enu=base.uav_enu * math.nan,
        uav_heading=math.nan,
    )
    async with running(FakeStation(snapshot=bare), WIDE) as (app, pilot, _):
        assert "no video" in screen_text(app)
        await pilot.press("down", "1", "2", "3", "c", "plus", "minus")


async def test_a_stopped_station_is_told_and_is_the_exit_message(capsys):
    station = FakeStation(live=True)
    async with running(station) as (app, pilot, _):
        assert text_of(app.query_one(Banner)).strip() == "no alarms"
        station.error = OSError(28, "No space left on device [/x]")
        await polled(app, pilot)
        assert "station stopped: [Errno 28] No space left on device [/x]" in screen_text(app)
        await pilot.press("q")
    assert app.return_code == 1
    assert capsys.readouterr().err.strip() == "station stopped: [Errno 28] No space left on device [/x]"


async def test_quit_is_clean(capsys):
    async with running() as (app, pilot, _):
        await pilot.press("q")
    assert app.return_code == 0
    assert capsys.readouterr() == ("", "")


async def test_silence_is_told_when_live(monkeypatch):
    async with running(FakeStation(live=True)) as (app, pilot, _):
        later = app_module.time.monotonic() + 2 * app.silent_after_s
        monkeypatch.setattr(app_module, "time", type("Clock", (), {"monotonic": staticmethod(lambda: later)}))
        await polled(app, pilot)
        assert "nothing new for" in screen_text(app)


async def test_alarm_is_told_while_it_is_new():
    station = FakeStation()
    station.said.append(Event(t_us=station.snapshot.t_us - 1_000_000, level="alarm", kind="link", text="comm lost"))
    async with running(station) as (app, pilot, _):
        assert "comm lost" in text_of(app.query_one(Banner))
        station.snapshot = replace(station.snapshot, t_us=station.snapshot.t_us + 9_000_000)
        await polled(app, pilot)
        assert text_of(app.query_one(Banner)).strip() == "no alarms"
