"""Each vehicle's row has the mark and colour of its worst alarm; a name not to be acted on is never green."""

from __future__ import annotations

from dataclasses import replace

import pytest

from gcs.fold.candidates import _of_its_rivals
from gcs.health.alarms import urgency
from gcs.snapshot import Alarm, Event
from gcs.tui.palette import ALARM, GOOD, WARN, ink
from gcs.tui.panes.banner import Banner, alert_of
from gcs.tui.panes.fleet import FleetPane
from tests.support.fake_station import SMALL, START_US, WIDE, FakeStation, make_snapshot, polled, running, text_of


def alarm(key, system_id=0, level="alarm", after_s=1, **more):
    since_us = START_US + after_s * 1_000_000
    return Alarm(
        key=key, level=level, kind="vehicle", text=key, advice="", since_us=since_us, system_id=system_id, **more
    )


CONFLICT = alarm("conflict 11", 11, doubts_name=True)
SILENT = alarm("silent 12", 12, after_s=9)
LOW = alarm("battery 13", 13, "warning")
BOTH = alarm("near 14 15", level="warning", vehicles=(14, 15))


async def fleet_with(alarms, size=WIDE):
    """Text and colours of each row, by name."""
    snapshot = replace(make_snapshot(live=True), alarms=alarms)
    async with running(FakeStation(live=True, snapshot=snapshot), size=size) as (app, pilot, _):
        await polled(app, pilot)
        pane = app.query_one(FleetPane)
        strips = pane.body(pane.size.width, pane.size.height)
        return {strip.text.split("UGV-")[1][:2]: strip for strip in strips if "UGV-" in strip.text}


def colours(strip):
    return {segment.style.color for segment in strip if segment.style and segment.text.strip()}


@pytest.mark.parametrize("size", [WIDE, SMALL])
async def test_a_row_has_the_mark_and_colour_of_its_worst_alarm(size):
    rows = await fleet_with((CONFLICT, SILENT, LOW, BOTH), size)
    marks = {name: strip.text.split("UGV-")[0].strip() for name, strip in rows.items()}
    assert marks == {"11": "!!", "12": "!!", "13": "!", "14": "!", "15": "!", "16": "", "17": ""}
    for name, colour in (("11", ALARM), ("12", ALARM), ("13", WARN), ("14", WARN)):
        assert ink(colour).color in colours(rows[name]), name


async def test_a_name_not_to_be_acted_on_is_not_green():
    rows = await fleet_with((CONFLICT, SILENT))
    assert ink(GOOD).color not in colours(rows["11"])
    assert ink(GOOD).color in colours(rows["12"]), "its name is right all the same"


def test_the_banner_shows_the_worst_and_not_the_newest():
    for alarms in ((CONFLICT, SILENT), (SILENT, CONFLICT)):
        snapshot = replace(make_snapshot(live=True), alarms=tuple(sorted(alarms, key=urgency)))
        assert "conflict 11" in alert_of(snapshot, (), frozenset()).text


def test_a_later_warning_is_on_the_banner_while_it_is_news_and_a_later_alarm_is_counted():
    base = make_snapshot(live=True)
    doubt, other = (replace(each, level="warning") for each in (CONFLICT, SILENT))
    for alarms, ago_s, shown in (
        ((doubt, other), 2, "silent 12"),
        ((doubt, other), 20, "conflict 11"),
        ((CONFLICT, SILENT), 2, "conflict 11"),
    ):
        came = replace(alarms[1], since_us=base.now_us - ago_s * 1_000_000)
        alert = alert_of(replace(base, alarms=(alarms[0], came)), (), frozenset())
        assert (alert.text, alert.more) == (shown, "(and 1 more)")


def test_what_the_list_says_of_a_vehicle_is_not_said_again_in_words_of_the_log():
    base = make_snapshot(live=True)
    words = "system 12: 3 packets refused, no signature (127.0.0.1:37975 on udpin:127.0.0.1:14550)"
    logged = Event(t_us=base.now_us - 1_000_000, level="alarm", kind="vehicle", text=words, system_id=12)
    listed = replace(SILENT, level="warning", since_us=base.now_us - 2_000_000, text="unsigned packets are rejected")
    for alarms, shown in (((listed,), listed.text), ((replace(listed, system_id=13),), words)):
        assert shown in alert_of(replace(base, alarms=alarms), [logged], frozenset()).text


