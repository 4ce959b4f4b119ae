"""Forwarding: what the links bring goes out to other programs as it came, and what they answer goes back if it may.

Bytes are never touched: no frame is made anew, re-signed or put in another order. Nothing goes back but from an output
with `?rw`, and then:

- a frame that is addressed to the UAV, or to a vehicle that is named (`?rw=11,12`), and only to the address where that
  one was heard;
- HEARTBEAT and TIMESYNC, which carry no order, to those addresses at which nobody else is heard;
- anything else that is for everybody only where every vehicle of the mission is named.

It is a loop, and dropped, when it is a frame that went out to that place a moment ago, or when its sender is one of the
vehicles or this station: those are not behind an output. The same frame from a link twice in a moment goes out once, or
an output that leads back to a link would never rest. SETUP_SIGNING carries a key and never passes, in either direction.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace

from pymavlink.dialects.v20 import ardupilotmega

from mavlink.errors import LinkError
from mavlink.forwarding.outputs import Output, open_output
from mavlink.protocol.addressing import target_of
from mavlink.protocol.dialect import DEFINITIONS, message_name
from mavlink.protocol.packet import Auth, Packet

__all__ = ["HARMLESS", "OUTPUT_OPTIONS", "Forwarder", "OutputCounts", "Said", "parse_output"]

SETUP_SIGNING = 256
HARMLESS = ("HEARTBEAT", "TIMESYNC")
"""Messages for everybody that carry no order."""
_COMMANDS = (75, 76)  # COMMAND_INT, COMMAND_LONG
_COMMAND_AT = 28
"""Byte of both at which the number of the command stands."""
ECHO_S = 2.0
"""For how long a frame that comes back is known to be our own; shorter than a sequence number takes to come around."""
REPEAT_S = 0.25
"""For how long a frame from a link is known to have gone out; short, as heartbeats are equal at some message rates."""
_ECHOES = 50_000
HEARD_US = 60_000_000
"""For how long a system is looked for where it was heard."""
_MOST_HEARD = 4096
MOST_SAID = 24
"""Different things said that are counted apart, each a line of the health; the rest is summed up."""
OUTPUT_OPTIONS = "?ro (only listens), ?rw (may speak to the UAV) or ?rw=11,12 (to these vehicles too)"
_ONLY_LISTENS = "this output only listens; ?rw behind its address lets it speak to the UAV"


@dataclass(frozen=True, slots=True, kw_only=True)
class Said:
    """What a program behind an output said, as often as it said the like."""

    who: str
    """Its address; empty for all those that are not counted apart."""
    what: str
    """Message and command; empty for whatever it says to an output that only listens."""
    whom: int
    """System id that it was for, 0 for everybody."""
    why: str
    """Why it went no further; empty: it was sent on."""
    count: int = 0


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
    """Came back and went on to a vehicle."""
    stopped: int = 0
    """Came back and went nowhere."""
    said: tuple[Said, ...] = ()
    """What came back, but for loops."""


class Forwarder:
    """Copies packets to outputs, and frames from outputs to vehicles. It never waits.

    Args:
        outs: URLs, each a link URL (`udpout:127.0.0.1:14551`) with `?ro`, `?rw` or `?rw=11,12` behind it, or nothing,
            which is `?ro`.
        uav: system id of the UAV, to which `?rw` lets a program speak; 0: none.
        refused: whether packets whose signature was refused go out too.
        vehicles: system ids of the mission: they are never behind an output.
        own: this station's system id.
        clock: seconds, monotonic.

    Raises:
        LinkError: an output cannot be opened; none is left open.
    """

    def __init__(
        self,
        outs: Sequence[str],
        *,
        uav: int = 0,
        refused: bool = False,
        vehicles: Collection[int] = (),
        own: int = 0,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._refused = refused
        self._not_behind = frozenset(vehicles) | {own}
        self._vehicles = frozenset(vehicles) | ({uav} - {0})
        self._heard: dict[tuple[int, int, int], int] = {}
        self._now_us = 0
        self._places: list[_Place] = []
        try:
            for out in outs:
                url, named = parse_output(out)
                allowed = named if named is None else (named | {uav}) - {0}
                self._places.append(_Place(open_output(url), allowed, clock))
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

    def take(self, packets: Sequence[Packet], send: Callable[[int, bytes, int], None]) -> None:
        """Forwards packets in order, and what came back from outputs to vehicles.

        Args:
            packets: as the links brought them, verified; none is fine.
            send: given the number of a link, a frame for it, and the number of the sender there who is to get it; its
                LinkError costs that frame.
        """
        for packet in packets:
            self._learn(packet)
            secret = packet.message_id == SETUP_SIGNING or (packet.auth > Auth.GOOD and not self._refused)
            for place in self._places:
                place.withhold() if secret else place.forward(packet.raw)
        for link, raw, peer in self.poll():
            try:
                send(link, raw, peer)
            except LinkError:
                continue  # the link says so itself

    def poll(self) -> Iterator[tuple[int, bytes, int]]:
        """What came back from outputs and may go on: the link, the frame, and the sender there who is to get it."""
        for place in self._places:
            for raw, who in place.output.read():
                if self._is_loop(place, raw):
                    place.stop()
                    continue
                target = target_of(raw)[0]
                ways, why = self._route(place, raw, target)
                place.came_back(raw, who, target, why)
                yield from ((link, raw, peer) for link, peer in sorted(ways))

    def close(self) -> None:
        """Closes every output."""
        for place in self._places:
            place.output.close()

    def _learn(self, packet: Packet) -> None:
        if packet.auth <= Auth.GOOD:
            self._now_us = max(self._now_us, packet.t_us)
            self._heard[packet.system_id, packet.link, packet.peer] = packet.t_us
            if len(self._heard) > _MOST_HEARD:
                newest = sorted(self._heard, key=self._heard.__getitem__)[_MOST_HEARD // 2 :]
                self._heard = {key: self._heard[key] for key in newest}

    def _is_loop(self, place: _Place, raw: bytes) -> bool:
        return Packet(0, raw).system_id in self._not_behind or place.is_echo(raw)

    def _route(self, place: _Place, raw: bytes, target: int) -> tuple[set[tuple[int, int]], str]:
        """Links and senders there that a frame from an output goes to; else why it goes nowhere."""
        message_id, allowed = Packet(0, raw).message_id, place.allowed
        if allowed is None:
            return set(), _ONLY_LISTENS
        if message_id not in DEFINITIONS:
            return set(), "nobody knows whom this message is for"
        if message_id == SETUP_SIGNING:
            return set(), "keys never pass"
        if target:
            if target not in allowed:
                return set(), f"?rw does not name system {target}"
            ways = self._ways_to(target)
            return ways, "" if ways else f"system {target} is not heard"
        if message_name(message_id) not in HARMLESS and not self._vehicles <= allowed:
            return set(), "it is for everybody, and ?rw does not name every vehicle"
        fresh = self._fresh()
        shared = {(link, peer) for system, link, peer in fresh if system not in allowed}
        ways = {(link, peer) for system, link, peer in fresh if system in allowed}
        return ways - shared, "" if ways - shared else "it is for everybody, and others would hear it too"

    def _ways_to(self, system: int) -> set[tuple[int, int]]:
        """On each link the sender as which a system was heard last."""
        fresh = self._fresh()
        ways = sorted((t_us, link, peer) for (i, link, peer), t_us in fresh.items() if i == system)
        return set({link: peer for _, link, peer in ways}.items())

    def _fresh(self) -> dict[tuple[int, int, int], int]:
        since_us = self._now_us - HEARD_US
        return {key: t_us for key, t_us in self._heard.items() if t_us >= since_us}


class _Place:
    """One output, its counts and what went to and fro lately."""

    def __init__(self, output: Output, allowed: frozenset[int] | None, clock: Callable[[], float]) -> None:
        self.output = output
        self.allowed = allowed
        """System ids that it may speak to, None: it only listens."""
        self._counts = OutputCounts(name=output.name)
        self._said: dict[tuple[str, str, int, str], int] = {}
        self._sent, self._came = _Lately(clock, ECHO_S), _Lately(clock, ECHO_S)
        self._latest = _Lately(clock, REPEAT_S)

    @property
    def counts(self) -> OutputCounts:
        said = (Said(who=key[0], what=key[1], whom=key[2], why=key[3], count=n) for key, n in self._said.items())
        return replace(self._counts, said=tuple(said))

    def forward(self, raw: bytes) -> None:
        """Sends a frame unless it came from here: a vehicle repeats on its links what a station tells it."""
        if self._came.has(raw) or self._latest.has(raw):
            self.withhold()
            return
        self._latest.add(raw)
        if not self.output.write(raw):
            self._counts = replace(self._counts, dropped=self._counts.dropped + 1)
            return
        self._counts = replace(self._counts, sent=self._counts.sent + 1)
        if self.allowed is not None:
            self._sent.add(raw)

    def withhold(self) -> None:
        self._counts = replace(self._counts, withheld=self._counts.withheld + 1)

    def stop(self) -> None:
        self._counts = replace(self._counts, stopped=self._counts.stopped + 1)

    def is_echo(self, raw: bytes) -> bool:
        return self._sent.has(raw)

    def came_back(self, raw: bytes, who: str, target: int, why: str) -> None:
        """Counts it; ``why`` it went no further, empty: it went on."""
        key = (who, "", 0, why) if self.allowed is None else (who, _words(raw), target, why)
        if key not in self._said and len(self._said) >= MOST_SAID:
            key = ("", "", 0, why and "not counted apart")
        self._said[key] = self._said.get(key, 0) + 1
        if why:
            self.stop()
            return
        self._came.add(raw)
        self._counts = replace(self._counts, returned=self._counts.returned + 1)


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


def parse_output(out: str) -> tuple[str, frozenset[int] | None]:
    """The URL of an output, and the vehicles named that it may speak to beside the UAV; None: it only listens.

    Raises:
        LinkError: what stands behind the question mark is no option.
    """
    url, mark, option = out.partition("?")
    if not mark or option == "ro":
        return url, None
    word, names, ids = option.partition("=")
    named = [int(i) if i.isdecimal() and len(i) <= 3 else 0 for i in ids.split(",")] if names else []
    if word != "rw" or not all(1 <= i <= 255 for i in named):
        raise LinkError(f"{out!r}: {option!r} is no option of an output; write {OUTPUT_OPTIONS}")
    return url, frozenset(named)


def _words(raw: bytes) -> str:
    """A message, and which command it carries."""
    packet = Packet(0, raw)
    name = message_name(packet.message_id)
    if packet.message_id not in _COMMANDS:
        return name
    number = int.from_bytes(packet.payload.ljust(_COMMAND_AT + 2, b"\0")[_COMMAND_AT : _COMMAND_AT + 2], "little")
    entry = ardupilotmega.enums["MAV_CMD"].get(number)
    return f"{name} {str(entry.name).removeprefix('MAV_CMD_') if entry is not None else number}"
