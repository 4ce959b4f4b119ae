"""Senders: packets in real time, each sender from a socket of its own, and floods from a process of their own."""

from __future__ import annotations

import heapq
import itertools
import math
import select
import socket
import subprocess
import sys
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
FLOOD_END_S = 10.0


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


class Flood:
    """A flood in a process of its own, from its first datagram on: the same datagrams round and round, at a given rate.

        python -m bench.attacks.stage PORT RATE_HZ SENDERS < datagrams, one a line in hexadecimal

    It prints ``begun`` once it sends, and, when its standard input ends, how many datagrams left.

    Args:
        port: of this machine, that is flooded.
        rate_hz: datagrams a second.
        senders: addresses that they come from.
        datagrams: what is sent.
    """

    def __init__(self, port: int, rate_hz: float, senders: int, datagrams: Sequence[bytes]) -> None:
        words = [sys.executable, "-m", "bench.attacks.stage", str(port), str(rate_hz), str(senders)]
        self._process = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        assert self._process.stdin is not None and self._process.stdout is not None
        self._process.stdin.write("".join(each.hex() + "\n" for each in datagrams) + "\n")
        self._process.stdin.flush()
        if self._process.stdout.readline().strip() != "begun":
            self._process.kill()
            raise RuntimeError("the flood did not begin")

    def end(self) -> int:
        """End the flood, and return how many datagrams were sent."""
        try:
            return int(self._process.communicate(timeout=FLOOD_END_S)[0])
        except subprocess.TimeoutExpired:
            self._process.kill()
            raise


def _flood(port: int, rate_hz: float, senders: int, datagrams: Sequence[bytes]) -> int:
    """Until standard input ends."""
    sockets = [udp_to(port) for _ in range(senders)]
    sent = done = 0
    start_s = time.monotonic()
    while not select.select([sys.stdin], [], [], PAUSE_S)[0]:
        # what a busy machine held up for more than a moment is left out: a flood has no backlog
        due = int((time.monotonic() - start_s) * rate_hz)
        for number in range(max(done, due - int(rate_hz * 0.1)), due):
            try:
                sockets[number % senders].send(datagrams[number % len(datagrams)])
                sent += 1
            except ConnectionRefusedError:
                continue
        done = due
    for sock in sockets:
        sock.close()
    return sent


def main() -> None:
    port, rate_hz, senders = int(sys.argv[1]), float(sys.argv[2]), int(sys.argv[3])
    datagrams = []
    while line := sys.stdin.readline().strip():
        datagrams.append(bytes.fromhex(line))
    print("begun", flush=True)
    print(_flood(port, rate_hz, senders, datagrams), flush=True)


if __name__ == "__main__":
    main()
