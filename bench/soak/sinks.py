"""Everybody who can be told of a flight, and what becomes of them: one hangs, one dies, one never reads."""

from __future__ import annotations

import contextlib
import itertools
import os
import signal
import socket
import threading
from collections.abc import Iterator

import psutil

from bench.ports import free_port

EVERY_S = 30.0
CONNECT_S = 1.0


class TroubledSinks:
    """Options that tell of a flight in every way, and a thread that stops, kills and starves those who are told.

    Attributes:
        words: for ``gcs fly``.
        stopped, killed: how many processes were.
    """

    def __init__(self) -> None:
        self._served = free_port(socket.SOCK_STREAM)
        tell = (
            f"json+udp://127.0.0.1:{free_port()}",
            f"json+tcp://127.0.0.1:{self._served}",
            f"cot+udp://127.0.0.1:{free_port()}",
            f"cot+tcp://127.0.0.1:{free_port(socket.SOCK_STREAM)}",  # nobody is there
            f"foxglove://127.0.0.1:{free_port(socket.SOCK_STREAM)}",
        )
        self.words = [word for url in tell for word in ("--publish", url)] + [
            "--stream",
            f"udp://127.0.0.1:{free_port()}",
        ]
        self.stopped = self.killed = 0
        self._over = threading.Event()
        self._threads: list[threading.Thread] = []

    def trouble(self, flight: int) -> None:
        """Begins, for the flight of that process id."""
        for work, words in ((self._starve, ()), (self._strike, (flight,))):
            self._threads.append(threading.Thread(target=work, args=words, daemon=True))
            self._threads[-1].start()

    def close(self) -> None:
        """Ends it."""
        self._over.set()
        for thread in self._threads:
            thread.join()

    def _strike(self, flight: int) -> None:
        """Stops one process and kills the next, time and again."""
        for turn in itertools.count():
            if self._over.wait(EVERY_S):
                return
            workers = list(_workers(flight))
            if len(workers) < 2:
                continue
            with contextlib.suppress(ProcessLookupError):
                os.kill(workers[turn % len(workers)], signal.SIGSTOP)
                self.stopped += 1
            with contextlib.suppress(ProcessLookupError):
                os.kill(workers[(turn + 1) % len(workers)], signal.SIGKILL)
                self.killed += 1

    def _starve(self) -> None:
        """A client that never reads, and comes again when it is dropped."""
        while not self._over.wait(CONNECT_S):
            with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", self._served), 5.0) as client:
                client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
                self._over.wait(EVERY_S)


def _workers(flight: int) -> Iterator[int]:
    """Processes of sinks, in the order in which they began."""
    with contextlib.suppress(psutil.Error):
        for child in sorted(psutil.Process(flight).children(), key=lambda child: child.create_time()):
            with contextlib.suppress(psutil.Error):
                if any("sink_worker" in word for word in child.cmdline()):
                    yield child.pid
