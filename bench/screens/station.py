"""A station that shows one scripted moment after the other, and the app driven on it."""

from __future__ import annotations

import itertools
from collections.abc import AsyncIterator, Iterable, Sequence
from dataclasses import dataclass

from textual.pilot import Pilot
from textual.widget import Widget

from bench.screens.flights import Moment
from bench.screens.screen import Screen, read_screen
from gcs.snapshot import Alarm, Event, Snapshot
from gcs.station import Station
from gcs.tui import RollcallApp

__all__ = ["VIEWS", "Shot", "shots"]

VIEWS: tuple[tuple[str, ...], ...] = (("1",), ("2",), ("3",), ("1", "down", "down"), ("a",), ("1", "f", "z"))
"""Keys that change what is shown, each for an equal part of a flight: the layouts, a vehicle's identity, the alarms,
every column of the fleet."""
MOST_PAUSES = 100
"""For one moment; two are usual."""


class ScriptedStation(Station):
    """Gives the moment it is at, as a flight would; what the operator does goes nowhere."""

    title = "scripted"
    timeline = None
    commands = None
    error = None
    folder = None
    tiles = None

    def __init__(self, moment: Moment) -> None:
        self.moment = moment

    def latest(self) -> Snapshot | None:
        return self.moment.snapshot

    def events(self) -> Sequence[Event]:
        return self.moment.events

    def mark(self, t_us: int, text: str, system_id: int = 0) -> None:
        return None

    def add_event(self, event: Event) -> None:
        return None

    def acknowledge(self, alarms: Sequence[Alarm]) -> None:
        return None

    def state_name(self, track_id: int, system_id: int) -> None:
        return None

    def undo_statement(self, track_id: int = 0) -> None:
        return None

    def accept_held(self, system_ids: Sequence[int]) -> None:
        return None

    def stop(self) -> None:
        return None


@dataclass(frozen=True, slots=True, kw_only=True)
class Shot:
    """A screen, and what was true when it was drawn."""

    screen: Screen
    moment: Moment


async def shots(moments: Sequence[Moment], size: tuple[int, int]) -> AsyncIterator[Shot]:
    """The screens of a flight, one a moment, over all views.

    Args:
        moments: of one flight, in order.
        size: columns and rows.
    """
    station = ScriptedStation(moments[0])
    app = RollcallApp(station, graphics="blocks")
    async with app.run_test(size=size) as pilot:
        for part, view in zip(_parts(moments, len(VIEWS)), VIEWS, strict=True):
            await pilot.press(*view)
            for station.moment in part:
                app._poll()
                await _drawn(app, pilot)
                yield Shot(screen=read_screen(app), moment=station.moment)


async def _drawn(app: RollcallApp, pilot: Pilot[None]) -> None:
    """Wait until nothing is left to be drawn; a pause alone ends early on a machine with other work to do."""
    for _ in range(MOST_PAUSES):
        await pilot.pause()
        widgets = [app.screen, *app.screen.walk_children(Widget)]
        waits = any(w._layout_required or w._repaint_required or w._scroll_required for w in widgets)
        if not waits and not app.screen._dirty_widgets and all(w._message_queue.empty() for w in (app, *widgets)):
            return
    raise AssertionError(f"the screen is not drawn after {MOST_PAUSES} pauses")


def _parts(moments: Sequence[Moment], count: int) -> Iterable[Sequence[Moment]]:
    """Equal parts."""
    bounds = [round(k * len(moments) / count) for k in range(count + 1)]
    return [moments[low:high] for low, high in itertools.pairwise(bounds)]
