"""Ordering from the screen: a list, a second question, nothing by accident."""

from __future__ import annotations

from contextlib import asynccontextmanager

import pytest

from gcs.tui import RollcallApp
from gcs.tui.screens.command import OrderList
from gcs.tui.screens.prompts import Confirm
from tests.support.fake_station import HOSTILE, SMALL, FakeStation, screen_text


class FakeCommands:
    """Keeps what was ordered."""

    def __init__(self, words: str = "Point the camera at UGV-{}") -> None:
        self.words = words
        self.given: list[tuple[str, int]] = []
        self.error: Exception | None = None

    def orders(self, system_id: int) -> list[tuple[str, str]]:
        about = [("point", self.words.format(system_id))] if system_id > 1 else []
        return [*about, ("hold", "Let UAV-1 stop and hold its position"), ("return", "Let UAV-1 return to launch")]

    def submit(self, key: str, system_id: int) -> None:
        if self.error is not None:
            raise self.error
        self.given.append((key, system_id))


@asynccontextmanager
async def commanding(desk=None, *, live=True, size=SMALL):
    station = FakeStation(live=live)
    station.commands = desk
    app = RollcallApp(station, graphics="blocks")
    async with app.run_test(size=size) as pilot:
        await pilot.pause()
        yield app, pilot


def notices(app) -> str:
    return " ".join(notice.message for notice in app._notifications)


async def test_choose_confirm_give():
    desk = FakeCommands()
    async with commanding(desk) as (app, pilot):
        await pilot.press("down", "down", "u")
        assert isinstance(app.screen, OrderList)
        assert "Point the camera at UGV-11" in screen_text(app)
        await pilot.press("enter")
        assert isinstance(app.screen, Confirm) and desk.given == []
        assert "Point the camera at UGV-11?" in screen_text(app)
        await pilot.press("y")
        assert desk.given == [("point", 11)]
        assert not isinstance(app.screen, Confirm | OrderList)


async def test_without_a_vehicle_only_the_uav_is_commanded():
    desk = FakeCommands()
    async with commanding(desk) as (app, pilot):
        await pilot.press("u")
        assert "Point the camera" not in screen_text(app)
        await pilot.press("j", "enter", "y")
        assert desk.given == [("return", 0)]


@pytest.mark.parametrize(
    "keys", [["u", "escape"], ["u", "u"], ["u", "enter", "n"], ["u", "enter", "escape"], ["u", "enter", "enter", "q"]]
)
async def test_nothing_by_accident(keys):
    desk = FakeCommands()
    async with commanding(desk) as (app, pilot):
        await pilot.press(*keys)
        assert desk.given == []
        assert not isinstance(app.screen, Confirm | OrderList)
        assert app.is_running


async def test_a_station_that_listens_says_so_and_how_to_let_it_speak():
    async with commanding(None) as (app, pilot):
        await pilot.press("u")
        assert not isinstance(app.screen, OrderList)
        assert "--command" in notices(app)


async def test_a_recording_takes_no_commands():
    async with commanding(None, live=False) as (app, pilot):
        await pilot.press("u")
        assert "recording" in notices(app)


async def test_what_the_desk_refuses_is_told():
    desk = FakeCommands()
    desk.error = ValueError("point: [/x] needs a vehicle")
    async with commanding(desk) as (app, pilot):
        await pilot.press("u", "enter", "y")
        await pilot.pause()
        assert "needs a vehicle" in notices(app)
        assert app.is_running


@pytest.mark.slow_but_first
@pytest.mark.parametrize("text", HOSTILE)
async def test_names_are_never_markup(text):
    desk = FakeCommands(words=text.replace("{", "{{").replace("}", "}}"))
    async with commanding(desk) as (app, pilot):
        await pilot.press("down", "down", "u")
        await pilot.pause()
        assert "\x1b" not in screen_text(app)
        await pilot.press("enter")
        await pilot.pause()
        assert isinstance(app.screen, Confirm) and "\x1b" not in screen_text(app)
        await pilot.press("y")
        assert desk.given == [("point", 11)]


@pytest.mark.parametrize("size", [(40, 12), (20, 6), (200, 60)])
async def test_every_size(size):
    desk = FakeCommands()
    async with commanding(desk, size=size) as (_, pilot):
        await pilot.press("u")
        await pilot.pause()
        await pilot.press("enter")
        await pilot.pause()
        await pilot.press("y")
        assert desk.given == [("hold", 0)]
