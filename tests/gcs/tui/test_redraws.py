"""Only what has changed is drawn, and the map no oftener than it moves."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np

from gcs.tui.panes.banner import Banner
from gcs.tui.panes.key_hints import KeyHints
from tests.support.fake_station import FakeStation, make_snapshot, polled, running, text_of

WIDE = (120, 40)


def moved(snapshot, east):
    """The same moment with the UAV, and what it films, elsewhere."""
    image = np.roll(snapshot.image, round(40 * east), axis=1)
    return replace(snapshot, image=image, uav_enu=np.array([east, 0.0, 30.0]))


async def test_rows_that_have_not_changed_are_not_drawn_again(monkeypatch):
    drawn = []
    for kind in (KeyHints, Banner):
        usual = kind.render_line
        monkeypatch.setattr(kind, "render_line", lambda self, y, usual=usual: drawn.append(self.id) or usual(self, y))
    async with running(FakeStation(snapshot=make_snapshot()), WIDE) as (app, pilot, station):
        drawn.clear()
        for east in (1.0, 2.0, 3.0):
            station.snapshot = moved(station.snapshot, east)
            await polled(app, pilot)
        assert drawn == []
        await pilot.press("v")
        await pilot.pause()
        assert drawn == ["hints"]


async def test_the_map_rests_between_frames_but_shows_a_key_at_once(monkeypatch):
    now_s = [100.0]
    monkeypatch.setattr("gcs.tui.panes.pane.time", SimpleNamespace(monotonic=lambda: now_s[0]))
    async with running(FakeStation(snapshot=make_snapshot()), WIDE) as (app, pilot, station):
        app._map.rest_s = 0.15
        app._map.redraw()
        before, picture = text_of(app._map), app._video._rows[5]
        station.snapshot = moved(station.snapshot, 9.0)
        now_s[0] += 0.1
        await polled(app, pilot)
        assert text_of(app._map) == before and app._video._rows[5] != picture
        now_s[0] += 0.1
        await polled(app, pilot)
        assert text_of(app._map) != before
        before = text_of(app._map)
        await pilot.press("+")
        assert text_of(app._map) != before
