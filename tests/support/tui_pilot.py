"""A driven terminal application on a fake station, and what its screen says."""

from __future__ import annotations

from contextlib import asynccontextmanager

from gcs.tui import RollcallApp
from gcs.tui.pane_area import PaneArea
from gcs.tui.panes.pane import Pane
from tests.support.fake_station import FakeStation

SMALL, WIDE = (80, 24), (160, 48)


@asynccontextmanager
async def running(station=None, size=SMALL):
    station = FakeStation() if station is None else station
    app = RollcallApp(station, graphics="blocks")
    async with app.run_test(size=size) as pilot:
        await pilot.pause()
        yield app, pilot, station


async def polled(app, pilot):
    app._poll()
    await pilot.pause()


def text_of(widget) -> str:
    return "\n".join(widget.render_line(y).text for y in range(widget.size.height))


def screen_text(app) -> str:
    return "\n".join("".join(segment.text for segment in row) for row in app.screen._compositor.render_strips())


def on_screen(app) -> set[str]:
    deck = app.query_one(PaneArea)
    return {pane.id for pane in app.query(Pane) if pane.display and deck.has_room(pane.id)}
