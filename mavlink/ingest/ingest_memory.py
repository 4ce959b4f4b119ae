"""The memory that the ingest process and the station share: some slots, a status text and a ring of packets.

It has no name: it goes with the last process that has it open, however that ends. :mod:`infra.shared_memory` explains
why the two processes may read and write it without a lock; each slot is a word of eight bytes with one writer and is
right by itself.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from enum import IntEnum

from infra.shared_memory import NewestValue, Ring, make_memory, map_memory
from mavlink.protocol.packet import Auth, Packet

RING_BYTES = 16 << 20
"""A minute of 5,000 packets/s."""
_RECEIVED_UNTIL_AT, _STATUS_AT, _RING_AT = 2048, 4096, 262_144
"""Offset of each part; the slots begin at 0."""
_RECEIVED_UNTIL = struct.Struct("=QQ")
"""Unix µs, and the ring's position up to which everything that came before then is in it."""
_BATCH = struct.Struct("=QB")
"""Header of a batch of packets: number of the first of their records in the log, and the link."""
_PACKET = struct.Struct("=QIHB")
"""Header of each frame: arrival in Unix µs, number of the peer, length, auth."""
_AUTHS = tuple(Auth)
_UNRECORDED = (1 << 64) - 1


class Slot(IntEnum):
    """Places of the numbers, eight bytes each."""

    BEAT = 0
    """Grows while the ingest process is well."""
    OVERRUN = 1
    """Packets that found no room in the ring; they are in the log."""
    REFUSED = 2
    """Records that were rejected."""
    SENT = 3
    """Records of what this station sent."""
    IN_HAND = 4
    """Index, plus one, of the link whose packets are being taken off its socket and are not yet accepted."""


def make_ingest_memory(ring_bytes: int = RING_BYTES) -> int:
    """A file descriptor of new memory.

    Raises:
        OSError: no memory is left.
    """
    return make_memory(_RING_AT + ring_bytes)


class IngestMemory:
    """One process's view of the memory.

    Args:
        fd: from :func:`make_ingest_memory`; stays the caller's.
    """

    def __init__(self, fd: int) -> None:
        memory = memoryview(map_memory(fd))
        self.slots = memory[:_RECEIVED_UNTIL_AT].cast("Q")
        self._received_until = NewestValue(memory[_RECEIVED_UNTIL_AT:_STATUS_AT])
        self.status = NewestValue(memory[_STATUS_AT:_RING_AT])
        """The ingest's health."""
        self._ring = Ring(memory[_RING_AT:])

    # ---- the ingest process

    def put_packets(
        self,
        link: int,
        record: int | None,
        times_us: Sequence[int],
        frames: Sequence[bytes],
        peers: Sequence[int],
        auths: Sequence[int] | None,
    ) -> bool:
        """Put packets into the ring, all of them or, where there is no room, none; those are counted.

        Args:
            record: number of the first of them in the log, those of the others follow; None: they are not in it.
            times_us: (N) arrival.
            frames: (N).
            peers: (N) numbers of their senders.
            auths: (N), None: all open.
        """
        pack = _PACKET.pack
        pieces = [_BATCH.pack(_UNRECORDED if record is None else record, link)]
        if auths is None:
            rows = zip(times_us, frames, peers, strict=True)
            pieces += [piece for t, raw, peer in rows for piece in (pack(t, peer, len(raw), 0), raw)]
        else:
            full = zip(times_us, frames, peers, auths, strict=True)
            pieces += [piece for t, raw, peer, auth in full for piece in (pack(t, peer, len(raw), auth), raw)]
        fits = self._ring.put(b"".join(pieces))
        if not fits:
            self.slots[Slot.OVERRUN] += len(frames)
        return fits

    def put_received_until(self, t_us: int) -> None:
        """Note that what came before a Unix time has been put into the ring."""
        self._received_until.put(_RECEIVED_UNTIL.pack(t_us, self._ring.written))

    # ---- the station

    def take_packets(self) -> list[Packet]:
        """Take all packets that are in the ring out of it, in order."""
        packets: list[Packet] = []
        unpack, head_bytes = _PACKET.unpack_from, _PACKET.size
        for batch in self._ring.read_records():
            record, link = _BATCH.unpack_from(batch)
            step = 1
            if record == _UNRECORDED:
                record, step = -1, 0
            place, size = _BATCH.size, len(batch)
            while place < size:
                t_us, peer, length, auth = unpack(batch, place)
                start = place + head_bytes
                place = start + length
                packets.append(Packet(t_us, batch[start:place], link, peer, _AUTHS[auth], record))
                record += step
        return packets

    def heard_us(self) -> int | None:
        """Unix µs: whatever came before this has been taken; None where that is not known now."""
        value = self._received_until.get()
        t_us, position = _RECEIVED_UNTIL.unpack(value) if value else (0, 0)
        return t_us if value and position <= self._ring.read else None
