"""X begins and ends troubles of a simulated fleet; a real one has none."""

import pytest

from gcs.flight.practice import PractisedFleet
from tests.support.fake_station import SMALL, WIDE, FakeStation, running, screen_text


async def test_a_trouble_begins_and_ends_with_two_keys_each():
    told = []
    station = FakeStation(live=True)
    station.practice = PractisedFleet(9, lambda system_id, text: told.append((system_id, text)))
    async with running(station) as (app, pilot, _):
        await pilot.press("X")
        assert "Which trouble is UGV-11 to have?" in screen_text(app)
        await pilot.press("enter", "X")
        assert "nearly empty – is on, ends it" in screen_text(app)
        await pilot.press("enter", "X", "end", "enter")
    battery = "its battery is nearly empty"
    assert told == [
        (11, f"practised: {battery}"),
        (11, f"practised, ended: {battery}"),
        (0, "practised: no vehicle is where the film shows one"),
    ]


@pytest.mark.parametrize("size", [SMALL, WIDE])
async def test_the_list_says_what_enter_does_however_many_troubles_there_are(size):
    station = FakeStation(live=True)
    station.practice = PractisedFleet(9, lambda *_: None)
    async with running(station, size) as (app, pilot, _):
        await pilot.press("X")
        for key in ("home", "end"):
            await pilot.press(key)
            lines = screen_text(app).splitlines()
            assert any("enter begins or ends it; esc closes" in each for each in lines)
            assert not any("▔" in each or "▎" in each for each in lines)


async def test_a_real_fleet_has_no_troubles_to_practise_with():
    async with running(FakeStation(live=True)) as (app, pilot, _):
        await pilot.press("X")
        assert any("gcs demo --live" in str(each.message) for each in app._notifications)


def test_troubles_of_signing_are_offered_where_signatures_count():
    offered = [[key for key, _ in PractisedFleet(9, print, signs=signs).troubles(11)] for signs in (True, False)]
    assert set(offered[0]) - set(offered[1]) == {"unsigned", "signature", "stale"} and len(offered[1]) > 20


def test_a_trouble_that_nobody_feels_of_a_ground_vehicle_is_not_offered_for_one():
    fleet = PractisedFleet(9, print, films=(1,))
    assert [("attitude" in dict(fleet.troubles(each))) for each in (1, 11)] == [True, False]
