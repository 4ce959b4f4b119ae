"""Taking the other video: only where two contest the port, and only when it is confirmed."""

from __future__ import annotations

from dataclasses import replace

from gcs.tui import RollcallApp
from gcs.tui.screens.prompts import Confirm
from tests.support.fake_station import SMALL, FakeStation, screen_text


async def test_the_other_video_is_taken_after_a_second_question():
    station = FakeStation()
    health = replace(station.snapshot.health, video_sender="10.0.0.7:5004", video_rival="10.0.0.66:4000")
    station.snapshot = replace(station.snapshot, health=health)
    app = RollcallApp(station, graphics="blocks")
    async with app.run_test(size=SMALL) as pilot:
        await pilot.pause()
        await pilot.press("V")
        assert isinstance(app.screen, Confirm)
        assert all(address in screen_text(app) for address in ("10.0.0.7:5004", "10.0.0.66:4000"))
        await pilot.press("V", "n")
        assert station.taken == 0
        await pilot.press("V", "y")
        assert station.taken == 1


async def test_without_a_contest_it_says_so():
    station = FakeStation()
    app = RollcallApp(station, graphics="blocks")
    async with app.run_test(size=SMALL) as pilot:
        await pilot.pause()
        await pilot.press("V", "y")
        assert not isinstance(app.screen, Confirm) and station.taken == 0
        assert any("only one sender" in notice.message for notice in app._notifications)
