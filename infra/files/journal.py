"""A queue of rows for files on disk, in shared memory: a hanging disk blocks no writer, and a crash loses no row.

One process at a time uses it, with two threads: one puts rows in, the other writes them to their files
(:class:`infra.files.journal_writer.JournalWriter`) and only then removes them. When the process dies, the next one
continues with the rows that are left; that it starts after the other ended makes all of its writes visible. Rows of
several files keep the order in which they were put. When the queue is full, new rows are dropped and counted; only
accepted rows are numbered, so their numbers have no gaps.
"""

from __future__ import annotations

import contextlib
import mmap
import struct
import threading
from dataclasses import dataclass

from infra.files.append import RAM_BYTES
from infra.shared_memory import make_memory, map_memory

PIECE_BYTES = 1 << 18
"""Bytes written at once: enough for few system calls, and few enough that no row waits long for earlier ones."""
_RESERVE = 1 << 18
"""Bytes kept free for the files after the first: their rows describe the records of the first."""
_TRIM_BYTES = 1 << 20
"""Memory is returned to the system once more than this was used."""
_WORDS_BYTES = 4096
"""Size of the counters' part: one page, so that the rows can be released apart from it."""
_ENTRY = struct.Struct("=QIIB")
"""Header of each entry: number of its first row, bytes, rows, file."""

_HEAD, _TAIL, _ROWS, _WRITTEN, _LOST = range(5)
"""Index of each counter (uint64): bytes put in and bytes removed, both reset to 0 whenever the queue is empty; rows of
the first file accepted, and of those the ones written to it; rows of all files dropped for lack of room."""


@dataclass(frozen=True, slots=True)
class Piece:
    """The oldest entries of the queue."""

    stop: int
    """Byte count at which they end, for :meth:`Journal.remove`."""
    data: dict[int, bytes]
    """Index of a file → its whole rows, in order."""
    rows: dict[int, int]
    """Index of a file → number of its rows."""


def make_journal(size: int = RAM_BYTES) -> int:
    """Allocate the memory of a new journal; return its file descriptor.

    Raises:
        OSError: no memory is left.
    """
    return make_memory(_WORDS_BYTES + size)


class Journal:
    """The journal as one process maps it.

    Args:
        fd: from :func:`make_journal`; stays the caller's.

    Attributes:
        due: event that is set when rows are put into the empty queue.
    """

    def __init__(self, fd: int) -> None:
        self._map = map_memory(fd)
        view = memoryview(self._map)
        self._words = view[:_WORDS_BYTES].cast("Q")
        self._arena = view[_WORDS_BYTES:]
        self._room = len(self._arena)
        self._lock = threading.Lock()
        self.due = threading.Event()

    @property
    def rows(self) -> int:
        """Rows of the first file accepted so far: the number of the next one."""
        return self._words[_ROWS]

    @property
    def written(self) -> int:
        """Rows of the first file that are in it."""
        return self._words[_WRITTEN]

    @property
    def waiting_bytes(self) -> int:
        """Bytes that are not in their files yet."""
        return max(self._words[_HEAD] - self._words[_TAIL], 0)

    @property
    def lost(self) -> int:
        """Rows of all files dropped for lack of room."""
        return self._words[_LOST]

    def recover(self) -> bool:
        """Restore consistent counters after a process died at any point; return whether rows wait."""
        words = self._words
        if words[_TAIL] >= words[_HEAD]:
            words[_HEAD] = words[_TAIL] = 0
        place, waiting = words[_TAIL], 0
        while place < words[_HEAD]:
            number, length, rows, file = _ENTRY.unpack(self._read(place, _ENTRY.size))
            if not file:
                words[_ROWS] = number + rows
                waiting += rows
            place += _ENTRY.size + length
        words[_WRITTEN] = words[_ROWS] - waiting
        if waits := words[_HEAD] > words[_TAIL]:
            self.due.set()
        return waits

    def put(self, file: int, data: bytes, rows: int) -> int | None:
        """Append whole rows to the queue.

        Returns:
            The number of the first of them; None if there is no room: the rows are dropped and counted.
        """
        words, size = self._words, _ENTRY.size + len(data)
        with self._lock:
            head, tail, number = words[_HEAD], words[_TAIL], words[_ROWS]
            if size > self._room - (head - tail) - (0 if file else _RESERVE):
                words[_LOST] += rows
                return None
            self._write(head, _ENTRY.pack(number, len(data), rows, file) + data)
            words[_HEAD] = head + size
            if not file:
                words[_ROWS] = number + rows
        if head == tail:
            self.due.set()
        return number

    def oldest(self) -> Piece | None:
        """The oldest entries, about ``PIECE_BYTES`` of them, without removing them; None if the queue is empty."""
        with self._lock:
            place, head = self._words[_TAIL], self._words[_HEAD]
        if place == head:
            return None
        first_bytes = _ENTRY.size + _ENTRY.unpack(self._read(place, _ENTRY.size))[1]
        block = self._read(place, min(head - place, max(PIECE_BYTES, first_bytes)))
        at, parts, rows = 0, dict[int, list[bytes]](), dict[int, int]()
        while at + _ENTRY.size <= len(block):
            _, length, count, file = _ENTRY.unpack_from(block, at)
            stop = at + _ENTRY.size + length
            if stop > len(block):
                break
            parts.setdefault(file, []).append(block[at + _ENTRY.size : stop])
            rows[file] = rows.get(file, 0) + count
            at = stop
        return Piece(place + at, {file: b"".join(parts[file]) for file in sorted(parts)}, rows)

    def remove(self, piece: Piece) -> None:
        """Remove the oldest entries, which are in their files now."""
        words = self._words
        with self._lock:
            words[_TAIL] = piece.stop
            words[_WRITTEN] += piece.rows.get(0, 0)
            if words[_HEAD] > piece.stop:
                return
            words[_HEAD] = 0  # first, so that a process that dies between the two leaves nothing twice
            words[_TAIL] = 0
        if piece.stop > _TRIM_BYTES and hasattr(mmap, "MADV_REMOVE"):
            self._release_memory()

    def _release_memory(self) -> None:
        """Return the pages of the empty queue to the system."""
        with self._lock, contextlib.suppress(OSError):  # not supported everywhere: then the pages stay allocated
            if not self._words[_HEAD]:
                self._map.madvise(mmap.MADV_REMOVE, _WORDS_BYTES, self._room)

    def _write(self, place: int, data: bytes) -> None:
        at, stop = place % self._room, place % self._room + len(data)
        if stop <= self._room:
            self._arena[at:stop] = data
            return
        self._arena[at:] = data[: self._room - at]
        self._arena[: stop - self._room] = data[self._room - at :]

    def _read(self, place: int, size: int) -> bytes:
        at, stop = place % self._room, place % self._room + size
        if stop <= self._room:
            return bytes(self._arena[at:stop])
        return bytes(self._arena[at:]) + bytes(self._arena[: stop - self._room])
