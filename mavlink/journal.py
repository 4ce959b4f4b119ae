"""Rows on their way to the disk, in shared memory: a disk that hangs holds nobody up, and who dies loses nothing.

One process at a time uses it, with two threads: one puts rows in, the other writes them to their files
(:class:`mavlink.scribe.Scribe`) and only then takes them out. When the process dies, the next one goes on with what is
there. Rows of several files are kept in the order in which they were put. Past the bound new rows are lost, and
counted; so those that are kept have numbers without gaps.
"""

from __future__ import annotations

import contextlib
import mmap
import os
import struct
import threading
from dataclasses import dataclass
from enum import IntEnum

from mavlink.append import RAM_BYTES
from mavlink.nameless import make_nameless

__all__ = ["Journal", "Piece", "make_journal"]

PIECE_BYTES = 1 << 18
"""Written at once: the disk then asks for few system calls and no row waits long for those before it."""
_RESERVE = 1 << 18
"""Kept free for the other files: a record is of use only with what is noted of it."""
_TRIM_BYTES = 1 << 20
"""Memory is given back once so much was used."""
_WORDS_BYTES = 4096
_HEAD = struct.Struct("=QIIB")
"""Before each entry: number of its first row, bytes, rows, file."""


class _Word(IntEnum):
    """Counters, eight bytes each."""

    HEAD = 0
    """Bytes put in; with ``TAIL`` back to nought whenever nothing waits."""
    TAIL = 1
    """Bytes taken out."""
    ROWS = 2
    """Rows of the first file ever put in."""
    WRITTEN = 3
    """Of those, rows that are in the file."""
    LOST = 4
    """Rows of all files for which there was no room."""


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
    return make_nameless(_WORDS_BYTES + size)


class Journal:
    """One process's view of the memory.

    Args:
        fd: from :func:`make_journal`; stays the caller's.

    Attributes:
        due: set when rows come while none waited.
    """

    def __init__(self, fd: int) -> None:
        size = os.fstat(fd).st_size
        self._map = mmap.mmap(fd, size)
        self._view = memoryview(self._map)
        self._words = self._view[:_WORDS_BYTES].cast("Q")
        self._arena = self._view[_WORDS_BYTES:]
        self._room = size - _WORDS_BYTES
        self._used = 0
        self._lock = threading.Lock()
        self.due = threading.Event()

    @property
    def rows(self) -> int:
        """Rows of the first file ever accepted: the number of the next one."""
        return self._words[_Word.ROWS]

    @property
    def written(self) -> int:
        """Of those, rows that are in the file."""
        return self._words[_Word.WRITTEN]

    @property
    def waiting_bytes(self) -> int:
        """Bytes that are only here."""
        return max(self._words[_Word.HEAD] - self._words[_Word.TAIL], 0)

    @property
    def lost(self) -> int:
        """Rows of all files for which there was no room."""
        return self._words[_Word.LOST]

    def close(self) -> None:
        """Lets go of the memory."""
        self._words.release()
        self._arena.release()
        self._view.release()
        self._map.close()

    def take_over(self) -> bool:
        """Puts in order what a process left that died at any moment; whether rows wait."""
        words = self._words
        if words[_Word.TAIL] >= words[_Word.HEAD]:
            words[_Word.HEAD] = words[_Word.TAIL] = 0
        place, waiting = words[_Word.TAIL], 0
        while place < words[_Word.HEAD]:
            number, length, rows, file = _HEAD.unpack(self._read(place, _HEAD.size))
            if not file:
                words[_Word.ROWS] = number + rows
                waiting += rows
            place += _HEAD.size + length
        words[_Word.WRITTEN] = words[_Word.ROWS] - waiting
        self._used = words[_Word.HEAD]
        if self._used:
            self.due.set()
        return bool(self._used)

    def put(self, file: int, data: bytes, rows: int) -> int | None:
        """Accepts whole rows.

        Args:
            file: index of the file; the rows of the first are numbered.
            data: the rows.
            rows: how many.

        Returns:
            The number of the first of them, None when there is no room: they are lost, and counted.
        """
        words, size = self._words, _HEAD.size + len(data)
        with self._lock:
            head, tail, number = words[_Word.HEAD], words[_Word.TAIL], words[_Word.ROWS]
            if size > self._room - (head - tail) - (0 if file else _RESERVE):
                words[_Word.LOST] += rows
                return None
            entry, at = _HEAD.pack(number, len(data), rows, file) + data, head % self._room
            first = min(size, self._room - at)
            self._arena[at : at + first] = entry[:first]
            self._arena[: size - first] = entry[first:]
            words[_Word.HEAD] = head + size
            if not file:
                words[_Word.ROWS] = number + rows
            self._used = max(self._used, head + size)
        if head == tail:
            self.due.set()
        return number

    def oldest(self) -> Piece | None:
        """The entries that have waited longest, about ``PIECE_BYTES`` of them; they stay until :meth:`done`."""
        with self._lock:
            place, head = self._words[_Word.TAIL], self._words[_Word.HEAD]
        if place == head:
            return None
        stop, data, rows = min(head, place + PIECE_BYTES), dict[int, bytearray](), dict[int, int]()
        while place < stop:
            _, length, count, file = _HEAD.unpack(self._read(place, _HEAD.size))
            data.setdefault(file, bytearray()).extend(self._read(place + _HEAD.size, length))
            rows[file] = rows.get(file, 0) + count
            place += _HEAD.size + length
        return Piece(place, {file: bytes(data[file]) for file in sorted(data)}, rows)

    def done(self, piece: Piece) -> None:
        """They are in their files."""
        words = self._words
        with self._lock:
            words[_Word.TAIL] = piece.stop
            words[_Word.WRITTEN] += piece.rows.get(0, 0)
            if words[_Word.HEAD] > piece.stop:
                return
            words[_Word.HEAD] = 0  # first, so that a process that dies between the two leaves nothing twice
            words[_Word.TAIL] = 0
            used, self._used = self._used, 0
        if used > _TRIM_BYTES and hasattr(mmap, "MADV_REMOVE"):
            self._give_back()

    def _give_back(self) -> None:
        """The memory of a long wait."""
        with self._lock, contextlib.suppress(OSError):  # where the system cannot, it stays ours
            if not self._words[_Word.HEAD]:
                self._map.madvise(mmap.MADV_REMOVE, _WORDS_BYTES, self._room)

    def _read(self, place: int, size: int) -> bytes:
        at = place % self._room
        first = min(size, self._room - at)
        return bytes(self._arena[at : at + first]) + bytes(self._arena[: size - first])
