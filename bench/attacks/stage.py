"""Senders: packets in real time, each sender from a socket of its own."""

from __future__ import annotations

import heapq
import itertools
import math
import socket
import threading
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

Send = Callable[[bytes], object]
Party = tuple[str, int]
"""A role and a system id: whose packets are counted together."""
TRUE, FALSE = "true", "false"
PAUSE_S = 0.002
"""Packets leave in small bundles: waking for each would cost more than sending it."""


def udp_to(port: int, host: str = "127.0.0.1") -> socket.socket:
    """A sender with an address of its own."""
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sock.connect((host, port))
    return sock


class SenderFactory:
    """Makes senders to one UDP port of this machine: each call opens a socket with a source port of its own."""

    def __init__(self, port: int) -> None:
        self._port = port
        self._sockets: list[socket.socket] = []

    def __call__(self) -> Send:
        self._sockets.append(udp_to(self._port))
        return self._sockets[-1].send

    def close(self) -> None:
        """Closes all of them."""
        for sock in self._sockets:
            sock.close()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PacketSchedule:
    """Packets of one kind from one sender.

    ``make`` gets the time since the stage began and gives what leaves together; it is asked ``rate_hz`` times a second.
    """

    party: Party
    make: Callable[[float], Sequence[bytes]]
    send: Send
    rate_hz: float
    start_s: float = 0.0
    stop_s: float = math.inf
    silent_s: tuple[float, float] = (math.inf, math.inf)
    """Nothing leaves between these two times."""


@dataclass(slots=True)
class StageCounts:
    """What left."""

    start_us: int = 0
    """Unix µs when the stage began."""
    count: Counter[Party] = field(default_factory=Counter)
    first_s: dict[Party, float] = field(default_factory=dict)
    owners: defaultdict[bytes, Counter[Party]] = field(default_factory=lambda: defaultdict(Counter))
    """Who sent these bytes how often, in the order of the first time."""
    late_s: float = 0.0
    """Of the latest bundle: how busy this machine was."""
    refused: int = 0
    """Datagrams that the receiver's port refused; not among those counted."""


class Stage:
    """Sends scheduled packets until asked to stop.

    Args:
        lines: what is sent.
        tap: called with every packet and the time since the beginning.
    """

    def __init__(
        self, lines: Sequence[PacketSchedule], tap: Callable[[float, Party, bytes], None] | None = None
    ) -> None:
        self.sent = StageCounts()
        self._lines, self._tap = lines, tap
        self._stop = threading.Event()
        self._failed: BaseException | None = None
        self._thread = threading.Thread(target=self._guard, name="stage", daemon=True)
        self._begun_s = 0.0

    def start(self) -> None:
        """Begin in a thread of its own."""
        self.sent.start_us, self._begun_s = time.time_ns() // 1000, time.monotonic()
        self._thread.start()

    @property
    def now_s(self) -> float:
        """Since the beginning."""
        return time.monotonic() - self._begun_s

    def wait(self, until_s: float) -> None:
        """Until this time since the beginning."""
        while (left_s := until_s - self.now_s) > 0.0:
            self._thread.join(min(left_s, 0.2))
            if self._failed is not None:
                raise self._failed
            if not self._thread.is_alive():
                time.sleep(max(until_s - self.now_s, 0.0))

    def stop(self) -> StageCounts:
        """End the lines."""
        self._stop.set()
        self._thread.join()
        if self._failed is not None:
            raise self._failed
        return self.sent

    def _guard(self) -> None:
        try:
            self._play()
        except Exception as error:  # noqa: BLE001 - raised again for whoever waits
            self._failed = error

    def _play(self) -> None:
        order = itertools.count()
        due = [(line.start_s, next(order), line) for line in self._lines]
        heapq.heapify(due)
        while due and not self._stop.is_set():
            at_s, _, line = due[0]
            wait_s = at_s - self.now_s
            if wait_s > 0.0:
                self._stop.wait(max(wait_s, PAUSE_S))
                continue
            if at_s >= line.stop_s:
                heapq.heappop(due)
                continue
            heapq.heapreplace(due, (at_s + 1.0 / line.rate_hz, next(order), line))
            self.sent.late_s = max(self.sent.late_s, -wait_s)
            if not line.silent_s[0] <= at_s < line.silent_s[1]:
                self._send(line, at_s)

    def _send(self, line: PacketSchedule, at_s: float) -> None:
        for raw in line.make(at_s):
            try:
                line.send(raw)
            except (ConnectionRefusedError, BlockingIOError):
                self.sent.refused += 1
                continue
            self.sent.count[line.party] += 1
            self.sent.first_s.setdefault(line.party, at_s)
            self.sent.owners[raw][line.party] += 1
            if self._tap is not None:
                self._tap(at_s, line.party, raw)
