"""Memory that several processes share: a ring of records and the newest value of something, each with one writer.

**Memory ordering.** The stores of one process may become visible to another in a different order than they were made
(on ARM and POWER, not on x86), and CPython has no release store or acquire load for shared memory. So nothing here
relies on their order: every record carries a checksum over its bytes and its position, and a reader that sees a cursor
before the bytes, or bytes from an earlier round of the ring, finds that it does not match and looks again later. The
other way round, a reader moves its cursor, which allows the writer to overwrite, only after it has compared the
checksum of its own copy: a store that depends on a branch is not made before the loads that decide it on any CPU
("Control dependencies" in the Linux kernel's ``memory-barriers.txt``). Cursors are aligned words of eight bytes, which
64-bit CPUs load and store in one piece. What passes through a pipe or follows the end of a process needs no such care:
system calls order memory.
"""

from __future__ import annotations

import mmap
import os
import struct
import tempfile
from zlib import crc32

_HEAD = struct.Struct("=II")
"""Header of each record or value: its length and its checksum."""
_CURSORS_BYTES = 16
_WRITTEN, _READ = 0, 1
"""Bytes ever put into a ring and taken out of it: cursors only grow, their place is the remainder."""
_SEED_MASK = (1 << 32) - 1


def make_memory(size: int) -> int:
    """A file descriptor of ``size`` zero bytes without a name: they go with the last process that has them open.

    Raises:
        OSError: no memory is left.
    """
    if hasattr(os, "memfd_create"):
        fd = os.memfd_create("rollcall")
    else:
        with tempfile.TemporaryFile() as file:
            fd = os.dup(file.fileno())
    os.ftruncate(fd, size)
    return fd


def map_memory(fd: int) -> mmap.mmap:
    """Map all bytes behind a file descriptor, which stays the caller's."""
    return mmap.mmap(fd, os.fstat(fd).st_size)


class Ring:
    """Records from one process to another, in order; one process puts, one takes.

    Args:
        memory: the same bytes in both, all zero at first; its start must be aligned to eight bytes.
    """

    def __init__(self, memory: memoryview) -> None:
        self._cursors = memory[:_CURSORS_BYTES].cast("Q")
        self._arena = memory[_CURSORS_BYTES:]
        self._room = len(self._arena)

    @property
    def written(self) -> int:
        """Bytes ever put in: where the next record will begin."""
        return self._cursors[_WRITTEN]

    @property
    def read(self) -> int:
        """Bytes ever taken out: all records before that position."""
        return self._cursors[_READ]

    def put(self, record: bytes) -> bool:
        """Put in a record, which must not be empty; False where there is no room for it."""
        written, room = self._cursors[_WRITTEN], self._room
        data = _HEAD.pack(len(record), crc32(record, written & _SEED_MASK)) + record
        if len(data) > room - (written - self._cursors[_READ]):
            return False
        at = written % room
        first = min(len(data), room - at)
        self._arena[at : at + first] = data[:first]
        self._arena[: len(data) - first] = data[first:]
        self._cursors[_WRITTEN] = written + len(data)
        return True

    def read_records(self) -> list[bytes]:
        """Take all records that can be seen whole out of the ring, oldest first."""
        written, position = self._cursors[_WRITTEN], self._cursors[_READ]
        if written == position:
            return []
        at, size = position % self._room, written - position
        first = min(size, self._room - at)
        data = bytes(self._arena[at : at + first]) + bytes(self._arena[: size - first])
        records: list[bytes] = []
        place = 0
        while place + _HEAD.size <= size:
            length, checksum = _HEAD.unpack_from(data, place)
            start = place + _HEAD.size
            record = data[start : start + length]
            if not length or len(record) < length or crc32(record, (position + place) & _SEED_MASK) != checksum:
                break  # the cursor became visible before the bytes: next time
            records.append(record)
            place = start + length
        self._cursors[_READ] = position + place
        return records


class NewestValue:
    """The newest of the values that one process puts and others look at.

    Args:
        memory: the same bytes in all of them.
    """

    def __init__(self, memory: memoryview) -> None:
        self._memory = memory

    def put(self, value: bytes) -> bool:
        """Replace the value; False where there is no room for it, then the one before stays."""
        stop = _HEAD.size + len(value)
        if stop > len(self._memory):
            return False
        self._memory[:stop] = _HEAD.pack(len(value), crc32(value)) + value
        return True

    def get(self) -> bytes | None:
        """The value; None where there is none or it is just being replaced."""
        length, checksum = _HEAD.unpack_from(self._memory)
        value = bytes(self._memory[_HEAD.size : _HEAD.size + length])
        return value if value and len(value) == length and crc32(value) == checksum else None
