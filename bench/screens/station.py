"""A station that shows one scripted moment after the other, and the app driven on it."""

from __future__ import annotations

import itertools
import math
from collections.abc import AsyncIterator, Iterable, Sequence
from dataclasses import dataclass

from bench.screens.flights import Moment
from bench.screens.screen import Screen, read_screen
from gcs.snapshot import Alarm, Event, FleetChange, Snapshot
from gcs.station import CameraPicture, Newcomer, Station
from gcs.tui import RollcallApp
from mavlink.transmit.message_rates import Rate

VIEWS: tuple[tuple[str, ...], ...] = (("1",), ("2",), ("3",), ("1", "down", "down"), ("a",), ("1", "f", "z"))
"""Keys that change what is shown, each for an equal part of a flight: the layouts, a vehicle's identity, the alarms,
every column of the fleet."""


class ScriptedStation(Station):
    """Gives the moment it is at, as a flight would; what the operator does goes nowhere."""

    title = "scripted"
    timeline = None
    commands = practice = None
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

    def rates(self) -> Sequence[Rate]:
        """A recording measures nothing."""
        return ()

    def newcomers(self) -> Sequence[Newcomer]:
        """Nobody."""
        return ()

    def change_fleet(self, change: FleetChange) -> None:
        """Not in a scene."""

    def accept_held(self, system_ids: Sequence[int]) -> None:
        return None

    def save_mission(self) -> str:
        """Nowhere."""
        return ""

    def take_rival_video(self) -> None:
        return None

    def next_view(self) -> None:
        """There is no other camera."""

    def pictures(self) -> Sequence[CameraPicture]:
        return [CameraPicture(name=self.title, snapshot=self.moment.snapshot, on_show=True)]

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
    app.silent_after_s = math.inf  # a script waits for the machine that looks at it
    async with app.run_test(size=size) as pilot:
        for part, view in zip(_parts(moments, len(VIEWS)), VIEWS, strict=True):
            await pilot.press(*view)
            for station.moment in part:
                app._poll()
                await pilot.pause()
                await pilot.pause()  # a machine with other work to do lets the first end before all is drawn
                yield Shot(screen=read_screen(app), moment=station.moment)


def _parts(moments: Sequence[Moment], count: int) -> Iterable[Sequence[Moment]]:
    """Equal parts."""
    bounds = [round(k * len(moments) / count) for k in range(count + 1)]
    return [moments[low:high] for low, high in itertools.pairwise(bounds)]
