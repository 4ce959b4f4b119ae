"""The time line: what it marks, what the keys jump to, how sure a name was."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gcs.snapshot import Event
from gcs.station import Gap
from gcs.tui.draw.moments import KINDS, SIGNS, cells_of, times_of
from gcs.tui.panes.timeline import TimelineBar
from tests.support.fake_station import SMALL, START_US, STOP_US, polled, running, text_of

S = 1_000_000


def event(at_s, kind="link", level="info", text="x", system_id=0):
    return Event(t_us=START_US + round(at_s * S), level=level, kind=kind, text=text, system_id=system_id)


def gap(start_s, stop_s, what="video"):
    return Gap(start_us=START_US + start_s * S, stop_us=START_US + stop_s * S, what=what)


ALL = [
    event(10, "identity"),
    event(30, level="warning"),
    event(50, "mark"),
    event(70, level="alarm"),
    event(72, "identity"),
    event(90),
]


def test_every_kind_has_a_sign_of_its_own_and_the_worst_wins_a_cell():
    assert len(set(SIGNS.values())) == len(KINDS) == len(SIGNS)
    cells = cells_of(ALL, [gap(80, 85)], START_US, START_US + 100 * S, 101)
    marked = {index: kind for index, kind in enumerate(cells) if kind}
    assert marked == {10: "identity", 30: "warning", 50: "mark", 70: "alarm", 72: "identity"} | {
        index: "gap" for index in range(80, 86)
    }
    assert cells_of(ALL, [gap(60, 100)], START_US, START_US + 100 * S, 5) == [
        "identity",
        "warning",
        "mark",
        "alarm",
        "gap",
    ]
    every = [replace(each, t_us=START_US) for each in ALL]
    assert cells_of(every, [gap(0, 100)], START_US, START_US + 100 * S, 1) == ["alarm"]
    assert cells_of([event(-5, level="alarm"), event(500, level="alarm")], [], START_US, START_US + S, 3) == [None] * 3


def test_times_of_a_kind():
    assert times_of("gap", ALL, [gap(80, 85)]) == [START_US + 80 * S]
    assert times_of("identity", ALL, []) == [START_US + 10 * S, START_US + 72 * S]


async def test_the_bar_marks_by_signs_and_the_rest_stays():
    async with running() as (app, pilot, station):
        station.said = [event(40, "mark"), event(700, level="alarm")]
        station.timeline.gaps = [gap(400, 500)]
        await polled(app, pilot)
        bar = text_of(app.query_one(TimelineBar))
        assert all(SIGNS[kind] in bar for kind in ("mark", "alarm", "gap")) and SIGNS["identity"] not in bar
        assert bar.index("▼") < bar.index("●") < bar.index("░") < bar.index("!")


@pytest.mark.slow_but_first
@pytest.mark.parametrize(("presses", "want_s"), [(1, 700), (2, 40), (3, 400), (4, 600), (5, 500)])
async def test_n_and_p_jump_by_kind(presses, want_s):
    """alarm, mark, gap, warning, identity, one press of N after the other."""
    async with running() as (app, pilot, station):
        station.timeline.gaps = [gap(400, 450)]
        station.said = [
            event(40, "mark"), event(500, "identity"), event(600, level="warning"), event(700, level="alarm")
        ]  # fmt: skip
        await polled(app, pilot)
        await pilot.press("home", *"N" * presses, "n")
        assert station.timeline.now_us == START_US + want_s * S
        await pilot.press("end", "p")
        assert station.timeline.now_us == START_US + want_s * S
        await pilot.press("p")
        assert station.timeline.now_us == START_US + want_s * S
        await polled(app, pilot)
        assert KINDS[-presses] in text_of(app.query_one(TimelineBar))
        await pilot.press("home", *"N" * (len(KINDS) + 1 - presses), "n")
        assert station.timeline.now_us == START_US + 40 * S, "again what the log shows"


async def test_jumps_go_to_what_the_search_shows():
    async with running() as (app, pilot, station):
        await pilot.press("e", "slash", *"ugv-17", "enter", "home", "n")
        assert station.timeline.now_us == START_US + 130 * S
        await pilot.press("escape", "home", "n")
        assert station.timeline.now_us == START_US + 2 * S
        assert app.is_running


async def test_the_picked_vehicle_has_a_strip_of_its_confidence_where_there_is_room():
    async with running(size=(120, 40)) as (app, pilot, station):
        sure = np.concatenate([np.full(300, 0.97), np.full(300, 0.6), np.zeros(200), np.full(200, np.nan)])
        station.timeline.sure = {11: sure.astype(np.float32)}
        bar = app.query_one(TimelineBar)
        assert bar.size.height == 1
        await pilot.press("down", "down")
        await polled(app, pilot)
        await pilot.pause()
        assert app.selected == 11 and bar.size.height == 2
        _, strip = text_of(bar).split("\n")
        assert strip.startswith(" UGV-11 ") and len(strip) == 120
        for sign, share in (("█", 0.3), ("▅", 0.3), ("┄", 0.2)):
            assert strip.count(sign) / strip.count("█") == pytest.approx(share / 0.3, rel=0.1), sign
        assert strip.index("█") < strip.index("▅") < strip.index("┄")
        await pilot.press("escape")
        await polled(app, pilot)
        await pilot.pause()
        assert bar.size.height == 1


async def test_a_small_screen_spares_no_row_for_it():
    async with running(size=SMALL) as (app, pilot, station):
        station.timeline.sure = {11: np.ones(10, dtype=np.float32)}
        await pilot.press("down", "down")
        await polled(app, pilot)
        await pilot.pause()
        assert app.query_one(TimelineBar).size.height == 1


async def test_a_click_on_the_strip_seeks_too():
    async with running(size=(120, 40)) as (app, pilot, station):
        station.timeline.sure = {11: np.ones(10, dtype=np.float32)}
        await pilot.press("down", "down")
        await polled(app, pilot)
        await pilot.pause()
        await pilot.click("#timeline", offset=(100, 1))
        assert START_US + 600 * S < station.timeline.now_us < STOP_US


async def test_the_time_is_marked_while_the_screen_shows_another():
    async with running(size=SMALL) as (app, pilot, station):
        bar, shown_us = app.query_one(TimelineBar), station.snapshot.now_us
        for away_s, speed, marked in ((0.5, 1.0, False), (5.0, 1.0, True), (-5.0, 1.0, True), (5.0, 20.0, False)):
            station.timeline.now_us, station.timeline.speed = shown_us + round(away_s * S), speed
            await polled(app, pilot)
            assert ("…10:3" in text_of(bar)) == marked, (away_s, speed)
