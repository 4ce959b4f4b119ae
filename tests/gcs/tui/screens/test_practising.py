"""X begins and ends troubles of a simulated fleet; a real one has none."""

from dataclasses import replace

import pytest

from gcs.flight.practice import PractisedFleet
from gcs.snapshot import Alarm
from gcs.tui.panes.banner import Banner
from sim.practice import Troubles
from tests.support.fake_station import SMALL, WIDE, FakeStation, polled, running, screen_text
from tests.support.ports import free_port


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


def alarm(kind, text):
    return Alarm(key=text, level="alarm", kind=kind, text=text, advice="", since_us=1)


async def test_a_simulated_flight_that_is_over_says_so_and_is_no_alarm():
    told = []
    station, port = FakeStation(live=True), free_port()
    station.practice = fleet = PractisedFleet(port, lambda *words: told.append(words))
    lost = replace(station.snapshot, alarms=(alarm("vehicle", "UGV-11: no heartbeat"),))
    station.snapshot = lost
    fleet.look()
    async with running(station) as (app, pilot, _):
        assert "no heartbeat" in screen_text(app) and not fleet.over, "it has not begun"
        simulator = Troubles([11], port)
        fleet.look()
        simulator.listen()
        await polled(app, pilot)
        assert "no heartbeat" in screen_text(app) and not fleet.over and not told
        simulator.close()
        fleet.look()
        fleet.look()
        assert told == [(0, "the simulated flight is over: names and places are of the past")]
        await polled(app, pilot)
        shown = app.query_one(Banner).alert
        assert shown.level == "calm" and shown.text.startswith(told[0][1]) and shown.text in screen_text(app)
        station.snapshot = replace(lost, alarms=(*lost.alarms, alarm("recording", "the disk is full")))
        await polled(app, pilot)
        assert app.query_one(Banner).alert.level == "alarm", "the recording goes on"
