"""Taking in who is heard, leaving out, renaming: by keys, in words, and never as markup."""

from textual.widgets import OptionList

from gcs.snapshot import FleetChange
from gcs.station import Newcomer
from gcs.tui.screens.fleet_changes import FleetList
from tests.support.fake_station import FakeStation, comes_true, polled, running, screen_text

NEW = Newcomer(system_id=18, kind="rover", away_m=40.0, offered=True)
FAR = Newcomer(system_id=7, kind="[b]boat", away_m=float("inf"), offered=False)


async def test_a_newcomer_is_told_and_taken_in_by_two_keys():
    station = FakeStation(live=True)
    station.heard = (FAR, NEW)
    async with running(station) as (app, pilot, _):
        await polled(app, pilot)
        await polled(app, pilot)
        told = [str(each.message) for each in app._notifications]
        assert told == ["rover 18 is heard, 40 m from the fleet: F takes it in"]
        await pilot.press("F", "enter")
        await comes_true(pilot, lambda: station.changes)
        assert station.changes == [FleetChange(what="added", system_id=18)]


async def test_one_of_the_fleet_is_left_out_and_renamed():
    station = FakeStation(live=True)
    station.heard = (FAR,)
    async with running(station) as (app, pilot, _):
        await polled(app, pilot)
        last = station.snapshot.vehicles[-1].system_id
        await pilot.press("F")
        await comes_true(pilot, lambda: isinstance(app.screen, FleetList))
        assert "[b]boat" in screen_text(app)
        app.screen.query_one(OptionList).action_last()
        await pilot.press("space")
        await pilot.press("F")
        await comes_true(pilot, lambda: isinstance(app.screen, FleetList))
        app.screen.query_one(OptionList).action_last()
        await pilot.press("r")
        await pilot.press(*["backspace"] * 20, *"Eve", "enter")
        await comes_true(pilot, lambda: len(station.changes) == 2)
        assert station.changes == [
            FleetChange(what="left out", system_id=last),
            FleetChange(what="renamed", system_id=last, name="Eve"),
        ]


async def test_what_cannot_be_done_is_told_and_a_recording_changes_nothing():
    station = FakeStation(live=True)
    station.heard = (Newcomer(system_id=99, kind="rover", away_m=1.0, offered=False),)
    async with running(station) as (app, pilot, _):
        await polled(app, pilot)
        await pilot.press("F", "enter")
        await comes_true(pilot, lambda: app._notifications)
        assert "[b]99 cannot be left out" in [str(each.message) for each in app._notifications]
    async with running(FakeStation()) as (app, pilot, _):
        await polled(app, pilot)
        await pilot.press("F")
        assert not isinstance(app.screen, FleetList)
