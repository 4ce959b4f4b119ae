"""The only way out for what the station itself sends: to the UAV alone, with one sequence number, signed, recorded.

Every frame that is not addressed to the UAV is dropped here, whoever made it, but HEARTBEAT and TIMESYNC, which have no
address and carry no command. Frames go to the UAV's own network address; other systems behind it (one radio, a router)
receive them too, and see that they are for the UAV. So this station commands no ground vehicle.

Where the other end of a link sends nothing until it has received something, heartbeats announce the station until the
UAV is received there, or only other systems are.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Collection, Mapping

from mavlink.errors import LinkError
from mavlink.protocol.addressing import BROADCAST, target_of
from mavlink.protocol.dialect import DEFINITIONS, HEARTBEAT, SETUP_SIGNING, TIMESYNC
from mavlink.protocol.framing import checksum
from mavlink.protocol.packet import MAGIC_V2, Auth, Packet

SYSTEM_ID, COMPONENT_ID = 254, 190
"""Ids of this station: not 255, whose heartbeats vehicles take for those of their first station."""

_SHORTEST_V2 = 12
"""Bytes of a MAVLink 2 frame without payload."""
REACHABLE_US = 10_000_000
"""Time for which the UAV is sent to on a link after its last packet there."""

WriteFrame = Callable[[int, int, bytes], None]


def only_to_uav(raw: bytes, uav: int) -> bool:
    """Tell whether a frame may leave: addressed to the UAV, or one of the two broadcasts that carry no command.

    Args:
        raw: one unsigned frame, MAVLink 2.
        uav: system id of the UAV, 1..255.
    """
    if len(raw) < _SHORTEST_V2 or raw[0] != MAGIC_V2 or raw[2]:
        return False
    message_id = Packet(0, raw).message_id
    if message_id not in DEFINITIONS or message_id == SETUP_SIGNING:
        return False
    target = target_of(raw)
    return target[0] == uav if target != BROADCAST else message_id in (HEARTBEAT, TIMESYNC)


class Transmitter:
    """Sends to the UAV, over the links on which it is received. Any thread may send.

    Args:
        uav: its system id.
        write: writes a frame to a link and a peer on it. A peer is the number of an address on a link, 0 where there is
            none; a link with several peers must not pass the frame to the others.
        sign: makes a signed frame of an unsigned one, for a link; None leaves frames unsigned.
        sent: called with the link and every frame that left, as it left.
        announce_on: links to one address each (``udpout:``), on which heartbeats announce this station.
    """

    def __init__(
        self,
        uav: int,
        write: WriteFrame,
        *,
        sign: Callable[[bytes, int], bytes] | None = None,
        sent: Callable[[int, bytes], None] = lambda link, raw: None,
        announce_on: Collection[int] = (),
    ) -> None:
        self._uav = uav
        self._write = write
        self._sign = sign
        self._sent = sent
        self._announce_on = tuple(announce_on)
        self._lock = threading.Lock()
        self._seq = 0
        self._addresses: dict[int, tuple[int, int]] = {}
        """Link → peer and time of the UAV's last packet."""
        self._held: dict[int, tuple[int, int]] = {}
        """Link → peer and time of the UAV's last held packet."""
        self._others: set[int] = set()
        self.count = 0
        """Frames that left."""

    @property
    def links(self) -> list[int]:
        """Links on which the UAV was received lately, the latest first."""
        recent = [(t_us, link) for link, (_, t_us) in _recent(self._addresses).items()]
        return [link for _, link in sorted(recent, reverse=True)]

    def note_packet(self, packet: Packet) -> None:
        """Learn from a received packet where the UAV is, and where only others are.

        Where the UAV's packets are held because nothing proves that they are made now, it gets heartbeats and nothing
        else: an autopilot that receives one raises the timestamps of its signatures to that of ours.
        """
        if packet.auth is Auth.HELD and packet.system_id == self._uav:
            self._held[packet.link] = (packet.peer, packet.t_us)
        if packet.auth > Auth.GOOD:
            return
        if packet.system_id == self._uav:
            self._addresses[packet.link] = (packet.peer, packet.t_us)
        else:
            self._others.add(packet.link)

    def send(self, raw: bytes, link: int | None = None) -> bool:
        """Send a frame if it may leave.

        Args:
            raw: unsigned MAVLink 2; its sequence number is replaced by the station's own.
            link: where to; None is the link on which the UAV was received last.

        Returns:
            Whether it left.
        """
        if not only_to_uav(raw, self._uav):
            return False
        with self._lock:
            if link is None:
                link = next(iter(self.links), None)
            if link is None or link not in self._addresses:
                return False
            return self._send_to(raw, link, self._addresses[link][0])

    def broadcast(self, raw: bytes) -> int:
        """Send a frame on every link on which the UAV is received, a heartbeat also where the station is announced.

        Returns:
            On how many links it left.
        """
        links = self.links
        count = sum(self.send(raw, link) for link in links)
        if not only_to_uav(raw, self._uav) or Packet(0, raw).message_id != HEARTBEAT:
            return count
        announced = {link: 0 for link in self._announce_on if self._is_unaware_of_us(link, links)}
        announced |= {link: peer for link, (peer, _) in _recent(self._held).items() if link not in links}
        with self._lock:
            return count + sum(self._send_to(raw, link, peer) for link, peer in announced.items())

    def _is_unaware_of_us(self, link: int, links: Collection[int]) -> bool:
        """Tell whether the UAV may be behind a link without knowing this station; not if a ground vehicle answered."""
        return link not in links and (link in self._addresses or link not in self._others)

    def _send_to(self, raw: bytes, link: int, peer: int) -> bool:
        frame = _with_sequence(raw, self._seq)
        self._seq = (self._seq + 1) & 0xFF
        frame = self._sign(frame, link) if self._sign is not None else frame
        try:
            self._write(link, peer, frame)
        except LinkError:
            return False
        self.count += 1
        self._sent(link, frame)
        return True


def _recent(addresses: Mapping[int, tuple[int, int]]) -> dict[int, tuple[int, int]]:
    """Peer and time by link, of those that were received lately."""
    addresses = dict(addresses)  # another thread adds to it
    newest_us = max((t_us for _, t_us in addresses.values()), default=0)
    return {link: address for link, address in addresses.items() if newest_us - address[1] <= REACHABLE_US}


def _with_sequence(raw: bytes, seq: int) -> bytes:
    """Return the frame with another sequence number."""
    body = raw[:4] + bytes([seq]) + raw[5:]
    extra = DEFINITIONS[Packet(0, raw).message_id][1]
    return body[:-2] + checksum(body, extra).to_bytes(2, "little")
