"""Vouching on the screen for vehicles whose signed packets are held."""

from __future__ import annotations

from contextlib import asynccontextmanager
from dataclasses import replace

from gcs.tui import RollcallApp
from gcs.tui.screens.prompts import Confirm
from tests.support.fake_station import SMALL, FakeStation, screen_text


@asynccontextmanager
async def running(*held, live=True):
    """A flight in which packets of some vehicles are held, by their place in the table."""
    station = FakeStation(live=live)
    rows = tuple(replace(row, held_s=720.0) if k in held else row for k, row in enumerate(station.snapshot.vehicles))
    station.snapshot = replace(station.snapshot, vehicles=rows)
    app = RollcallApp(station, graphics="blocks")
    async with app.run_test(size=SMALL) as pilot:
        await pilot.pause()
        yield app, pilot, station


def notices(app) -> str:
    return " ".join(notice.message for notice in app._notifications)


async def test_all_that_are_held_are_believed_after_a_second_question():
    async with running(1, 2) as (app, pilot, station):
        names = [station.snapshot.vehicles[k].name for k in (1, 2)]
        await pilot.press("b")
        assert isinstance(app.screen, Confirm)
        said = screen_text(app)
        assert all(name in said for name in names) and "12m behind" in said
        await pilot.press("b", "n")
        assert station.accepted == []
        await pilot.press("b", "y")
        assert station.accepted == [station.snapshot.vehicles[k].system_id for k in (1, 2)]


async def test_only_the_selected_one_where_it_is_held():
    async with running(1, 2) as (_, pilot, station):
        await pilot.press("down", "down", "b", "y")
        assert station.accepted == [station.snapshot.vehicles[1].system_id]


async def test_without_anybody_held_it_says_so():
    async with running() as (app, pilot, station):
        await pilot.press("b", "y")
        assert not isinstance(app.screen, Confirm)
        assert "no vehicle" in notices(app) and station.accepted == []


async def test_a_recording_accepts_nobody():
    async with running(1, live=False) as (app, pilot, station):
        await pilot.press("b", "y")
        assert "recording" in notices(app) and station.accepted == []
