"""One output: a link to other programs, which vehicles they may address, and counts of both directions."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

from pymavlink.dialects.v20 import ardupilotmega

from mavlink.errors import LinkError
from mavlink.links.base import LinkOptions
from mavlink.links.kinds import open_link
from mavlink.protocol.dialect import message_name
from mavlink.protocol.packet import Packet

_COMMANDS = (ardupilotmega.MAVLINK_MSG_ID_COMMAND_INT, ardupilotmega.MAVLINK_MSG_ID_COMMAND_LONG)
_COMMAND_AT = 28
"""Byte of both at which the number of the command begins."""
ECHO_S = 2.0
"""Time for which a frame that comes back is known to be our own, s; shorter than a sequence number takes to come
around."""
REPEAT_S = 0.25
"""Time for which a frame from a link is known to have gone out, s; short, as heartbeats are equal at some message
rates."""
_ECHOES = 50_000
"""Frames remembered at most, for each of the two."""
MAX_INBOUND = 24
"""Different inbound frames that are counted apart, each a line of the health; the rest is summed up."""
OUTPUT_OPTIONS = "?ro (only listens), ?rw (may send to the UAV) or ?rw=11,12 (to these vehicles too)"


@dataclass(frozen=True, slots=True, kw_only=True)
class InboundFrames:
    """Kind of frames from a program behind an output, and how many of them came."""

    sender: str
    """Address of the program; empty for all those that are not counted apart."""
    message: str
    """Message and command; empty for all frames that come to an output that only listens."""
    target: int
    """System id that they were for, 0 for all."""
    refusal: str
    """Reason why they went no further; empty: they were sent on."""
    count: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class OutputCounts:
    """Counts of what passed one output."""

    name: str
    sent: int = 0
    dropped: int = 0
    """Packets that were not accepted: no receiver, or one that is too slow."""
    withheld: int = 0
    """Frames that were not sent: their signature is wrong, they set a key, or they went out already."""
    returned: int = 0
    """Frames from programs that went on to a vehicle."""
    stopped: int = 0
    """Frames from programs that went nowhere."""
    inbound: tuple[InboundFrames, ...] = ()
    """Frames from programs by kind, without loops."""


class Output:
    """A link that frames are forwarded over, its counts and what went to and fro lately.

    Args:
        url: of the link, with the option of the output.
        clock: seconds, monotonic.

    Raises:
        LinkError: it cannot be opened.
    """

    def __init__(self, url: str, clock: Callable[[], float]) -> None:
        link_url, self._named = parse_output(url)
        self.allowed = self._named
        """System ids that it may send to, None: it only listens."""
        self.link = open_link(link_url, LinkOptions(is_output=True))
        self._sent = self._dropped = self._withheld = self._returned = self._stopped = 0
        self._inbound: dict[InboundFrames, int] = {}
        self._recently_sent, self._recently_returned = _RecentFrames(clock, ECHO_S), _RecentFrames(clock, ECHO_S)
        self._recently_tried = _RecentFrames(clock, REPEAT_S)

    def allow(self, uav: int) -> None:
        """Let the programs behind it send to this UAV (0: to none), where the URL lets them send at all."""
        if self._named is not None:
            self.allowed = (self._named | {uav}) - {0}

    @property
    def counts(self) -> OutputCounts:
        """Counts of what passed it so far."""
        return OutputCounts(
            name=self.link.name,
            sent=self._sent,
            dropped=self._dropped,
            withheld=self._withheld,
            returned=self._returned,
            stopped=self._stopped,
            inbound=tuple(replace(key, count=n) for key, n in self._inbound.items()),
        )

    def forward(self, raw: bytes) -> None:
        """Send a frame unless it came from here: a vehicle repeats on its links what a station sends it."""
        if self._recently_returned.has(raw) or self._recently_tried.has(raw):
            self.count_withheld()
            return
        self._recently_tried.add(raw)
        if not self._send(raw):
            self._dropped += 1
            return
        self._sent += 1
        if self.allowed is not None:
            self._recently_sent.add(raw)

    def read(self) -> Iterator[tuple[bytes, str]]:
        """Frames that came back, without waiting, each with the address of the program."""
        batch = self.link.read_batch()
        for raw, peer in zip(batch.frames, batch.peers, strict=True):
            yield raw, self.link.address(peer) or self.link.name

    def count_withheld(self) -> None:
        """Count a frame that is not to go out."""
        self._withheld += 1

    def count_stopped(self) -> None:
        """Count a frame that came back and is not to go on."""
        self._stopped += 1

    def is_echo(self, raw: bytes) -> bool:
        """Tell whether a frame went out here a moment ago."""
        return self._recently_sent.has(raw)

    def note_inbound(self, raw: bytes, sender: str, target: int, refusal: str) -> None:
        """Count a frame that came back; ``refusal`` is why it went no further, empty: it went on."""
        if self.allowed is None:
            key = InboundFrames(sender=sender, message="", target=0, refusal=refusal)
        else:
            key = InboundFrames(sender=sender, message=_message_words(raw), target=target, refusal=refusal)
        if key not in self._inbound and len(self._inbound) >= MAX_INBOUND:
            key = InboundFrames(sender="", message="", target=0, refusal=refusal and "not counted apart")
        self._inbound[key] = self._inbound.get(key, 0) + 1
        if refusal:
            self.count_stopped()
            return
        self._recently_returned.add(raw)
        self._returned += 1

    def _send(self, raw: bytes) -> bool:
        try:
            return self.link.send(raw)
        except LinkError:
            return False


class _RecentFrames:
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
    """The URL of an output, and the vehicles named that it may send to beside the UAV; None: it only listens.

    Raises:
        LinkError: what follows the question mark is no option.
    """
    url, mark, option = out.partition("?")
    if not mark or option == "ro":
        return url, None
    word, names, ids = option.partition("=")
    named = [int(i) if i.isdecimal() and len(i) <= 3 else 0 for i in ids.split(",")] if names else []
    if word != "rw" or not all(1 <= i <= 255 for i in named):
        raise LinkError(f"{out!r}: {option!r} is no option of an output; write {OUTPUT_OPTIONS}")
    return url, frozenset(named)


def _message_words(raw: bytes) -> str:
    """A message, and which command it carries."""
    packet = Packet(0, raw)
    name = message_name(packet.message_id)
    if packet.message_id not in _COMMANDS:
        return name
    number = int.from_bytes(packet.payload.ljust(_COMMAND_AT + 2, b"\0")[_COMMAND_AT : _COMMAND_AT + 2], "little")
    entry = ardupilotmega.enums["MAV_CMD"].get(number)
    return f"{name} {str(entry.name).removeprefix('MAV_CMD_') if entry is not None else number}"
