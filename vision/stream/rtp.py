"""Frames out of RTP datagrams: H.264 (RFC 6184) and H.265 (RFC 7798).

Done here and not by FFmpeg, whose RTP opens only ports of its own, new ones with every connection, and gives up on a
sender whose next key frame takes longer than its search. Datagrams that come in the wrong order are put right; what a
lost one leaves of a frame is handed on as far as it can be decoded and marked.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, field

from vision.stream.source import Codec

TICK_HZ = 90_000
"""Clock of video in RTP."""
START = b"\0\0\0\1"
MAX_WAITING = 64
"""Datagrams held back for one that is missing; two whole frames of them are enough, too."""
AHEAD, BACK = 3000, 100
"""A sequence number this far off is a new sender's, once its next one follows (RFC 3550, appendix A.1)."""
LARGEST_UNIT = 32 << 20
"""Most bytes of a NAL unit that is put together from fragments."""
MPEG_TS = 33
"""RTP payload type"""


@dataclass(frozen=True, slots=True)
class RtpPacket:
    """An RTP packet."""

    sequence: int
    time: int
    """90 kHz, 32 bits."""
    source: int
    marker: bool
    """True if it is the last packet of its frame."""
    kind: int
    """Payload type."""
    payload: bytes


@dataclass(frozen=True, slots=True, kw_only=True)
class Unit:
    """One frame's access unit."""

    data: bytes
    """NAL units with start codes (Annex B)."""
    time: int
    """90 kHz, grows over 32 bits."""
    key: bool
    """True if decoding may begin here."""
    whole: bool
    """True if nothing of it was lost."""


def parse(data: bytes) -> RtpPacket | None:
    """RFC 3550, section 5.1; None when it is no RTP packet (or RTCP on the same port)."""
    if len(data) < 12 or data[0] >> 6 != 2 or 72 <= data[1] & 0x7F <= 76:
        return None
    first, second, sequence, time, source = struct.unpack_from("!BBHII", data)
    begin = 12 + 4 * (first & 15)
    if first & 16:
        if len(data) < begin + 4:
            return None
        begin += 4 + 4 * int.from_bytes(data[begin + 2 : begin + 4], "big")
    end = len(data) - (data[-1] if first & 32 else 0)
    if begin >= end:
        return None
    return RtpPacket(sequence, time, source, bool(second & 128), second & 127, data[begin:end])


def source_of(data: bytes) -> int:
    """SSRC of an RTP or RTCP packet, 0 of what is neither."""
    if len(data) < 12 or data[0] >> 6 != 2:
        return 0
    at = 4 if 72 <= data[1] & 0x7F <= 76 else 8
    return int.from_bytes(data[at : at + 4], "big")


def guess_codec(payload: bytes) -> Codec:
    """H.264 or H.265 by the header of a NAL unit, empty when it could be either.

    Parameter sets, fragments and aggregates of H.265 have headers that mean data partitions in H.264, which are not
    used in practice.
    """
    if len(payload) < 2 or payload[0] & 0x80:
        return ""
    if payload[0] >> 1 in (32, 33, 34, 48, 49) and payload[0] & 1 == 0 and payload[1] & 7:
        return "hevc"
    return "h264" if payload[0] & 31 in (5, 7, 8, 24, 28) else ""


@dataclass(slots=True)
class _ReorderBuffer:
    """Datagrams by sequence number."""

    lost: int = 0
    _next: int | None = None
    _waiting: dict[int, RtpPacket] = field(default_factory=dict)

    def put(self, datagram: RtpPacket) -> list[tuple[RtpPacket, bool]]:
        """Return the packets that are next in order, each with whether one before it is missing."""
        if self._next is None:
            self._next = datagram.sequence
        ahead = self._ahead(datagram)
        if ahead < 0:
            return []
        self._waiting[self._next + ahead] = datagram
        turn = self._pop_in_order()
        if len(self._waiting) > MAX_WAITING or sum(d.marker for d in self._waiting.values()) >= 2:
            first = min(self._waiting)
            self.lost += first - self._next
            self._next = first
            gap = self._pop_in_order()
            turn += [(gap[0][0], True), *gap[1:]]
        return turn

    def far(self, datagram: RtpPacket) -> bool:
        """Tell whether its number is none that could come now."""
        return not -BACK <= self._ahead(datagram) <= AHEAD

    def _ahead(self, datagram: RtpPacket) -> int:
        """16 bits, counted on from the next one."""
        return 0 if self._next is None else (datagram.sequence - self._next + 0x8000) % 0x10000 - 0x8000

    def _pop_in_order(self) -> list[tuple[RtpPacket, bool]]:
        assert self._next is not None
        turn = []
        while self._next in self._waiting:
            turn.append((self._waiting.pop(self._next), False))
            self._next += 1
        if turn and not self._waiting:
            self._next %= 0x10000
        return turn


