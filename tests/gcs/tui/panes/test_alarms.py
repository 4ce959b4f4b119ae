from __future__ import annotations

from dataclasses import replace

import pytest

from gcs.snapshot import Alarm, Event
from gcs.tui import RollcallApp
from gcs.tui.draw.event_rows import rows_of
from gcs.tui.palette import FAINT, level_colour
from gcs.tui.panes.alarms import AlarmPane
from gcs.tui.panes.banner import Banner
from gcs.tui.panes.event_log import EventPane
from gcs.tui.panes.fleet import columns_for
from gcs.tui.panes.identity import IdentityPane
from gcs.tui.panes.status import StatusBar
from gcs.tui.panes.video import VideoPane
from tests.support.fake_station import (
    SMALL,
    START_US,
    WIDE,
    FakeStation,
    on_screen,
    polled,
    running,
    screen_text,
    text_of,
)


def alarm(key="vehicle 11", level="alarm", text="UGV-11: no heartbeat", system_id=11, after_s=240.0):
    since_us = START_US + round(after_s * 1e6)
    return Alarm(
        key=key,
        level=level,
        kind="vehicle",
        text=text,
        advice="look at its radio",
        since_us=since_us,
        system_id=system_id,
    )


ALARMS = (
    alarm(),
    alarm("link x", text="udpin:x: nothing comes", system_id=0),
    alarm("lag", "warning", "the frame is late", 0),
)


def troubled(alarms=ALARMS, **health):
    station = FakeStation(live=True)
    shown = station.snapshot
    station.snapshot = replace(shown, alarms=alarms, health=replace(shown.health, keys=0, **health))
    station.said = []
    return station


@pytest.mark.parametrize("size", [SMALL, WIDE])
async def test_count_and_worst_alarm_are_on_every_screen(size):
    async with running(troubled(), size) as (app, _, _):
        said = screen_text(app)
        assert "2 alarms +1" in text_of(app.query_one(StatusBar))
        assert "UGV-11: no heartbeat (and 1 more)" in said and "a alarms" in said
        assert ("NOT AUTHENTICATED" in said) if size == WIDE else (" OPEN " in said)


async def test_the_list_says_level_age_what_and_what_to_do():
    async with running(troubled()) as (app, pilot, _):
        assert "alarms" not in on_screen(app)
        await pilot.press("a", "z")
        said = text_of(app.query_one(AlarmPane))
        for word in ("!! ALARM", "!  WARN", "11s", "UGV-11: no heartbeat", "look at its radio", "3 new"):
            assert word in said, word
        await pilot.press("z", "a")
        assert "alarms" not in on_screen(app)


async def test_alarms_fit_beside_everything_on_a_wide_screen():
    async with running(troubled(), WIDE) as (app, pilot, _):
        for layout in "123":
            await pilot.press(layout, "a")
            assert on_screen(app) == {"video", "map", "fleet", "identity", "events", "alarms"}


async def test_acknowledged_alarms_step_back_until_they_come_again_or_get_worse():
    async with running(troubled()) as (app, pilot, station):
        await pilot.press("A")
        await polled(app, pilot)
        assert app.query_one(Banner).alert.level == "calm"
        assert "seen: " in text_of(app.query_one(Banner)) and "(and 2 more)" in text_of(app.query_one(Banner))
        assert "2 alarms +1" in text_of(app.query_one(StatusBar))
        await pilot.press("a")
        assert "seen" in text_of(app.query_one(AlarmPane))
        station.snapshot = replace(station.snapshot, alarms=(alarm(after_s=250.0), *ALARMS[1:]))
        await polled(app, pilot)
        assert text_of(app.query_one(Banner)).endswith("a: what to do, A: seen ")
        await pilot.press("A")
        worse = replace(ALARMS[2], level="alarm")
        station.snapshot = replace(station.snapshot, alarms=(*station.snapshot.alarms[:2], worse))
        await polled(app, pilot)
        assert "!!" in text_of(app.query_one(Banner)) and "the frame is late" in text_of(app.query_one(Banner))


async def test_one_alarm_is_acknowledged_and_its_vehicle_picked():
    async with running(troubled()) as (app, pilot, station):
        await pilot.press("a", "enter")
        assert app.selected == 11
        assert station.seen == [ALARMS[0]]
        await polled(app, pilot)
        assert "udpin:x: nothing comes" in text_of(app.query_one(Banner))
        await pilot.press("down", "down", "down", "enter", "up")
        assert len(app.query_one(AlarmPane).seen) == 2
        await pilot.press("A", "A")
        assert station.seen == [ALARMS[0], ALARMS[2], ALARMS[1]], "each once"


