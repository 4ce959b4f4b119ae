"""The one way out for whatever the station itself says: only to the UAV, numbered in one row, signed, recorded.

Everything not addressed to the UAV is dropped here and counted, whoever made it, but HEARTBEAT and TIMESYNC, which
have no address and carry no order. All goes to the UAV's own network address only: who shares it (one radio, a router)
hears it too, and sees that it is for the UAV. So this station gives no ground vehicle an order. On a link whose other
end sends to nobody before it was spoken to, heartbeats announce this station until the UAV is heard there, or only
others are.
"""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Callable, Collection, Mapping

from mavlink.errors import LinkError
from mavlink.protocol.addressing import EVERYBODY, target_of
from mavlink.protocol.dialect import DEFINITIONS, message_name
from mavlink.protocol.framing import checksum
from mavlink.protocol.packet import MAGIC_V2, Auth, Packet

__all__ = ["COMPONENT_ID", "SYSTEM_ID", "Transmitter", "only_to_uav"]

SYSTEM_ID, COMPONENT_ID = 254, 190
"""What this station speaks as, where it may: not as 255, behind which vehicles look for the first station."""

_HEARTBEAT, _TIMESYNC, _SETUP_SIGNING = 0, 111, 256
HEARD_US = 10_000_000
"""For how long the UAV is spoken to on a link after it was heard there."""

Send = Callable[[int, int, bytes], None]


def only_to_uav(raw: bytes, uav: int) -> bool:
    """Whether a frame may leave: addressed to the UAV, or one of the two broadcasts that carry no order.

    Args:
        raw: one unsigned frame, MAVLink 2.
        uav: system id of the UAV, 1..255.
    """
    if len(raw) < 12 or raw[0] != MAGIC_V2 or raw[2]:
        return False
    message_id = Packet(0, raw).message_id
    if message_id not in DEFINITIONS or message_id == _SETUP_SIGNING:
        return False
    target = target_of(raw)
    return target[0] == uav if target != EVERYBODY else message_id in (_HEARTBEAT, _TIMESYNC)


class Transmitter:
    """Sends to the UAV, wherever it is heard. Any thread may send.

    Args:
        uav: its system id.
        send: given link, peer on that link and a frame. A peer is the number of an address on a link, 0 where there is
            none; a link on which several speak must not pass the frame to the others.
        sign: makes a signed frame of an unsigned one, for a link; None leaves frames unsigned.
        sent: told the link and every frame that left, as it left.
        announce_on: links to one address each (``udpout:``) that is told of this station by its heartbeats.
    """

    def __init__(
        self,
        uav: int,
        send: Send,
        *,
        sign: Callable[[bytes, int], bytes] | None = None,
        sent: Callable[[int, bytes], None] = lambda link, raw: None,
        announce_on: Collection[int] = (),
    ) -> None:
        self._uav = uav
        self._send = send
        self._sign = sign
        self._sent = sent
        self._announce_on = tuple(announce_on)
        self._lock = threading.Lock()
        self._seq = 0
        self._where: dict[int, tuple[int, int]] = {}
        self._held: dict[int, tuple[int, int]] = {}
        self._others: set[int] = set()
        self._refused: Counter[str] = Counter()
        self.count = 0
        """Frames that left."""

    @property
    def refused(self) -> Mapping[str, int]:
        """Message name → frames that were not addressed to the UAV and did not leave."""
        return dict(self._refused)

    @property
    def links(self) -> list[int]:
        """Links on which the UAV was heard lately, the latest first."""
        fresh = [(t_us, link) for link, (_, t_us) in _fresh(self._where).items()]
        return [link for _, link in sorted(fresh, reverse=True)]

    def note_packet(self, packet: Packet) -> None:
        """Learns where the UAV is, and where only others are, from packets that are believed.

        Where its packets are held because nothing proves that they are made now, it gets heartbeats and nothing else:
        a living autopilot that hears one raises the timestamps of its signatures to the one of ours.
        """
        if packet.auth is Auth.HELD and packet.system_id == self._uav:
            self._held[packet.link] = (packet.peer, packet.t_us)
        if packet.auth > Auth.GOOD:
            return
        if packet.system_id == self._uav:
            self._where[packet.link] = (packet.peer, packet.t_us)
        else:
            self._others.add(packet.link)

    def send(self, raw: bytes, link: int | None = None) -> bool:
        """Sends a frame if it may leave.

        Args:
            raw: unsigned MAVLink 2; its sequence number is replaced by the station's own.
            link: where to; None is the link on which the UAV was heard last.

        Returns:
            Whether it left.
        """
        if not only_to_uav(raw, self._uav):
            name = message_name(Packet(0, raw).message_id) if len(raw) >= 12 and raw[0] == MAGIC_V2 else "not MAVLink 2"
            self._refused[name] += 1
            return False
        with self._lock:
            if link is None:
                link = next(iter(self.links), None)
            if link is None or link not in self._where:
                return False
            return self._send_now(raw, link, self._where[link][0])

    def broadcast(self, raw: bytes) -> int:
        """Sends a frame wherever the UAV is heard, a heartbeat also where this station is to be announced.

        Returns:
            On how many links it left.
        """
        heard = self.links
        left = sum(self.send(raw, link) for link in heard)
        if not only_to_uav(raw, self._uav) or Packet(0, raw).message_id != _HEARTBEAT:
            return left
        announced = {link: 0 for link in self._announce_on if self._may_wait(link, heard)}
        announced |= {link: peer for link, (peer, _) in _fresh(self._held).items() if link not in heard}
        with self._lock:
            return left + sum(self._send_now(raw, link, peer) for link, peer in announced.items())

    def _may_wait(self, link: int, heard: Collection[int]) -> bool:
        """Whether the UAV may be behind a link and not know of this station; not where a ground vehicle answered."""
        return link not in heard and (link in self._where or link not in self._others)

    def _send_now(self, raw: bytes, link: int, peer: int) -> bool:
        frame = _numbered(raw, self._seq)
        self._seq = (self._seq + 1) & 0xFF
        frame = self._sign(frame, link) if self._sign is not None else frame
        try:
            self._send(link, peer, frame)
        except LinkError:
            return False
        self.count += 1
        self._sent(link, frame)
        return True


def _fresh(where: Mapping[int, tuple[int, int]]) -> dict[int, tuple[int, int]]:
    """Peer and time by link, of those that were heard lately."""
    where = dict(where)  # another thread learns new ones
    newest_us = max((t_us for _, t_us in where.values()), default=0)
    return {link: place for link, place in where.items() if newest_us - place[1] <= HEARD_US}


def _numbered(raw: bytes, seq: int) -> bytes:
    """The same frame with another sequence number."""
    body = raw[:4] + bytes([seq]) + raw[5:]
    extra = DEFINITIONS[Packet(0, raw).message_id][1]
    return body[:-2] + checksum(body, extra).to_bytes(2, "little")
