"""Forwarding: received packets go to other programs unchanged, and their frames go to vehicles where that is allowed.

No frame is encoded again, signed again or reordered. Only frames from outputs with `?rw` go to vehicles, and of those:

- a frame that is addressed to the UAV, or to a vehicle that is named (`?rw=11,12`), and only to the address from which
  that one was received last;
- HEARTBEAT and TIMESYNC, which carry no order, to addresses from which no other system is received;
- other broadcasts only where every vehicle of the mission is named.

A frame is a loop, and dropped, when it went out over the same output a moment ago, or when its sender is one of the
vehicles or this station: those are not behind an output. The same frame from a link twice in a moment goes out once, or
an output that leads back to a link would circulate it. SETUP_SIGNING carries a key and never passes, either way.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterator, Sequence

from mavlink.errors import LinkError
from mavlink.forwarding.outputs import Output, OutputCounts
from mavlink.protocol.addressing import target_of
from mavlink.protocol.dialect import DEFINITIONS, SETUP_SIGNING, message_name
from mavlink.protocol.packet import Auth, Packet

HARMLESS = ("HEARTBEAT", "TIMESYNC")
"""Broadcasts that carry no order."""
HEARD_US = 60_000_000
"""Time since a system was last received at an address within which what is for it goes there."""
_MAX_SENDERS = 4096
"""Pairs of system and address that are remembered."""
_ONLY_LISTENS = "this output only listens; ?rw behind its address lets it send to the UAV"


class Forwarder:
    """Copies packets to outputs, and frames from outputs to vehicles. It never waits.

    Args:
        outs: URLs, each a link URL (`udpout:127.0.0.1:14551`) with `?ro`, `?rw` or `?rw=11,12` behind it, or nothing,
            which is `?ro`.
        uav: system id of the UAV, to which `?rw` lets a program send; 0: none.
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
        self._refused, self._own = refused, own
        self._last_received_us: dict[tuple[int, int, int], int] = {}
        self._now_us = 0
        self._outputs: list[Output] = []
        try:
            for url in outs:
                self._outputs.append(Output(url, clock))
        except BaseException:
            self.close()
            raise
        self.set_fleet(vehicles, uav)

    def set_fleet(self, vehicles: Collection[int], uav: int) -> None:
        """Set the mission's vehicles, and which of them is the UAV; as of the constructor."""
        self._not_behind = frozenset(vehicles) | {self._own}
        self._vehicles = frozenset(vehicles) | ({uav} - {0})
        for output in self._outputs:
            output.allow(uav)

    @property
    def counts(self) -> tuple[OutputCounts, ...]:
        """Counts of what passed each output."""
        return tuple(output.counts for output in self._outputs)

    @property
    def fds(self) -> tuple[int, ...]:
        """File descriptors to wait for; they change as receivers come and go."""
        return tuple(fd for output in self._outputs for fd in output.link.fds)

    @property
    def overdue(self) -> bool:
        """True if something may have come back though no descriptor is ready."""
        return any(output.link.overdue for output in self._outputs)

    def maintain(self) -> None:
        """Connect outputs again; to be called every tenth of a second or so."""
        for output in self._outputs:
            output.link.maintain()

    def forward(self, packets: Sequence[Packet], send: Callable[[int, bytes, int], object]) -> None:
        """Forward packets in order, and what came back from outputs to vehicles.

        Args:
            packets: as the links brought them, verified; none is fine.
            send: given the number of a link, a frame for it, and the number of the sender there who is to get it; its
                LinkError costs that frame.
        """
        for packet in packets:
            self._note_sender(packet)
            secret = packet.message_id == SETUP_SIGNING or (packet.auth > Auth.GOOD and not self._refused)
            for output in self._outputs:
                output.count_withheld() if secret else output.forward(packet.raw)
        for link, raw, peer in self._returned():
            try:
                send(link, raw, peer)
            except LinkError:
                continue  # the link reports it itself

    def close(self) -> None:
        """Close every output."""
        for output in self._outputs:
            output.link.close()

    def _returned(self) -> Iterator[tuple[int, bytes, int]]:
        """Frames that came back from outputs and may go on: link, frame, and the sender there who is to get it."""
        for output in self._outputs:
            for raw, program in output.read():
                if self._is_loop(output, raw):
                    output.count_stopped()
                    continue
                target = target_of(raw)[0]
                ways, refusal = self._route(output, raw, target)
                output.note_inbound(raw, program, target, refusal)
                yield from ((link, raw, peer) for link, peer in sorted(ways))

    def _note_sender(self, packet: Packet) -> None:
        if packet.auth <= Auth.GOOD:
            self._now_us = max(self._now_us, packet.t_us)
            self._last_received_us[packet.system_id, packet.link, packet.peer] = packet.t_us
            if len(self._last_received_us) > _MAX_SENDERS:
                newest = sorted(self._last_received_us, key=self._last_received_us.__getitem__)[_MAX_SENDERS // 2 :]
                self._last_received_us = {key: self._last_received_us[key] for key in newest}

    def _is_loop(self, output: Output, raw: bytes) -> bool:
        return Packet(0, raw).system_id in self._not_behind or output.is_echo(raw)

    def _route(self, output: Output, raw: bytes, target: int) -> tuple[set[tuple[int, int]], str]:
        """Links and senders there that a frame from an output goes to; else why it goes nowhere."""
        message_id, allowed = Packet(0, raw).message_id, output.allowed
        if allowed is None:
            return set(), _ONLY_LISTENS
        if message_id not in DEFINITIONS:
            return set(), "the addressee of this message is not known"
        if message_id == SETUP_SIGNING:
            return set(), "keys never pass"
        if target:
            if target not in allowed:
                return set(), f"?rw does not name system {target}"
            ways = self._ways_to(target)
            return ways, "" if ways else f"system {target} is not received"
        if message_name(message_id) not in HARMLESS and not self._vehicles <= allowed:
            return set(), "it is for all systems, and ?rw does not name every vehicle"
        fresh = self._fresh()
        shared = {(link, peer) for system, link, peer in fresh if system not in allowed}
        ways = {(link, peer) for system, link, peer in fresh if system in allowed}
        return ways - shared, "" if ways - shared else "it is for all systems, and others would receive it too"

    def _ways_to(self, system: int) -> set[tuple[int, int]]:
        """Return the address on each link from which a system was received last."""
        fresh = self._fresh()
        ways = sorted((t_us, link, peer) for (i, link, peer), t_us in fresh.items() if i == system)
        return set({link: peer for _, link, peer in ways}.items())

    def _fresh(self) -> dict[tuple[int, int, int], int]:
        since_us = self._now_us - HEARD_US
        return {key: t_us for key, t_us in self._last_received_us.items() if t_us >= since_us}