LOST = tuple(
    alarm(f"vehicle {i}", text=f"UGV-{i}: no heartbeat", system_id=i, after_s=i * 10.0)
    for i in (16, 15, 14, 13, 12, 11)
)


async def test_what_befell_the_whole_fleet_is_one_row_and_acknowledged_at_once():
    elsewhere = alarm("clock 12", "warning", "UGV-12: its clock is wrong", 12)
    async with running(troubled((*LOST, ALARMS[1], elsewhere))) as (app, pilot, station):
        await pilot.press("a", "z")
        said = text_of(app.query_one(AlarmPane))
        assert "UGV-16, UGV-15, UGV-14, UGV-13 and 2 more: no heartbeat" in said
        assert said.count("no heartbeat") == 1 and "UGV-12: its clock is wrong" in said
        assert "7 alarms 1 warning" in said and "8 new" in said
        await pilot.press("enter")
        assert station.seen == list(LOST) and app.selected == 16
        assert "2 new" in text_of(app.query_one(AlarmPane))


async def test_several_troubles_of_one_vehicle_are_one_row_and_each_is_an_alarm():
    lost = replace(alarm("position 12", text="UGV-12: position lost", system_id=12), advice="check its receiver")
    drifts = alarm("clock 12", "warning", "UGV-12: its clock is wrong", 12)
    async with running(troubled((alarm(), lost, drifts))) as (app, pilot, station):
        await pilot.press("a", "z")
        said = text_of(app.query_one(AlarmPane))
        assert "UGV-12: position lost; its clock is wrong" in said and "check its receiver; look at its radio" in said
        assert "2 alarms 1 warning" in said and "3 new" in said
        await pilot.press("down", "enter")
        assert station.seen == [lost, drifts] and app.selected == 12


async def test_a_vehicle_that_joins_a_trouble_makes_its_row_new_again():
    async with running(troubled(LOST[:2])) as (app, pilot, station):
        await pilot.press("a", "z", "A")
        assert "all seen" in text_of(app.query_one(AlarmPane))
        station.snapshot = replace(station.snapshot, alarms=LOST[:3])
        await polled(app, pilot)
        said = text_of(app.query_one(AlarmPane))
        assert "!! ALARM" in said and "1 new" in said and "UGV-16, UGV-15, UGV-14: no heartbeat" in said


async def test_warnings_alone_are_told_without_being_loud():
    async with running(troubled(ALARMS[2:])) as (app, _, _):
        assert app.query_one(Banner).alert.level == "warning"
        assert "the frame is late" in text_of(app.query_one(Banner)) and "!!" not in text_of(app.query_one(Banner))


async def test_nothing_wrong_is_said_too():
    async with running(troubled(())) as (app, pilot, _):
        await pilot.press("a", "enter", "down", "A")
        assert "nothing is wrong that is known of" in text_of(app.query_one(AlarmPane))


@pytest.mark.parametrize(("bell", "rings"), [(False, 0), (True, 1)])
async def test_the_bell_is_off_unless_asked_for_and_rings_once(bell, rings, monkeypatch):
    heard = []
    app = RollcallApp(troubled(), graphics="blocks", bell=bell)
    monkeypatch.setattr(app, "bell", lambda: heard.append(1))
    async with app.run_test(size=SMALL) as pilot:
        for _ in range(3):
            app._poll()
            await pilot.pause()
    assert len(heard) == rings


def test_levels_have_words_and_colours_of_their_own():
    assert len({level_colour(level) for level in ("alarm", "warning", "info")} | {FAINT}) == 4


async def test_keys_rates_forecast_and_undecoded_frames_are_in_the_status_bar():
    station = troubled((), full_in_s=7200.0, undecoded=3)
    links = tuple(replace(link, packets_per_s=480.2) for link in station.snapshot.health.links)
    station.snapshot = replace(station.snapshot, health=replace(station.snapshot.health, links=links, keys=8))
    async with running(station, (240, 48)) as (app, _, _):
        said = text_of(app.query_one(StatusBar))
        for word in ("8 keys", "udpin:0.0.0.0:14550 480/s 4 bad", "video bad"):
            assert word in said, word
        assert "AUTHENTICATED" not in said


async def test_a_failing_disk_is_said():
    async with running(troubled((), write_failing_s=4.2), WIDE) as (app, _, _):
        assert "DISK FAILS 4.2s" in text_of(app.query_one(StatusBar))


