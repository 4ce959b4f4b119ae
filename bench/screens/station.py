"""A station that shows one scripted moment after the other, and the app driven on it."""

from __future__ import annotations

import contextlib
import itertools
import math
import shutil
import subprocess
import tempfile
import time
from collections.abc import AsyncIterator, Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Self

import psutil

from bench.flights import Moment
from bench.screens.screen import Screen, TerminalScreen, read_screen
from gcs.snapshot import Event, Snapshot
from gcs.tui import RollcallApp
from tests.support.command_line import GCS
from tests.support.fake_station import FakeStation
from tests.support.slow_terminal import SlowTerminal

VIEWS: tuple[tuple[str, ...], ...] = (("1",), ("2",), ("3",), ("1", "down", "down"), ("a",), ("1", "f", "z"))
"""Keys that change what is shown, each for an equal part of a flight: the layouts, a vehicle's identity, the alarms,
every column of the fleet."""


class ScriptedStation(FakeStation):
    """Gives the moment it is at, as a flight would."""

    commands = None

    def __init__(self, moment: Moment) -> None:
        super().__init__(live=True, snapshot=moment.snapshot)
        self.title, self.moment = "scripted", moment

    def latest(self) -> Snapshot | None:
        return self.moment.snapshot

    def events(self) -> Sequence[Event]:
        return self.moment.events

    def next_view(self) -> None:
        """There is no other camera."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Shot:
    """A screen, and what was true when it was drawn."""

    screen: Screen
    moment: Moment


async def shots(
    moments: Sequence[Moment], size: tuple[int, int], views: Sequence[Sequence[str]] = VIEWS
) -> AsyncIterator[Shot]:
    """The screens of a flight, one a moment, over all views.

    Args:
        moments: of one flight, in order.
        size: columns and rows.
        views: keys, each pressed at the beginning of an equal part of the flight.
    """
    station = ScriptedStation(moments[0])
    app = RollcallApp(station, graphics="blocks")
    app.silent_after_s = math.inf  # a script waits for the machine that looks at it
    async with app.run_test(size=size) as pilot:
        for pane in app._panes.panes:
            pane.rest_s = 0.0
        for part, view in zip(_parts(moments, len(views)), views, strict=True):
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


LONGEST_S, ANALYSED_S = 60.0, 300.0
"""Nothing that is waited for takes longer, nor does the analysis of a recording."""
SETTLE_S = 2.0
RECORDING = Path("sitl_logs/curved-road")
HOME, DOWN, SPACE = b"\x1b[H", b"\x1b[B", b" "
PLAYING = "►"


class TerminalSession(SlowTerminal):
    """Runs a program in a pseudo-terminal until it is closed; a context manager.

    Args:
        command: program and arguments.
        size: columns and rows.
    """

    def __init__(self, command: Sequence[str], size: tuple[int, int]) -> None:
        self.terminal = TerminalScreen(*size)
        self.came: list[tuple[float, int]] = []
        """Monotonic times, s, at which something came, and the bytes until then."""
        self._fed = self._fed_bytes = 0
        self.started_s = time.monotonic()
        super().__init__(command, size=size, controls=False)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.process.terminate()
        with contextlib.suppress(subprocess.TimeoutExpired):
            self.process.wait(timeout=20)
        self.end()

    def wait_until(self, seen: Callable[[str], bool], limit_s: float = LONGEST_S) -> float:
        """Wait until the screen is as wanted; returns the monotonic time, s, inf if it was not in time."""
        stop_s = time.monotonic() + limit_s
        while True:
            while self._fed < len(self.came):
                came_s = self._feed_next()
                if seen(self.terminal.text):
                    return came_s
            if time.monotonic() > stop_s:
                return float("inf")
            time.sleep(0.002)

    def catch_up(self) -> str:
        """The text of the screen as it is now."""
        while self._fed < len(self.came):
            self._feed_next()
        return self.terminal.text

    def wait_analysed(self) -> None:
        """Wait until a replay is analysed, which its first row tells."""
        self.wait_until(lambda text: "REPLAY" in text and "analysed" not in text.partition("\n")[0], ANALYSED_S)

    def go_to_start(self, *, playing: bool) -> None:
        """Go to a replay's first frame, and play or pause."""
        self.press(HOME)
        time.sleep(SETTLE_S)
        if (PLAYING in self.catch_up()) != playing:
            self.press(SPACE)
            time.sleep(SETTLE_S)

    def cpu_s(self) -> tuple[float, float]:
        """Processor time so far: of the main thread, which draws, and of the process."""
        process = psutil.Process(self.process.pid)
        main = next(thread for thread in process.threads() if thread.id == self.process.pid)
        times = process.cpu_times()
        return main.user_time + main.system_time, times.user + times.system

    def _feed_next(self) -> float:
        came_s, until = self.came[self._fed]
        self.terminal.feed(bytes(self.shown[self._fed_bytes : until]))
        self._fed, self._fed_bytes = self._fed + 1, until
        return came_s

    def _show(self, room: int, now: float) -> int:
        took = super()._show(room, now)
        if took:
            self.came.append((time.monotonic(), len(self.shown)))
        return took


@contextlib.contextmanager
def replaying(recording: Path, size: tuple[int, int]) -> Iterator[TerminalSession]:
    """A replay of a copy of a recording."""
    with tempfile.TemporaryDirectory() as folder:
        copy = shutil.copytree(recording, Path(folder) / recording.name)
        with TerminalSession([*GCS, "replay", str(copy), "--ui", "graphics=blocks"], size) as session:
            yield session