def test_what_lasts_hides_nothing_that_comes_later():
    lasting = replace(LOW, key="no keys", text="nothing is authenticated: anybody can pose as a vehicle", system_id=0)
    came = replace(LOW, since_us=lasting.since_us + 1, text="UGV-13: battery low: 20%, 11.1 V", system_id=13)
    alert = alert_of(replace(make_snapshot(live=True), alarms=(lasting, came)), (), frozenset())
    assert (alert.text, alert.more) == (came.text, "(and 1 more)")


async def test_the_time_gives_way_to_the_words_and_the_number_of_others_is_never_cut():
    doubted = "UGV-12: its autopilot doubts its position: receiver and estimate are apart"
    for text, shown in ((doubted, f" !! {doubted}"), (f"{doubted}, and longer still", " !! UGV-12: its")):
        alarms = (replace(CONFLICT, text=text), replace(CONFLICT, key="b", since_us=CONFLICT.since_us - 1))
        station = FakeStation(
            live=True, snapshot=replace(make_snapshot(live=True), alarms=alarms[: 1 + (text != doubted)])
        )
        async with running(station, SMALL) as (app, _, _):
            said = text_of(app.query_one(Banner)).rstrip()
        assert said.startswith(shown) and said.endswith("are apart" if text == doubted else "… (and 1 more)"), said


@pytest.mark.parametrize(("text", "hinted"), [("UGV-12: silent", True), (f"UGV-12: {'its receiver ' * 4}fails", False)])
async def test_the_banner_rather_shows_its_words_than_its_keys(text, hinted):
    snapshot = replace(make_snapshot(live=True), alarms=(replace(SILENT, text=text),))
    async with running(FakeStation(live=True, snapshot=snapshot), size=SMALL) as (app, pilot, _):
        await polled(app, pilot)
        shown = app.query_one(Banner).render_line(0).text
        assert text in shown and ("a: what to do" in shown) == hinted


async def test_the_link_is_not_called_lost_where_only_the_position_is_old():
    snapshot = make_snapshot(live=True)
    first, old, *rest = snapshot.vehicles
    old = replace(old, position_state="lost", position_age_s=46.0, heartbeat_age_s=0.2)
    silent = replace(rest[0], position_state="lost", position_age_s=46.0, heartbeat_age_s=46.0)
    snapshot = replace(snapshot, vehicles=(first, old, silent, *rest[1:]))
    async with running(FakeStation(live=True, snapshot=snapshot), size=SMALL) as (app, pilot, _):
        await polled(app, pilot)
        rows = text_of(app.query_one(FleetPane)).split("\n")
        assert [("pos 46s" in row, "lost 46s" in row) for row in rows[2:4]] == [(True, False), (False, True)]


async def test_vehicles_for_which_there_is_no_row_are_counted():
    snapshot = make_snapshot(live=True)
    last = snapshot.vehicles[-1]
    many = tuple(replace(last, system_id=100 + n, name=f"UGV-{100 + n}") for n in range(40))
    below = replace(SILENT, system_id=139)
    for vehicles, alarms, mark in (
        (snapshot.vehicles, (), ""),
        (snapshot.vehicles + many, (), ""),
        (snapshot.vehicles + many, (below,), "!!"),
    ):
        station = FakeStation(live=True, snapshot=replace(snapshot, vehicles=vehicles, alarms=alarms))
        async with running(station, size=SMALL) as (app, pilot, _):
            await polled(app, pilot)
            heading, *rows = text_of(app.query_one(FleetPane)).split("\n")
            more = len(vehicles) - len(rows)
            told = heading.endswith((f" {mark} {more} more ".replace("  ", " "), f" {mark}+{more} "))
            assert told if more > 0 else "more" not in heading and "+" not in heading


async def test_a_key_sorts_by_trouble_and_the_keys_that_pick_follow():
    snapshot = replace(make_snapshot(live=True), alarms=(SILENT, LOW))
    async with running(FakeStation(live=True, snapshot=snapshot), size=WIDE) as (app, pilot, _):
        await pilot.press("o", "down", "down")
        assert [row.system_id for row in app.query_one(FleetPane).in_order(snapshot)][:3] == [12, 13, 17]
        assert app.selected == 13
        await pilot.press("o")
        assert [row.system_id for row in app.query_one(FleetPane).in_order(snapshot)] == [
            row.system_id for row in snapshot.vehicles
        ]


def test_nothing_is_called_likelier_that_is_shown_as_none():
    assert list(_of_its_rivals(0.001, 0.004, 0.7, better=False)) == ["not sure enough: 70% needed"]
    assert list(_of_its_rivals(0.1, 0.4, 0.7, better=False)) == ["none of ours is likelier"]
