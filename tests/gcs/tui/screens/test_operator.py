"""What an operator keeps, and what is asked before a flight ends."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from gcs.report.overlay import draw
from gcs.tui.keys import BINDINGS
from gcs.tui.screens import marking
from gcs.tui.screens.leaving import LeaveFlight
from gcs.tui.screens.prompts import Prompt
from tests.support.fake_station import START_US, FakeStation, comes_true, polled, running, screen_text


async def test_a_mark_has_the_time_of_its_key_and_the_picked_vehicle():
    async with running() as (app, pilot, station):
        pressed_us = station.timeline.now_us
        await pilot.press("down", "down", "m")
        assert isinstance(app.screen, Prompt) and "UGV-11" in screen_text(app)
        station.timeline.now_us += 60_000_000
        await pilot.press(*"left [/x]", "enter")
        mark = station.said[-1]
        assert (mark.kind, mark.t_us, mark.text, mark.system_id) == ("mark", pressed_us, "left [/x]", 11)
        await polled(app, pilot)
        assert "UGV-11: left [/x]" in screen_text(app)


async def test_a_mark_in_flight_is_of_the_second_of_its_key(monkeypatch):
    monkeypatch.setattr(marking, "now_us", lambda: START_US + 7)
    async with running(FakeStation(live=True)) as (_, pilot, station):
        await pilot.press("m")
        monkeypatch.setattr(marking, "now_us", lambda: START_US + 9_000_000)
        await pilot.press("enter")
        assert (station.said[-1].t_us, station.said[-1].text) == (START_US + 7, "mark")
        before = len(station.said)
        await pilot.press("m", "x", "escape")
        assert len(station.said) == before


async def test_a_mark_that_cannot_be_kept_says_why():
    def refused(*_):
        raise PermissionError(13, "Permission denied")

    async with running() as (app, pilot, station):
        station.mark = refused
        await pilot.press("m", "x", "enter")
        assert isinstance(app.screen, Prompt) and "Permission denied" in screen_text(app)


async def still(pilot, folder):
    await pilot.press("s")
    assert await comes_true(pilot, lambda: list(folder.rglob("*.png")))
    return sorted(folder.rglob("*.png"))


async def test_a_still_of_a_flight_is_the_whole_frame_with_names_and_never_replaces_another(tmp_path):
    async with running(FakeStation(live=True)) as (_, pilot, station):
        station.folder = tmp_path
        (first,) = await still(pilot, tmp_path)
        assert first.parent == tmp_path / "stills"
        image = cv2.imread(str(first))
        assert np.array_equal(image, draw(station.snapshot))
        before = first.read_bytes()
        while len(found := await still(pilot, tmp_path)) < 2:
            pass
        assert first.read_bytes() == before and len(found) == 2
        await pilot.pause()
        assert any(event.kind == "operator" and event.text.endswith(f": stills/{first.name}") for event in station.said)


async def test_no_still_is_written_behind_a_link(tmp_path):
    async with running(FakeStation(live=True)) as (app, pilot, station):
        station.folder = tmp_path / "flight"
        for name in ("flight", "elsewhere"):
            (tmp_path / name).mkdir()
        (station.folder / "stills").symlink_to(tmp_path / "elsewhere")
        await pilot.press("s")
        assert await comes_true(
            pilot, lambda: any("not saved: Not a directory" in n.message for n in app._notifications)
        )
        assert list(tmp_path.rglob("*.png")) == []


async def test_a_still_of_a_replay_goes_where_the_operator_says(tmp_path):
    async with running() as (app, pilot, station):
        await pilot.press("s")
        while not isinstance(app.screen, Prompt):
            await pilot.pause(0.02)
        app.screen.query_one("#answer").value = str(tmp_path / "a.png")
        await pilot.press("enter")
        assert cv2.imread(str(tmp_path / "a.png")).shape == station.snapshot.image.shape
        assert "a.png" in station.said[-1].text


async def test_a_still_that_cannot_be_written_or_has_no_frame_says_so(tmp_path):
    async with running(FakeStation(live=True)) as (app, pilot, station):
        station.folder = tmp_path / "gone"
        await pilot.press("s")
        assert await comes_true(pilot, lambda: app._notifications)
        assert "not saved: No such file" in " ".join(notice.message for notice in app._notifications)
        station.snapshot = None
        app.snapshot = None
        await pilot.press("s")
        assert "no frame to save" in " ".join(notice.message for notice in app._notifications)


async def test_leaving_a_flight_is_asked_and_a_second_q_ends_it():
    async with running(FakeStation(live=True)) as (app, pilot, _):
        await pilot.press("q")
        assert isinstance(app.screen, LeaveFlight) and app.is_running and not app.left
        assert "End the flight" in screen_text(app)
        await pilot.press("n")
        assert not isinstance(app.screen, LeaveFlight)
        await pilot.press("q", "escape", "q", "q")
    assert app.left


@pytest.mark.slow
async def test_no_key_alone_speaks_to_the_uav_or_ends_the_flight(tmp_path, monkeypatch):
    """Nor with enter behind it: what is sent takes a y to a question."""
    monkeypatch.chdir(tmp_path)  # some keys offer to save a file
    station = FakeStation(live=True)
    orders = station.commands = FakeOrders()
    base = station.snapshot
    station.snapshot = replace(base, vehicles=tuple(replace(row, held_s=720.0) for row in base.vehicles))
    async with running(station) as (app, pilot, _):
        await pilot.press("down", "down")
        for key in (key for binding in BINDINGS for key in binding.key.split(",")):
            await pilot.press(key, "enter")
            assert orders.given == [] and station.accepted == [], key
            assert app.is_running and not app.left, key
            while len(app.screen_stack) > 1:
                await pilot.press("escape")
    assert orders.asked


class FakeOrders:
    """Keeps what was ordered."""

    def __init__(self):
        self.given, self.asked = [], 0

    def orders(self, system_id):
        self.asked += 1
        return [("hold", "Let UAV-1 stop and hold its position")]

    def submit(self, key, system_id):
        self.given.append((key, system_id))


async def test_only_the_screen_can_be_left():
    async with running(FakeStation(live=True)) as (app, pilot, _):
        await pilot.press("q", "l")
    assert not app.left and app.return_code == 0
