"""The list before take-off is live, and names from the air are no markup in it."""

from dataclasses import replace

from gcs.tui.screens.preflight import PreflightScreen
from tests.support.fake_station import WIDE, FakeStation, comes_true, running, screen_text


async def test_p_shows_what_is_not_well_and_follows():
    station = FakeStation(live=True)
    uav, first, *_ = station.snapshot.vehicles
    unheard = replace(first, name="[b]Eve", heartbeat_age_s=float("inf"), position_age_s=float("inf"))
    unheard = replace(unheard, position_state="never", loss=float("nan"), signed=0, refusals={})
    station.snapshot = replace(station.snapshot, vehicles=(uav, unheard), alarms=())
    async with running(station, size=WIDE) as (app, pilot, _):
        await pilot.press("p")
        assert isinstance(app.screen, PreflightScreen)
        said = screen_text(app)
        assert "✗ [b]Eve  system id 11 is not heard" in said and "→ switch it on" in said
        station.snapshot = replace(station.snapshot, vehicles=(uav, replace(first, position_state="ok")))
        assert await comes_true(pilot, lambda: "is not heard" not in screen_text(app))
        await pilot.press("p")
        assert not isinstance(app.screen, PreflightScreen)


async def test_in_a_replay_p_is_the_event_before():
    async with running(FakeStation()) as (app, pilot, station):
        await pilot.press("p")
        assert not isinstance(app.screen, PreflightScreen) and station.timeline is not None
