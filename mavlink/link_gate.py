"""Keeps strangers from starving a UDP port: while they flood, the kernel lets only a share of them pass.

Nobody is shut out for good. The share follows the rate that is let in, s in a time dt at share p, towards the rate that
is wanted, R:

    p' = min(1, p · min(2, R · dt / s))

so it falls at once and opens again by doubling. At p = 1 there is no filter. Any error of the system ends in no filter.
"""

from __future__ import annotations

import socket
import struct
from collections.abc import Callable

from mavlink.link_filter import Address, attach, detach, program

__all__ = ["Gate"]

LIKELY_PER_S, OTHER_PER_S = 5000.0, 200.0
"""Strangers' datagrams wanted: those that look like a frame may be a vehicle that has just rebooted."""
TICK_S = 0.1
BURST_S = 0.5
"""So many seconds' worth may come at once before the gate narrows."""
_SO_MEMINFO = 55
_MEMINFO = struct.Struct("=9I")
_QUEUED, _ROOM, _DROPS = 0, 1, 8
_FULL = 0.75
_LEAST = 1e-6


class Gate:
    """Watches over one socket.

    Args:
        sock: UDP; a filter left on it by somebody else is taken off.
    """

    def __init__(self, sock: socket.socket) -> None:
        self._socket = sock
        self.shares = (1.0, 1.0)
        """Of strangers' datagrams that look like one frame and of others, now."""
        self.dropped = 0
        """Datagrams that the system threw away because nobody read them in time."""
        self.turned_away = 0
        """Datagrams of strangers that were not let in."""
        self.broken = False
        """Whether the system has no filters; then nobody is turned away."""
        self._seen = [0, 0]
        self._since_s = 0.0
        self._attached: tuple[tuple[float, float], int] | None = None
        self._fullest = 0.0
        self._counted = 0
        detach(sock)
        self._counted = self._drops()

    @property
    def narrow(self) -> bool:
        """Whether strangers are being turned away."""
        return self._attached is not None

    def look(self) -> None:
        """Notes how full the socket is; to be called before it is read."""
        if self._attached is not None:
            memory = self._memory()
            self._fullest = max(self._fullest, memory[_QUEUED] / max(memory[_ROOM], 1))

    def strangers(self, likely: int, other: int, now_s: float) -> bool:
        """Counts strangers' datagrams that were let in; returns whether they are too many to wait for the next tick."""
        self._seen[0] += likely
        self._seen[1] += other
        budget_s = BURST_S + max(now_s - self._since_s, 0.0)
        return self._seen[0] > LIKELY_PER_S * budget_s or self._seen[1] > OTHER_PER_S * budget_s

    def due(self, now_s: float) -> bool:
        """Whether it is time to adapt."""
        return now_s - self._since_s >= TICK_S

    def adapt(self, now_s: float, peers: Callable[[], list[Address]], version: int) -> None:
        """Sets the shares from what came since the last time, and the filter from the shares.

        Args:
            now_s: monotonic.
            peers: tells who always passes.
            version: another number whenever that is another set.
        """
        dt = min(max(now_s - self._since_s, 1e-3), 1.0)
        self.shares = (
            _next(self.shares[0], self._seen[0], LIKELY_PER_S * dt, self._burst(LIKELY_PER_S)),
            _next(self.shares[1], self._seen[1], OTHER_PER_S * dt, self._burst(OTHER_PER_S)),
        )
        self._seen = [0, 0]
        self._since_s = now_s
        self.count_drops()
        self._apply(peers, version)

    def count_drops(self) -> None:
        """Tells what was lost from what was turned away: the kernel has one count for both."""
        drops = self._drops()
        new = (drops - self._counted) & 0xFFFFFFFF
        self._counted = drops
        if self._attached is None or self._fullest > _FULL:
            self.dropped += new
        else:
            self.turned_away += new
        self._fullest = 0.0

    def _burst(self, rate: float) -> float:
        return 0.0 if self._attached is not None else rate * BURST_S

    def _apply(self, peers: Callable[[], list[Address]], version: int) -> None:
        wanted = None if self.broken or min(self.shares) >= 1.0 else (self.shares, version)
        if wanted == self._attached:
            return
        try:
            if wanted is None:
                detach(self._socket)
            else:
                attach(self._socket, program(peers(), *self.shares))
            self._attached = wanted
        except (OSError, ValueError):
            self.broken = True
            self._attached = None
            detach(self._socket)

    def _memory(self) -> tuple[int, ...]:
        try:
            return _MEMINFO.unpack(self._socket.getsockopt(socket.SOL_SOCKET, _SO_MEMINFO, _MEMINFO.size))
        except (OSError, struct.error):
            return (0,) * 9  # an older kernel, or another system: drops then go uncounted

    def _drops(self) -> int:
        return self._memory()[_DROPS]


def _next(share: float, seen: int, wanted: float, burst: float) -> float:
    """The next share of a class."""
    if seen <= wanted + burst and share >= 1.0:
        return 1.0
    return min(1.0, max(_LEAST, share * min(2.0, wanted / max(seen, 1))))
