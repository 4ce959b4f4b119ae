"""Forwarding: what the links bring goes out to other programs as it came, and what they answer goes back if it may.

Bytes are never touched: no frame is made anew, re-signed or put in another order. A frame goes back only to links where
its target was heard, never to one that has brought nothing. It is a loop, and dropped, when it is a frame that went out
to that place a moment ago, or when its sender is one of the vehicles or this station: those are not behind an output.
The same frame from a link twice in a moment goes out once, or an output that leads back to a link would never rest.
SETUP_SIGNING carries a key and never passes, in either direction.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace

from mavlink.dialect import DEFINITIONS
from mavlink.errors import LinkError
from mavlink.forward_out import Output, open_output
from mavlink.packet import Auth, Packet
from mavlink.target import target_of

__all__ = ["Forwarder", "OutputCounts"]

SETUP_SIGNING = 256
ECHO_S = 2.0
"""For how long a frame that comes back is known to be our own; shorter than a sequence number takes to come around."""
REPEAT_S = 0.25
"""For how long a frame from a link is known to have gone out; short, as heartbeats are equal at some message rates."""
_ECHOES = 50_000
HEARD_US = 60_000_000
"""For how long a system is looked for on a link after it was heard there."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OutputCounts:
    """What passed one output."""

    name: str
    sent: int = 0
    dropped: int = 0
    """Not taken: nobody there, or too slow."""
    withheld: int = 0
    """Refused for their signature, a key, or a copy."""
    returned: int = 0
    """Came back and went on to a link."""
    stopped: int = 0
    """Came back and went nowhere: read-only, loops, unknown messages, targets nobody has heard."""


class Forwarder:
    """Copies packets to outputs, and frames from outputs to links. It never waits.

    Args:
        outs: URLs, each a link URL (`udpout:127.0.0.1:14551`) with `?ro` or `?rw` behind it or neither.
        write_back: whether an output without `?ro` or `?rw` may speak to the vehicles.
        refused: whether packets whose signature was refused go out too.
        vehicles: system ids that are never behind an output.
        own: this station's system id.
        clock: seconds, monotonic.

    Raises:
        LinkError: an output cannot be opened; none is left open.
    """

    def __init__(
        self,
        outs: Sequence[str],
        *,
        write_back: bool = False,
        refused: bool = False,
        vehicles: Collection[int] = (),
        own: int = 0,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._refused = refused
        self._not_behind = frozenset(vehicles) | {own}
        self._heard: dict[int, dict[int, int]] = {}
        self._links: dict[int, None] = {}
        self._now_us = 0
        self._places: list[_Place] = []
        try:
            for out in outs:
                url, writes = _parsed(out, write_back)
                self._places.append(_Place(open_output(url), writes, clock))
        except BaseException:
            self.close()
            raise

    @property
    def counts(self) -> tuple[OutputCounts, ...]:
        """What passed each output."""
        return tuple(place.counts for place in self._places)

    @property
    def files(self) -> tuple[int, ...]:
        """File descriptors to wait for; they change as receivers come and go."""
        return tuple(file for place in self._places for file in place.output.files)

    def take(self, packets: Sequence[Packet], send: Callable[[int, bytes], None]) -> None:
        """Forwards packets in order, and what came back from outputs to links.

        Args:
            packets: as the links brought them, verified; none is fine.
            send: given the number of a link and a frame for it; its LinkError costs that frame.
        """
        for packet in packets:
            self._learn(packet)
            secret = packet.message_id == SETUP_SIGNING or (packet.auth > Auth.GOOD and not self._refused)
            for place in self._places:
                place.withhold() if secret else place.forward(packet.raw)
        for link, raw in self.poll():
            try:
                send(link, raw)
            except LinkError:
                continue  # the link says so itself

    def poll(self) -> Iterator[tuple[int, bytes]]:
        """What came back from outputs and may go on: the link and the frame."""
        for place in self._places:
            for raw in place.output.read():
                links = self._route(place, raw)
                place.came_back(raw, passed=bool(links))
                yield from ((link, raw) for link in links)

    def close(self) -> None:
        """Closes every output."""
        for place in self._places:
            place.output.close()

    def _learn(self, packet: Packet) -> None:
        if packet.auth <= Auth.GOOD:
            self._now_us = max(self._now_us, packet.t_us)
            self._links[packet.link] = None
            self._heard.setdefault(packet.system_id, {})[packet.link] = packet.t_us

    def _route(self, place: _Place, raw: bytes) -> list[int]:
        """Links that a frame from an output goes to."""
        packet = Packet(0, raw)
        known = packet.message_id in DEFINITIONS and packet.message_id != SETUP_SIGNING
        if not place.writes or not known or packet.system_id in self._not_behind or place.is_echo(raw):
            return []
        system, _ = target_of(raw)
        if system == 0:
            return list(self._links)
        since_us = self._now_us - HEARD_US
        return [link for link, t_us in self._heard.get(system, {}).items() if t_us >= since_us]


class _Place:
    """One output, its counts and what went to and fro lately."""

    def __init__(self, output: Output, writes: bool, clock: Callable[[], float]) -> None:
        self.output = output
        self.writes = writes
        self.counts = OutputCounts(name=output.name)
        self._sent, self._came = _Lately(clock, ECHO_S), _Lately(clock, ECHO_S)
        self._latest = _Lately(clock, REPEAT_S)

    def forward(self, raw: bytes) -> None:
        """Sends a frame unless it came from here: a vehicle repeats on its links what a station tells it."""
        if self._came.has(raw) or self._latest.has(raw):
            self.withhold()
            return
        self._latest.add(raw)
        if not self.output.write(raw):
            self.counts = replace(self.counts, dropped=self.counts.dropped + 1)
            return
        self.counts = replace(self.counts, sent=self.counts.sent + 1)
        if self.writes:
            self._sent.add(raw)

    def withhold(self) -> None:
        self.counts = replace(self.counts, withheld=self.counts.withheld + 1)

    def is_echo(self, raw: bytes) -> bool:
        return self._sent.has(raw)

    def came_back(self, raw: bytes, *, passed: bool) -> None:
        if passed:
            self._came.add(raw)
            self.counts = replace(self.counts, returned=self.counts.returned + 1)
        else:
            self.counts = replace(self.counts, stopped=self.counts.stopped + 1)


class _Lately:
    """Frames of the last moment and of up to one more, in two bins that take turns."""

    def __init__(self, clock: Callable[[], float], moment_s: float) -> None:
        self._clock = clock
        self._moment_s = moment_s
        self._now: set[bytes] = set()
        self._before: set[bytes] = set()
        self._turn_s = clock() + moment_s

    def add(self, raw: bytes) -> None:
        self._turn()
        self._now.add(raw)

    def has(self, raw: bytes) -> bool:
        self._turn()
        return raw in self._now or raw in self._before

    def _turn(self) -> None:
        now_s = self._clock()
        if now_s < self._turn_s and len(self._now) < _ECHOES:
            return
        self._before = self._now if now_s < self._turn_s + self._moment_s else set()
        self._now = set()
        self._turn_s = now_s + self._moment_s


def _parsed(out: str, write_back: bool) -> tuple[str, bool]:
    """The URL, and whether it may speak to the vehicles."""
    url, mark, option = out.partition("?")
    if not mark:
        return url, write_back
    if option not in ("ro", "rw"):
        raise LinkError(f"{out!r}: {option!r} is no option of an output; write ?ro (only listens) or ?rw (may command)")
    return url, option == "rw"
