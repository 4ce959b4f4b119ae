from __future__ import annotations

from dataclasses import replace

from textual.binding import Binding
from textual.command import CommandPalette
from textual.widgets import Input, OptionList

from gcs.tui.keys import BINDINGS, LIVE_ACTIONS
from gcs.tui.panes.alarms import AlarmPane
from gcs.tui.panes.pane import Pane
from tests.support.fake_station import WIDE, FakeStation, comes_true, polled, running


async def offered(app, pilot, words=""):
    """What the palette lists for some words."""
    if not isinstance(app.screen, CommandPalette):
        await pilot.press("ctrl+p")
    app.screen.query_one(Input).value = words
    await pilot.pause()

    def listed():
        return [str(option.prompt) for option in app.screen.query_one(OptionList).options]

    def is_searched():
        return listed() and all(worker.is_finished for worker in app.workers if worker.node is app.screen)

    assert await comes_true(pilot, is_searched)
    return listed()


async def chosen(app, pilot, words):
    assert await offered(app, pilot, words)
    await pilot.press("enter")
    assert await comes_true(pilot, lambda: not isinstance(app.screen, CommandPalette))
    await pilot.pause()


async def test_every_action_of_the_app_and_of_the_panes_on_screen_is_offered():
    async with running(size=WIDE) as (app, pilot, _):
        listed = " ".join(" ".join(await offered(app, pilot)).split())
        own = [binding for pane in app.query(Pane) if pane.display for binding in pane.BINDINGS]
        assert own and all(isinstance(binding, Binding) for binding in own)
        for binding in (*(each for each in BINDINGS if each.action not in LIVE_ACTIONS), *own):
            assert binding.tooltip in listed, binding.tooltip
        for others in ("Maximize", "Screenshot", "textual"):
            assert others not in listed, "nothing of the toolkit's own, which does not know these screens"


async def test_an_action_is_found_by_its_words_and_done():
    async with running(size=WIDE) as (app, pilot, _):
        listed = await offered(app, pilot, "high contrast")
        assert listed[0].split() == ["t", "Theme:", "dark,", "light,", "high", "contrast"]
        await chosen(app, pilot, "high contrast")
        assert app.theme == "light"
        await chosen(app, pilot, "pick ugv-13")
        assert app.selected == 13


async def test_an_action_of_a_pane_is_done_there():
    station = FakeStation(live=True)
    async with running(station, WIDE) as (app, pilot, _):
        await pilot.press("a", "v")
        await chosen(app, pilot, "acknowledge this alarm")
        assert app.query_one(AlarmPane).has_focus


async def test_a_flight_offers_nothing_of_a_replay():
    async with running(FakeStation(live=True)) as (app, pilot, _):
        listed = " ".join(await offered(app, pilot))
        assert "Play or pause" not in listed and "Go to a time" not in listed and "Quit" in listed


async def test_names_are_never_markup():
    station = FakeStation()
    shown = station.snapshot
    name = "[@click=app.quit]x[/] [red]"
    station.snapshot = replace(shown, vehicles=(replace(shown.vehicles[0], name=name), *shown.vehicles[1:]))
    async with running(station, WIDE) as (app, pilot, _):
        await polled(app, pilot)
        for words in ("", "pick"):
            assert any(name in each for each in await offered(app, pilot, words)), words
