"""A flood in a process of its own: the same datagrams round and round, at a given rate.

    python -m bench.attacks.flooder PORT RATE_HZ SENDERS < datagrams, one a line in hexadecimal

Prints ``begun`` once it sends, and, when its standard input ends, how many datagrams left.
"""

from __future__ import annotations

import select
import subprocess
import sys
import time
from collections.abc import Sequence

from bench.attacks.stage import udp_to

__all__ = ["Flood", "main"]

BURST_S = 0.002
"""Between two looks at the clock."""
END_S = 10.0


class Flood:
    """The process, from its first datagram on.

    Args:
        port: of this machine, that is flooded.
        rate_hz: datagrams a second.
        senders: addresses that they come from.
        datagrams: what is sent.
    """

    def __init__(self, port: int, rate_hz: float, senders: int, datagrams: Sequence[bytes]) -> None:
        words = [sys.executable, "-m", "bench.attacks.flooder", str(port), str(rate_hz), str(senders)]
        self._process = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        assert self._process.stdin is not None and self._process.stdout is not None
        self._process.stdin.write("".join(each.hex() + "\n" for each in datagrams) + "\n")
        self._process.stdin.flush()
        if self._process.stdout.readline().strip() != "begun":
            self._process.kill()
            raise RuntimeError("the flood did not begin")

    def end(self) -> int:
        """How many datagrams were sent."""
        try:
            return int(self._process.communicate(timeout=END_S)[0])
        except subprocess.TimeoutExpired:
            self._process.kill()
            raise


def _flood(port: int, rate_hz: float, senders: int, datagrams: Sequence[bytes]) -> int:
    """Until standard input ends."""
    sockets = [udp_to(port) for _ in range(senders)]
    sent = done = 0
    start_s = time.monotonic()
    while not select.select([sys.stdin], [], [], BURST_S)[0]:
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
