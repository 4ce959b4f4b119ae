"""Rows on their way to the disk, in shared memory: a disk that hangs holds nobody up, and who dies loses nothing.

One process at a time uses it, with two threads: one puts rows in, the other writes them to their files
(:class:`infra.files.journal_writer.JournalWriter`) and only then takes them out. When the process dies, the next one
goes on with what is there; the end of the one and the start of the other order the memory of both. Rows of several
files are kept in the order in which they were put. Past the bound new rows are lost, and counted; so those that are
kept have numbers without gaps.
"""

from __future__ import annotations

import contextlib
import mmap
import struct
import threading
from dataclasses import dataclass

from infra.files.append import RAM_BYTES
from infra.shared_memory import make_memory, map_memory

__all__ = ["PIECE_BYTES", "Journal", "Piece", "make_journal"]

PIECE_BYTES = 1 << 18
"""Written at once: the disk then asks for few system calls and no row waits long for those before it."""
_RESERVE = 1 << 18
"""Kept free for the other files: a record is of use only with what is noted of it."""
_TRIM_BYTES = 1 << 20
"""Memory is given back once so much was used."""
_WORDS_BYTES = 4096
_ENTRY = struct.Struct("=QIIB")
"""Before each entry: number of its first row, bytes, rows, file."""


_HEAD, _TAIL, _ROWS, _WRITTEN, _LOST = range(5)
"""Counters of eight bytes each: bytes put in and bytes taken out, both back to nought whenever nothing waits; rows of
the first file ever put in, and of those the ones that are in it; rows of all files for which there was no room."""


@dataclass(frozen=True, slots=True)
class Piece:
    """The entries that have waited longest."""

    stop: int
    """Where they end."""
    data: dict[int, bytes]
    """File → whole rows, in order."""
    rows: dict[int, int]
    """File → how many."""


def make_journal(size: int = RAM_BYTES) -> int:
    """A file descriptor of memory for a new journal.

    Args:
        size: bytes that may wait.

    Raises:
        OSError: no memory is left.
    """
    return make_memory(_WORDS_BYTES + size)


class Journal:
    """One process's view of the memory.

    Args:
        fd: from :func:`make_journal`; stays the caller's.

    Attributes:
        due: set when rows come while none waited.
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
        """Rows of the first file ever accepted: the number of the next one."""
        return self._words[_ROWS]

    @property
    def written(self) -> int:
        """Of those, rows that are in the file."""
        return self._words[_WRITTEN]

    @property
    def waiting_bytes(self) -> int:
        """Bytes that are only here."""
        return max(self._words[_HEAD] - self._words[_TAIL], 0)

    @property
    def lost(self) -> int:
        """Rows of all files for which there was no room."""
        return self._words[_LOST]

    def take_over(self) -> bool:
        """Puts in order what a process left that died at any moment; whether rows wait."""
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
        """Accepts whole rows.

        Args:
            file: index of the file; the rows of the first are numbered.
            data: the rows.
            rows: how many.

        Returns:
            The number of the first of them, None when there is no room: they are lost, and counted.
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
        """The entries that have waited longest, about ``PIECE_BYTES`` of them; they stay until :meth:`done`."""
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

    def done(self, piece: Piece) -> None:
        """They are in their files."""
        words = self._words
        with self._lock:
            words[_TAIL] = piece.stop
            words[_WRITTEN] += piece.rows.get(0, 0)
            if words[_HEAD] > piece.stop:
                return
            words[_HEAD] = 0  # first, so that a process that dies between the two leaves nothing twice
            words[_TAIL] = 0
        if piece.stop > _TRIM_BYTES and hasattr(mmap, "MADV_REMOVE"):
            self._give_back()

    def _give_back(self) -> None:
        """The memory of a long wait."""
        with self._lock, contextlib.suppress(OSError):  # where the system cannot, it stays ours
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
