"""The memory that the ingest process and the station share: a few counters, a status text and a ring of packets.

One process writes each part and one reads it, so there are no locks. A packet in the ring is a head of 16 bytes
(arrival in Unix µs, number of the peer, length, link, auth) and its frame; before the packets of a batch stands a head
without a frame, with the number of the batch's first record in place of the time. Positions in the ring only grow; what
lies between the reader's and the writer's is unread. The memory has no name: it goes with the last process that has it
open, however that ends.
"""

from __future__ import annotations

import mmap
import os
import struct
from collections.abc import Sequence
from enum import IntEnum

from infra.shared_memory import make_nameless
from mavlink.protocol.packet import Auth, Packet

__all__ = ["RING_BYTES", "Shared", "Word", "make_memory"]

RING_BYTES = 16 << 20
"""A minute of 5,000 packets/s."""
_STATUS_AT, _STATUS_BYTES = 4096, 258_048
_RING_AT = _STATUS_AT + _STATUS_BYTES
_HEAD = struct.Struct("=QIHBB")
_AUTHS = tuple(Auth)
_UNRECORDED = (1 << 64) - 1


class Word(IntEnum):
    """The counters, eight bytes each."""

    BEAT = 0
    """Grows while the ingest process is well."""
    READY = 1
    """Generation of the process that has opened everything."""
    WRITTEN = 2
    """Bytes ever put into the ring."""
    READ = 3
    """Bytes ever taken out of it."""
    OVERRUN = 4
    """Packets that found no room in the ring; they are in the log."""
    REFUSED = 5
    """Records that were not believed."""
    SENT = 6
    """Records of what this station sent."""
    IN_HAND = 7
    """One more than the index of the link whose packets are being taken off its socket and are not yet accepted."""
    STATUS = 8
    """Odd while the status is being written."""
    STATUS_LENGTH = 9
    HEARD_US = 10
    """Unix µs: what came before has been put into the ring."""


def make_memory(ring_bytes: int = RING_BYTES) -> int:
    """A file descriptor of new memory.

    Raises:
        OSError: no memory is left.
    """
    return make_nameless(_RING_AT + ring_bytes)


class Shared:
    """One process's view of the memory.

    Args:
        fd: from :func:`make_memory`; stays the caller's.
    """

    def __init__(self, fd: int) -> None:
        size = os.fstat(fd).st_size
        self._map = mmap.mmap(fd, size)
        self._view = memoryview(self._map)
        self.words = self._view[:_STATUS_AT].cast("Q")
        self._ring = self._view[_RING_AT:]
        self._room = size - _RING_AT

    def close(self) -> None:
        """Lets go of the memory."""
        self.words.release()
        self._ring.release()
        self._view.release()
        self._map.close()

    # ---- the ingest process

    def put(
        self,
        link: int,
        record: int | None,
        times_us: Sequence[int],
        frames: Sequence[bytes],
        peers: Sequence[int],
        auths: Sequence[int] | None,
    ) -> bool:
        """Puts packets into the ring, all of them or, where there is no room, none; those are counted.

        Args:
            link: that they came over.
            record: number of the first of them in the log, those of the others follow; None: they are not in it.
            times_us: (N) arrival.
            frames: (N).
            peers: (N) numbers of their senders.
            auths: (N), None: all open.
        """
        words, pack = self.words, _HEAD.pack
        pieces = [pack(_UNRECORDED if record is None else record, 0, 0, link, 0)]
        if auths is None:
            rows = zip(times_us, frames, peers, strict=True)
            pieces += [piece for t, raw, peer in rows for piece in (pack(t, peer, len(raw), link, 0), raw)]
        else:
            full = zip(times_us, frames, peers, auths, strict=True)
            pieces += [piece for t, raw, peer, auth in full for piece in (pack(t, peer, len(raw), link, auth), raw)]
        data = b"".join(pieces)
        written = words[Word.WRITTEN]
        if len(data) > self._room - (written - words[Word.READ]):
            words[Word.OVERRUN] += len(frames)
            return False
        at = written % self._room
        first = min(len(data), self._room - at)
        self._ring[at : at + first] = data[:first]
        self._ring[: len(data) - first] = data[first:]
        words[Word.WRITTEN] = written + len(data)
        return True

    def tell(self, status: bytes) -> None:
        """Replaces the status text; one that is too long is left out."""
        if len(status) > _STATUS_BYTES:
            return
        self.words[Word.STATUS] |= 1
        self._view[_STATUS_AT : _STATUS_AT + len(status)] = status
        self.words[Word.STATUS_LENGTH] = len(status)
        self.words[Word.STATUS] += 1

    # ---- the station

    def take(self) -> list[Packet]:
        """All packets that are in the ring, in order; they are then out of it."""
        words = self.words
        written, read = words[Word.WRITTEN], words[Word.READ]
        if written == read:
            return []
        at, size = read % self._room, written - read
        first = min(size, self._room - at)
        data = bytes(self._ring[at : at + first]) + bytes(self._ring[: size - first])
        words[Word.READ] = written
        packets: list[Packet] = []
        place, record, step, unpack = 0, 0, 1, _HEAD.unpack_from
        while place < size:
            t_us, peer, length, link, auth = unpack(data, place)
            stop = place + 16 + length
            if length:
                packets.append(Packet(t_us, data[place + 16 : stop], link, peer, _AUTHS[auth], record))
                record += step
            else:
                record, step = (-1, 0) if t_us == _UNRECORDED else (t_us, 1)
            place = stop
        return packets

    def status(self) -> bytes | None:
        """The status text; None when it is just being written."""
        before = self.words[Word.STATUS]
        length = min(self.words[Word.STATUS_LENGTH], _STATUS_BYTES)
        text = bytes(self._view[_STATUS_AT : _STATUS_AT + length])
        return text if before % 2 == 0 and self.words[Word.STATUS] == before else None
