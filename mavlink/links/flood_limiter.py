"""Keeps floods from starving a UDP port: while they last, the kernel lets only a share of them pass.

Nobody is shut out for good. :mod:`mavlink.links.fair_shares` says how much of what is let in. As long as everybody is
let in whole there is no filter, and any error of the system ends in no filter.
"""

from __future__ import annotations

import socket
import struct
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace

from mavlink.links.batch import Sender
from mavlink.links.bpf import attach, detach, program
from mavlink.links.fair_shares import ALL_PER_S, HOLD_S, SENDER_PER_S, Allowance, Coming, Shares
from mavlink.links.peers import Peers

__all__ = ["STRANGERS", "TICK_S", "Gate", "Limit"]

TICK_S = 0.1
_LONG_S = 10.0
_SO_MEMINFO = 55
_MEMINFO = struct.Struct("=9I")
_QUEUED, _ROOM, _DROPS = 0, 1, 8
_FULL, _LATE = 0.75, 0.2
STRANGERS = -1
"""In the place of a system id: all strangers together."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Limit:
    """Somebody of whose datagrams not all are let in."""

    address: str
    """Host and port that they come from, or seem to; of strangers the one that most come from."""
    system_id: int
    """That they claim to be from, MIXED for those that are not one frame each, or STRANGERS."""
    wanted_per_s: float
    """How many come."""
    turned_away: int
    """How many of them were not let in, about."""
    refused: bool = False
    """Whether they are not believed, and so many that not all are recorded."""


class Gate:
    """Watches over one socket.

    Args:
        sock: UDP; a filter left on it by somebody else is taken off.
    """

    def __init__(self, sock: socket.socket) -> None:
        self._socket = sock
        self.shares = Shares()
        self.dropped = 0
        """Datagrams that the system threw away because nobody read them in time."""
        self.turned_away = 0
        """Datagrams that were not let in."""
        self.broken = False
        """Whether the system has no filters; then nobody is turned away."""
        self._since_s = self._now_s = 0.0
        self._attached: tuple[float, float, dict[Sender, float], int] | None = None
        self._fullest = 0.0
        self._counted = self._away = 0
        detach(sock)
        self._counted = self._drops()

    def look(self, hurry: bool) -> None:
        """Notes how full the socket is; to be called before it is read.

        Args:
            hurry: whether there was more than could be read at once before.
        """
        if hurry or self._attached is not None:
            memory = self._memory()
            self._fullest = max(self._fullest, memory[_QUEUED] / max(memory[_ROOM], 1))

    def due(self, now_s: float) -> bool:
        """Whether it is time to adapt."""
        return now_s - self._since_s >= TICK_S

    def relaxed(self, datagrams: int, busiest: Callable[[], int], dt_s: float) -> bool:
        """Whether so few came in a time that nobody who is known can have sent too many.

        Args:
            datagrams: of all together.
            busiest: counts those of one address at most; only asked where that matters.
            dt_s: in which they came.
        """
        if self.shares.own or self._fullest > _LATE or datagrams > min(ALL_PER_S, self.shares.read_per_s) * dt_s:
            return False
        return datagrams <= SENDER_PER_S * dt_s or busiest() <= SENDER_PER_S * dt_s

    def elapsed_s(self, now_s: float) -> float:
        """Time since the last :meth:`adapt`."""
        return min(max(now_s - self._since_s, TICK_S), _LONG_S)

    def adapt(self, now_s: float, dt_s: float, coming: Coming, peers: Peers) -> None:
        """Sets the shares from what came since the last time, and the filter from the shares.

        Args:
            now_s: monotonic.
            dt_s: in which that came.
            coming: what was let in since the last time.
            peers: who is known.
        """
        self._since_s = self._now_s = now_s
        self.count_drops()
        away, self._away = self.turned_away - self._away, self.turned_away
        late, self._fullest = self._fullest > _LATE, 0.0
        systems = peers.systems()
        self.shares.adapt(replace(coming, turned_away=away, late=late), systems, dt_s, now_s)
        self.shares.forget(now_s - HOLD_S, systems)
        self._apply(systems, peers)

    def limits(self, peers: Peers, strangers: str) -> Iterator[Limit]:
        """Who is not let in whole, or was not a moment ago.

        Args:
            peers: knows their addresses.
            strangers: where most strangers' datagrams come from.
        """
        classes = [part for part in (self.shares.likely, self.shares.other) if self._lasts(part)]
        if classes:
            yield _limit(strangers, STRANGERS, classes)
        for (number, kind), part in self.shares.own.items():
            if self._lasts(part):
                yield _limit(peers.address(number), kind, [part])

    def _lasts(self, part: Allowance) -> bool:
        return not self.broken and self._now_s - part.limited_s < HOLD_S

    def count_drops(self) -> None:
        """Tells what was lost from what was turned away: the kernel has one count for both."""
        drops = self._drops()
        new = (drops - self._counted) & 0xFFFFFFFF
        self._counted = drops
        lost = new if self._attached is None or self._fullest > _FULL else 0
        self.dropped += lost
        self.turned_away += new - lost

    def _apply(self, systems: Mapping[Sender, int], peers: Peers) -> None:
        likely, other = self.shares.likely.share, self.shares.other.share
        own = {sender: part.share for sender, part in self.shares.own.items() if part.share < 1.0}
        is_open = self.broken or (min(likely, other) >= 1.0 and not own)
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


def _limit(address: str, system_id: int, parts: list[Allowance]) -> Limit:
    wanted, away = sum(part.wanted_per_s for part in parts), sum(part.turned_away for part in parts)
    return Limit(address=address, system_id=system_id, wanted_per_s=wanted, turned_away=round(away))
