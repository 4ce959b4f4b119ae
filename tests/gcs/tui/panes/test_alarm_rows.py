from __future__ import annotations

from dataclasses import replace

import pytest

from gcs.snapshot import Alarm
from gcs.tui.panes.alarms import AlarmPane
from gcs.tui.panes.banner import Banner
from gcs.tui.panes.pane import Pane
from tests.support.fake_station import SMALL, WIDE, FakeStation, polled, running, text_of

ADVICE = (
    "look at its radio and its battery, then at the link's aerial; if it does not come back within a minute, hold the "
    "other vehicles and fetch it by its last place"
)
SIZES = [(60, 20), SMALL, (120, 40), WIDE]


def alarms(count):
    t_us = FakeStation().snapshot.t_us
    return tuple(
        Alarm(
            key=f"vehicle {i}",
            level="alarm" if i % 2 else "warning",
            kind="vehicle",
            text=f"UGV-{i}: trouble number {i} of those that need more than one row to be shown on a small screen",
            advice=f"{ADVICE} ({i})",
            since_us=t_us - 5_000_000,
            system_id=i,
        )
        for i in range(11, 11 + count)
    )


def words_of(pane):
    return " ".join(text_of(pane).split())


@pytest.mark.slow_but_first
@pytest.mark.parametrize("size", SIZES)
async def test_no_pane_moves_when_an_alarm_comes_or_goes(size):
    for keys in ((), ("a",)):
        async with running(FakeStation(live=True), size) as (app, pilot, station):
            await pilot.press(*keys)
            calm, rows = station.snapshot, {pane.id: pane.region for pane in app.query(Pane)}
            for some in (alarms(1), alarms(9), ()):
                station.snapshot = replace(calm, alarms=some)
                await polled(app, pilot)
                assert {pane.id: pane.region for pane in app.query(Pane)} == rows
            assert app.query_one(Banner).region.height == 1


@pytest.mark.slow_but_first
@pytest.mark.parametrize("size", SIZES)
async def test_what_is_wrong_and_what_to_do_are_told_in_whole(size):
    station = FakeStation(live=True)
    station.snapshot = replace(station.snapshot, alarms=alarms(6))
    async with running(station, size) as (app, pilot, _):
        await pilot.press("a", "z")
        pane = app.query_one(AlarmPane)
        for each in alarms(6):
            assert each.text in words_of(pane) and each.advice in words_of(pane), size
            await pilot.press("down")


async def test_an_alarm_longer_than_the_pane_says_where_the_rest_is():
    station = FakeStation(live=True)
    station.snapshot = replace(station.snapshot, alarms=(replace(alarms(1)[0], advice=ADVICE * 3),))
    async with running(station, (60, 20)) as (app, pilot, _):
        await pilot.press("a")
        assert "z: the whole screen" in text_of(app.query_one(AlarmPane))


async def test_alarms_that_are_not_on_screen_are_counted():
    station = FakeStation(live=True)
    station.snapshot = replace(station.snapshot, alarms=alarms(9))
    async with running(station) as (app, pilot, _):
        await pilot.press("a", "z")
        pane = app.query_one(AlarmPane)
        shown = sum(f"({each.system_id})" in words_of(pane) for each in alarms(9))
        assert 1 < shown < 9 and f"{9 - shown} below" in text_of(pane)
        await pilot.press(*["down"] * 8)
        assert "(19)" in words_of(pane) and " above" in text_of(pane) and "below" not in text_of(pane)
        station.snapshot = replace(station.snapshot, alarms=alarms(1))
        await polled(app, pilot)
        assert "above" not in text_of(pane) and "(11)" in words_of(pane)


async def test_alarms_without_room_are_counted_on_the_smallest_screen_too():
    station = FakeStation(live=True)
    station.snapshot = replace(station.snapshot, alarms=alarms(9))
    async with running(station, (60, 20)) as (app, pilot, _):
        await pilot.press("a")
        await pilot.pause()
        assert "8 below 9 new" in text_of(app.query_one(AlarmPane)).splitlines()[0]


async def test_a_click_marks_an_alarm_a_second_one_acknowledges_it():
    station = FakeStation(live=True)
    station.snapshot = replace(station.snapshot, alarms=alarms(3))
    async with running(station, WIDE) as (app, pilot, _):
        await pilot.click(Banner)
        await pilot.pause()
        pane = app.query_one(AlarmPane)
        assert pane.has_focus
        row = next(y for y, line in enumerate(text_of(pane).splitlines()) if "UGV-12" in line)
        await pilot.click(pane, offset=(20, row))
        assert station.seen == [] and "▸" in text_of(pane).splitlines()[row]
        await pilot.click(pane, offset=(20, row), times=2)
        assert [each.system_id for each in station.seen] == [12] and app.selected == 12
