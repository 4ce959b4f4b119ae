"""A station that shows one scripted moment after the other, and the app driven on it."""

from __future__ import annotations

import fcntl
import itertools
import math
import os
import pty
import select
import signal
import struct
import subprocess
import termios
import threading
import time
from collections.abc import AsyncIterator, Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import TracebackType
from typing import Self

import psutil

from bench.screens.flights import Moment
from bench.screens.screen import Screen, TerminalScreen, read_screen
from gcs.snapshot import Alarm, Event, FleetChange, Snapshot
from gcs.station import CameraPicture, Newcomer, Station
from gcs.tui import RollcallApp
from gcs.tui.terminal.pacing import QUESTION
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


LONGEST_S = 60.0
"""Nothing that is waited for takes longer."""
READ_BYTES = 1 << 16
REPLY = b"\x1b[0n"


class TerminalSession:
    """Runs a program in a pseudo-terminal until it is closed; a context manager.

    Args:
        command: program and arguments.
        size: columns and rows.
        environment: beside what every terminal has.
    """

    def __init__(self, command: Sequence[str], size: tuple[int, int], environment: Mapping[str, str] = {}) -> None:
        self.terminal = TerminalScreen(*size)
        self.written: list[tuple[float, bytes]] = []
        """Bytes that came, each with the monotonic time, s."""
        self._fed = 0
        self._main, inner = pty.openpty()
        fcntl.ioctl(inner, termios.TIOCSWINSZ, struct.pack("HHHH", size[1], size[0], 0, 0))
        self.started_s = time.monotonic()
        self.process = subprocess.Popen(
            command,
            stdin=inner,
            stdout=inner,
            stderr=inner,
            start_new_session=True,
            env={**os.environ, "TERM": "xterm-256color", "COLORTERM": "truecolor", **environment},
        )
        os.close(inner)
        self._reading = threading.Thread(target=self._read, daemon=True)
        self._reading.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.process.send_signal(signal.SIGTERM)
        try:
            self.process.wait(timeout=20)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self._reading.join(timeout=5)
        os.close(self._main)

    def press(self, keys: bytes) -> float:
        """Type; returns when, monotonic seconds."""
        now = time.monotonic()
        os.write(self._main, keys)
        return now

    def wait_for(self, seen: Callable[[str], bool], limit_s: float = LONGEST_S) -> float:
        """Wait until the screen is as wanted; returns the monotonic time, s, inf if it was not in time."""
        stop_s = time.monotonic() + limit_s
        while True:
            while self._fed < len(self.written):
                came_s, data = self.written[self._fed]
                self._fed += 1
                self.terminal.feed(data)
                if seen(self.terminal.text):
                    return came_s
            if time.monotonic() > stop_s:
                return float("inf")
            time.sleep(0.002)

    def catch_up(self) -> str:
        """The text of the screen as it is now."""
        while self._fed < len(self.written):
            self.terminal.feed(self.written[self._fed][1])
            self._fed += 1
        return self.terminal.text

    def cpu_s(self) -> tuple[float, float]:
        """Processor time so far: of the main thread, which draws, and of the process."""
        process = psutil.Process(self.process.pid)
        main = next(thread for thread in process.threads() if thread.id == self.process.pid)
        times = process.cpu_times()
        return main.user_time + main.system_time, times.user + times.system

    def _read(self) -> None:
        """Until the program ends; what asks whether its output is shown is answered, as terminals do."""
        rest = b""
        while self.process.poll() is None or select.select([self._main], [], [], 0)[0]:
            if not select.select([self._main], [], [], 0.2)[0]:
                continue
            try:
                data = os.read(self._main, READ_BYTES)
            except OSError:  # the other end is closed
                return
            self.written.append((time.monotonic(), data))
            *questions, rest = (rest + data).split(QUESTION)
            os.write(self._main, REPLY * len(questions))
            rest = rest[1 - len(QUESTION) :]