class Depacketizer:
    """RTP packets of one sender in, access units out.

    Attributes:
        codec: as given or found out.
    """

    def __init__(self, codec: Codec = "") -> None:
        self.codec = codec
        self._order = _ReorderBuffer()
        self._source: int | None = None
        self._odd: RtpPacket | None = None
        self._time: int | None = None
        self._full_time = 0
        self._nals: list[bytes] = []
        self._fragment: bytearray | None = None
        self._whole = True
        self._prefix, self._prefix_key = b"", False

    @property
    def lost(self) -> int:
        """Datagrams that never came."""
        return self._order.lost

    def full_time(self, source: int, time: int) -> int | None:
        """A time of this sender (90 kHz, 32 bits) counted as those of the units are; None of another, or before any."""
        if source != self._source or self._time is None:
            return None
        return self._full_time + (time - self._time + (1 << 31)) % (1 << 32) - (1 << 31)

    def add(self, datagram: RtpPacket) -> list[Unit]:
        """The access units that are complete with this packet."""
        if self._source == datagram.source and not self._order.far(datagram):
            return self._put(datagram)
        before, self._odd = self._odd, datagram
        if self._source is None:
            return self._change(datagram)
        # noise looks like another sender once, a real sender repeatedly
        if before is None or (before.source, (before.sequence + 1) % 0x10000) != (datagram.source, datagram.sequence):
            return []
        return self._change(before) + self._put(datagram)

    def _change(self, datagram: RtpPacket) -> list[Unit]:
        """Change to another sender, or to the same one with numbers that begin elsewhere."""
        self._odd = None
        self._order, self._source = _ReorderBuffer(self._order.lost), datagram.source
        units = self._finish()
        self._time = None
        return units + self._put(datagram)

    def _put(self, datagram: RtpPacket) -> list[Unit]:
        return [unit for packet, gap in self._order.put(datagram) for unit in self._add_in_order(packet, gap)]

    def _add_in_order(self, packet: RtpPacket, gap: bool) -> list[Unit]:
        units: list[Unit] = []
        if gap:
            self._fragment, self._whole = None, False
        if packet.time != self._time:
            units += self._finish()
            self._whole = self._whole and not gap
            if self._time is not None:
                self._full_time += (packet.time - self._time + (1 << 31)) % (1 << 32) - (1 << 31)
            self._time = packet.time
        self.codec = self.codec or guess_codec(packet.payload)
        if self.codec == "h264":
            self._add_h264(packet.payload)
        elif self.codec == "hevc":
            self._add_hevc(packet.payload)
        if packet.marker:
            units += self._finish()
        return units

    def _add_h264(self, payload: bytes) -> None:
        kind = payload[0] & 31
        if kind == 24:
            self._aggregate(payload, 1)
        elif kind == 28 and len(payload) > 2:
            # FU-A: indicator, header (start, end, type), piece of the unit
            self._piece(payload[1], bytes([payload[0] & 0xE0 | payload[1] & 31]), payload[2:])
        elif 1 <= kind <= 23:
            self._nals.append(payload)
        else:
            self._whole = False

    def _add_hevc(self, payload: bytes) -> None:
        kind = payload[0] >> 1 & 63
        if kind == 48:
            self._aggregate(payload, 2)
        elif kind == 49 and len(payload) > 3:
            header = bytes([payload[0] & 0x81 | (payload[2] & 63) << 1, payload[1]])
            self._piece(payload[2], header, payload[3:])
        elif kind < 48 and len(payload) > 2:
            self._nals.append(payload)
        else:
            self._whole = False

    def _aggregate(self, payload: bytes, at: int) -> None:
        """Several units, each behind its size in 16 bits."""
        while at + 2 < len(payload):
            size = int.from_bytes(payload[at : at + 2], "big")
            unit = payload[at + 2 : at + 2 + size]
            at += 2 + size
            if not size or len(unit) < size:
                self._whole = False
                return
            self._nals.append(unit)

    def _piece(self, flags: int, header: bytes, data: bytes) -> None:
        if flags & 0x80:
            self._end_fragment()
            self._fragment = bytearray(header)
        if self._fragment is None or len(self._fragment) > LARGEST_UNIT:
            self._whole = False
            return
        self._fragment += data
        if flags & 0x40:
            self._end_fragment()

    def _end_fragment(self) -> None:
        if self._fragment is not None:
            self._nals.append(bytes(self._fragment))
            self._fragment = None

    def _finish(self) -> list[Unit]:
        """The unit that the packets so far make up, if they make up a frame."""
        if self._fragment is not None:
            self._end_fragment()
            self._whole = False
        nals, self._nals = self._nals, []
        whole, self._whole = self._whole, True
        if not nals:
            self._whole = whole
            return []
        kinds = [nal[0] & 31 if self.codec == "h264" else nal[0] >> 1 & 63 for nal in nals]
        data = self._prefix + b"".join(START + nal for nal in nals)
        avc = self.codec == "h264"
        slices, keys = ((1, 2, 5), (5, 7)) if avc else (range(32), (*range(16, 22), 33))
        key = self._prefix_key or any(kind in keys for kind in kinds)
        if not any(kind in slices for kind in kinds):
            # parameter sets on their own belong to the frame that follows; those of a lost frame do not
            self._prefix, self._prefix_key = (data, key) if whole and len(data) < LARGEST_UNIT else (b"", False)
            self._whole = whole
            return []
        self._prefix, self._prefix_key = b"", False
        return [Unit(data=data, time=self._full_time, key=key, whole=whole)]