@pytest.mark.slow
async def test_the_status_bar_never_loses_everything():
    for width in range(40, 200, 7):
        async with running(troubled(), (width, 24)) as (app, _, _):
            assert "REC" in text_of(app.query_one(StatusBar)), width


async def test_signatures_and_refusals_have_columns_once_there_are_any():
    station = troubled(())
    rows = list(station.snapshot.vehicles)
    assert not {"AUTH", "REFUSED"} & {column.title for column in columns_for(120, rows)}
    assert "AUTH" in {column.title for column in columns_for(120, rows, keyed=True)}
    unkeyed = [replace(row, unsigned=900) for row in rows]
    assert "AUTH" not in {column.title for column in columns_for(120, unkeyed)}
    rows[1] = replace(rows[1], signed=12_345)
    rows[2] = replace(rows[2], signed=5, unsigned=31)
    rows[0] = replace(rows[0], signed=5, held=40, held_s=2820.0)
    rows[3] = replace(rows[3], signed=5, bad_signature=14, refusals={"jump": 40, "0/0": 2}, contested=True)
    station.snapshot = replace(station.snapshot, vehicles=tuple(rows))
    async with running(station, WIDE) as (app, pilot, _):
        await pilot.press("f", "z")
        said = screen_text(app)
        for word in ("AUTH", "REFUSED", "signed", "held 47m", "open 31", "bad 14", "42 jump"):
            assert word in said, word
        rows[2], rows[3] = replace(rows[2], signs=True), replace(rows[3], signs=True)
        station.snapshot = replace(station.snapshot, vehicles=tuple(rows))
        app._poll()
        await pilot.pause()
        assert not {"open 31", "bad 14"} & {word for word in ("open 31", "bad 14") if word in screen_text(app)}
        await pilot.press("z", "down", "down", "down", "down")
        said = text_of(app.query_one(IdentityPane))
        for word in ("SEVERAL with this id", "5  unsigned 0  bad 14", "40 jump", "2 0/0"):
            assert word in said, word


async def test_events_that_repeat_share_a_row():
    station = troubled(())
    once = station.said.copy()
    event = FakeStation().said[0]
    station.said = [*once, *([event] * 512), replace(event, text="another")]
    assert [row.times for row in rows_of(station.said)] == [512, 1]
    async with running(station, WIDE) as (app, pilot, _):
        await pilot.press("e", "up", "down")
        said = text_of(app.query_one(EventPane))
        assert f"{event.text} × 512" in said and "another" in said


async def test_a_vehicles_words_are_in_the_alert_row_only_as_such():
    station = troubled(())
    text = "UGV-11: no heartbeat"
    newest_us = station.snapshot.t_us - 1_000_000
    station.said = [Event(t_us=newest_us, level="alarm", kind="text", text=text, system_id=12)]
    async with running(station) as (app, pilot, _):
        assert "no alarms" in text_of(app.query_one(Banner)), "what is an alarm is in the list of alarms"
        station.said.append(replace(station.said[0], kind="vehicle", text="its position jumped"))
        await polled(app, pilot)
        assert "UGV-12: its position jumped" in text_of(app.query_one(Banner))
        said = replace(alarm("text 12", text=f"UGV-12 says: {text}", system_id=12), kind="text")
        station.snapshot = replace(station.snapshot, alarms=(said,))
        await polled(app, pilot)
        assert f"UGV-12 says: {text} " in text_of(app.query_one(Banner))


@pytest.mark.parametrize(("share", "said"), [(1.0, False), (0.04, True)])
async def test_the_video_says_how_much_of_it_is_looked_at(share, said):
    async with running(troubled((), looked_share=share), WIDE) as (app, _, _):
        note = "".join(word for word, _ in app.query_one(VideoPane).note())
        assert (" 4% looked at" in note) == said


async def test_the_newest_alarm_stays_in_a_short_log_that_later_events_fill():
    said = [Event(t_us=START_US, level="alarm", kind="vehicle", text="no heartbeat", system_id=12)]
    said += [
        Event(t_us=START_US + n * 1_000_000, level="info", kind="text", text=f"Reached a waypoint, number {n}")
        for n in range(1, 40)
    ]
    station = FakeStation(live=True)
    station.said = said
    async with running(station, size=SMALL) as (app, pilot, _):
        await polled(app, pilot)
        pane = app.query_one(EventPane)
        shown = text_of(pane).split("\n")
        assert "no heartbeat" in shown[1] and "39" in "".join(shown[2:])
        await pilot.press("e")  # with the focus it is a log in order of time
        assert "no heartbeat" not in text_of(pane)
