"""A program in a terminal of its own: what it writes, and when; keys are typed into it."""

from __future__ import annotations

import fcntl
import os
import pty
import select
import signal
import struct
import subprocess
import termios
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from types import TracebackType
from typing import Self

import psutil

from bench.screens.terminal import TerminalScreen

LONGEST_S = 60.0
"""Nothing that is waited for takes longer."""
READ_BYTES = 1 << 16


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
        """What came, with the monotonic time."""
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
        """When the screen first was as wanted, monotonic seconds; inf if it was not in time."""
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
        while self.process.poll() is None or select.select([self._main], [], [], 0)[0]:
            if not select.select([self._main], [], [], 0.2)[0]:
                continue
            try:
                data = os.read(self._main, READ_BYTES)
            except OSError:  # the other end is closed
                return
            self.written.append((time.monotonic(), data))
