"""A pseudo terminal at the end of a line: it takes everything at once, and shows it at the line's rate.

So it is with SSH: what a program has written is out of its hands, and waits in queues that it cannot see.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import pty
import re
import select
import struct
import subprocess
import sys
import termios
import threading
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

STEP_S = 0.005
QUESTIONS = {b"\x1b[5n": b"\x1b[0n", b"\x1b[c": b"\x1b[?64;1;2;6;22c", b"\x1b[?2026$p": b"\x1b[?2026;2$y"}
"""What is asked of this terminal, and what it replies."""
NOT_PASSED = ("COLUMNS", "LINES", "TMUX", "STY", "SSH_CONNECTION", "TERM_PROGRAM", "VTE_VERSION")
"""Of whoever starts this: not of this terminal."""
IN_SESSION = """
import fcntl, os, sys, termios
os.setsid()
fcntl.ioctl(0, termios.TIOCSCTTY, 0)
os.execv(sys.argv[1], sys.argv[1:])
"""


class SlowTerminal:
    """A program on a terminal of its own, with a thread that is the line.

    Args:
        words: the program and its arguments.
        size: columns and rows.
        bytes_per_s: the line's rate, None for one without limit.
        delay_s: the line's delay, each way.
        replies: whether the terminal answers questions.
        lookahead: bytes that the line takes before they are shown, None for all that there are.
        controls: whether the program is hung up when the terminal goes away; else it is as under nohup.
        environment: beside the usual variables.
        folder: where the program runs.
    """

    def __init__(
        self,
        words: Sequence[object],
        *,
        size: tuple[int, int] = (120, 40),
        bytes_per_s: float | None = None,
        delay_s: float = 0.0,
        replies: bool = True,
        lookahead: int | None = None,
        controls: bool = True,
        environment: Mapping[str, str] | None = None,
        folder: Path | None = None,
    ) -> None:
        self._rate, self._delay_s, self._replies = bytes_per_s, delay_s, replies
        self._lookahead = lookahead
        self.keeper, child = pty.openpty()
        fcntl.ioctl(child, termios.TIOCSWINSZ, struct.pack("4H", size[1], size[0], 10 * size[0], 20 * size[1]))
        variables = {name: value for name, value in os.environ.items() if name not in NOT_PASSED}
        self.process = subprocess.Popen(
            [*((sys.executable, "-c", IN_SESSION) if controls else ()), *map(str, words)],
            start_new_session=not controls,
            stdin=child,
            stdout=child,
            stderr=child,
            cwd=folder,
            env={**variables, "TERM": "xterm-256color", "COLORTERM": "truecolor", **(environment or {})},
        )
        os.close(child)
        self.shown = bytearray()
        self.written = 0
        """Bytes that the program has written; what of them is not shown is queued."""
        self._queue: list[tuple[float, bytes]] = []
        self._changed = threading.Condition()
        self._line = threading.Thread(target=self._carry, daemon=True)
        self._line.start()

    @property
    def queued(self) -> int:
        """Bytes between the program and the screen."""
        return self.written - len(self.shown)

    def press(self, keys: bytes) -> int:
        """Type; returns how much was shown until then."""
        with self._changed:
            at = len(self.shown)
        os.write(self.keeper, keys)
        return at

    def wait_for(self, word: bytes, since: int = 0, timeout_s: float = 60.0) -> float:
        """Seconds until a word is shown.

        Raises:
            TimeoutError: it is not.
        """
        began, at = time.monotonic(), since
        with self._changed:
            while self.shown.find(word, at) < 0:
                at = max(since, len(self.shown) - len(word) + 1)
                left_s = began + timeout_s - time.monotonic()
                if left_s <= 0 or not self._line.is_alive():
                    raise TimeoutError(f"{word!r} is not shown: {bytes(self.shown[-400:])!r}")
                self._changed.wait(min(left_s, 0.5))
        return time.monotonic() - began

    def close(self) -> None:
        """The terminal goes away; who writes or reads there finds out."""
        keeper, self.keeper = self.keeper, -1
        if keeper >= 0:
            os.close(keeper)
            self._line.join(5)

    def end(self) -> None:
        """End the program too, if it has not."""
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()
        self.close()

    def _carry(self) -> None:
        credit, before = 0.0, time.monotonic()
        with contextlib.suppress(OSError, ValueError):
            while self.keeper >= 0:
                open_to_more = self._lookahead is None or self.queued < self._lookahead
                if select.select([self.keeper] * open_to_more, [], [], STEP_S)[0]:
                    data = os.read(self.keeper, self._lookahead or 65_536)
                    self.written += len(data)
                    self._queue.append((time.monotonic() + self._delay_s, data))
                now = time.monotonic()
                if self._rate is None:
                    self._show(sys.maxsize, now)
                else:
                    # what an idle line could have carried is gone, but for the time between two looks
                    most = max(4 * STEP_S * self._rate, 1.0)
                    credit = min(credit + (now - before) * self._rate, most)
                    credit -= self._show(int(credit), now)
                before = now

    def _show(self, room: int, now: float) -> int:
        """Let so many bytes arrive; returns how many did."""
        took = 0
        while self._queue and self._queue[0][0] <= now and took < room:
            due, data = self._queue.pop(0)
            part = data[: room - took]
            if len(part) < len(data):
                self._queue.insert(0, (due, data[len(part) :]))
            took += len(part)
            with self._changed:
                known = len(self.shown)
                self.shown += part
                self._changed.notify_all()
            if self._replies:
                self._reply(max(0, known - 12), known)
        return took

    def _reply(self, start: int, known: int) -> None:
        for found in re.finditer(b"|".join(map(re.escape, QUESTIONS)), self.shown[start:]):
            if start + found.end() > known:
                answer = QUESTIONS[found.group()]
                if self._delay_s:
                    threading.Timer(self._delay_s, self._type, (answer,)).start()
                else:
                    self._type(answer)

    def _type(self, data: bytes) -> None:
        with contextlib.suppress(OSError):
            os.write(self.keeper, data)
