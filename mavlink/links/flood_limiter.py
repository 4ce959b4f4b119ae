"""Keeps floods from starving a UDP port: while one lasts, a filter in the kernel lets only a share of it pass.

No sender is shut out for good. :mod:`mavlink.links.fair_shares` computes the shares. There is no filter while all
datagrams pass, nor after any error of the system.
"""

from __future__ import annotations

import socket
import struct
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace

from mavlink.links.batch import Sender
from mavlink.links.bpf import attach, detach, program
from mavlink.links.fair_shares import ALL_PER_S, HOLD_S, SENDER_PER_S, Allowance, PassedTraffic, Shares
from mavlink.links.peers import Peers

TICK_S = 0.1
"""Seconds between two updates of the shares."""
_LONG_S = 10.0
"""A longer time since the last update counts as this."""
_SO_MEMINFO = 55
_MEMINFO = struct.Struct("=9I")
_QUEUED, _ROOM, _DROPS = 0, 1, 8
"""Places in it: bytes queued, size of the receive buffer, datagrams dropped."""
_FULL, _LATE = 0.75, 0.2
"""Fill of the receive buffer from which on drops are losses and not the filter's, and from which on reading is late."""
STRANGERS = -1
"""Number in place of a system id for all unknown senders together."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FloodLimit:
    """A sender of whose datagrams only a share passes."""

    address: str
    """Host and port that they seem to come from; of unknown senders the one that most come from."""
    system_id: int
    """System id that they carry, MIXED for datagrams that are not one frame each, or STRANGERS."""
    wanted_per_s: float
    """Datagrams that arrive."""
    turned_away: int
    """Estimated number of them that were dropped by the filter."""
    refused: bool = False
    """True if their signatures are refused, and they are so many that not all are recorded."""


class FloodLimiter:
    """Limits floods of one socket.

    Args:
        sock: UDP; a filter that another process left on it is removed.
    """

    def __init__(self, sock: socket.socket) -> None:
        self._socket = sock
        self.shares = Shares()
        self.dropped = 0
        """Datagrams that the system dropped because they were not read in time."""
        self.turned_away = 0
        """Datagrams that the filter dropped."""
        self.is_unsupported = False
        """True if the system has no such filters; then everything passes."""
        self._since_s = self._now_s = 0.0
        self._attached: tuple[float, float, dict[Sender, float], int] | None = None
        self._fullest = 0.0
        self._counted = self._away = 0
        detach(sock)
        self._counted = self._drops()

    @property
    def system_drops(self) -> int:
        """The system's count of what the socket dropped, up to the last time it was asked."""
        return self._counted

    def resume(self, system_drops: int, *, was_limited: bool) -> None:
        """Count what the socket has dropped since another process last counted: that one may have hung for long.

        Args:
            was_limited: whether a filter was at work; it went on while nobody read.
        """
        new = max(self._counted - system_drops, 0)
        memory = self._memory()
        lost = new if not was_limited or memory[_QUEUED] > _FULL * memory[_ROOM] else 0
        self.dropped += lost
        self.turned_away += new - lost

    def note_fill(self, was_full: bool) -> None:
        """Note how full the receive buffer is; to be called before it is read.

        Args:
            was_full: whether the read before brought as many as it could.
        """
        if was_full or self._attached is not None:
            memory = self._memory()
            self._fullest = max(self._fullest, memory[_QUEUED] / max(memory[_ROOM], 1))

    def due(self, now_s: float) -> bool:
        """Tell whether it is time to adapt."""
        return now_s - self._since_s >= TICK_S

    def is_calm(self, datagrams: int, busiest: Callable[[], int], dt_s: float) -> bool:
        """Tell whether so few came in a time that no known sender can be over its limit.

        Args:
            busiest: counts those of one address at most; only asked where that matters.
            dt_s: in which they came.
        """
        if self.shares.limited or self._fullest > _LATE or datagrams > min(ALL_PER_S, self.shares.read_per_s) * dt_s:
            return False
        return datagrams <= SENDER_PER_S * dt_s or busiest() <= SENDER_PER_S * dt_s

    def elapsed_s(self, now_s: float) -> float:
        """Time since the last :meth:`adapt`."""
        return min(max(now_s - self._since_s, TICK_S), _LONG_S)

    def adapt(self, now_s: float, dt_s: float, traffic: PassedTraffic, peers: Peers) -> None:
        """Set the shares from what came since the last time, and the filter from the shares.

        Args:
            now_s: monotonic.
            dt_s: in which that came.
            traffic: what was let in since the last time.
        """
        self._since_s = self._now_s = now_s
        self.count_drops()
        away, self._away = self.turned_away - self._away, self.turned_away
        late, self._fullest = self._fullest > _LATE, 0.0
        systems = peers.systems()
        self.shares.adapt(replace(traffic, turned_away=away, late=late), systems, dt_s, now_s)
        self.shares.forget(now_s - HOLD_S, systems)
        self._apply(systems, peers)

    def limits(self, peers: Peers, strangers: str) -> Iterator[FloodLimit]:
        """Senders of which only a share passes, or did a moment ago.

        Args:
            strangers: where most strangers' datagrams come from.
        """
        classes = [part for part in (self.shares.likely, self.shares.other) if self._is_recent(part)]
        if classes:
            yield _limit(strangers, STRANGERS, classes)
        for (number, kind), part in self.shares.limited.items():
            if self._is_recent(part):
                yield _limit(peers.address(number), kind, [part])

    def _is_recent(self, part: Allowance) -> bool:
        return not self.is_unsupported and self._now_s - part.limited_s < HOLD_S

    def count_drops(self) -> None:
        """Add new drops to the losses or to the filter's: the kernel has one count for both."""
        drops = self._drops()
        new = (drops - self._counted) & 0xFFFFFFFF
        self._counted = drops
        lost = new if self._attached is None or self._fullest > _FULL else 0
        self.dropped += lost
        self.turned_away += new - lost

    def _apply(self, systems: Mapping[Sender, int], peers: Peers) -> None:
        likely, other = self.shares.likely.share, self.shares.other.share
        own = {sender: part.share for sender, part in self.shares.limited.items() if part.share < 1.0}
        is_open = self.is_unsupported or (min(likely, other) >= 1.0 and not own)
        wanted = None if is_open else (likely, other, own, peers.changes)
        if wanted == self._attached:
            return
        try:
            if wanted is None:
                detach(self._socket)
            else:
                sources = {peers.source(sender): share for sender, share in own.items()}
                attach(self._socket, program(map(peers.source, systems), sources, likely, other))
            self._attached = wanted
        except (OSError, ValueError):
            self.is_unsupported = True
            self._attached = None
            detach(self._socket)

    def _memory(self) -> tuple[int, ...]:
        try:
            return _MEMINFO.unpack(self._socket.getsockopt(socket.SOL_SOCKET, _SO_MEMINFO, _MEMINFO.size))
        except (OSError, struct.error):
            return (0,) * 9  # an older kernel, or another system: drops then go uncounted

    def _drops(self) -> int:
        return self._memory()[_DROPS]


def _limit(address: str, system_id: int, parts: list[Allowance]) -> FloodLimit:
    wanted, away = sum(part.wanted_per_s for part in parts), sum(part.turned_away for part in parts)
    return FloodLimit(address=address, system_id=system_id, wanted_per_s=wanted, turned_away=round(away))
