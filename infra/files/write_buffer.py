"""Rows that wait in memory, oldest first."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

CHUNK_BYTES = 1 << 16
"""Rows are kept in chunks of about this size: a hundred times fewer objects than rows."""


@dataclass(slots=True)
class Chunk:
    """Some whole rows."""

    data: bytearray
    rows: int


class WriteBuffer:
    """Whole rows in order, bounded in bytes: past the bound the oldest chunk goes and is counted.

    Attributes:
        bytes: held.
        rows: held.
        dropped: rows that went because of the bound.
    """

    def __init__(self, most_bytes: int) -> None:
        self.bytes = self.rows = self.dropped = 0
        self._most_bytes = most_bytes
        self._chunks: deque[Chunk] = deque()

    def __bool__(self) -> bool:
        return bool(self._chunks)

    def append(self, data: bytes | bytearray, rows: int) -> None:
        """Put rows behind the others."""
        last = self._chunks[-1] if self._chunks else None
        if last is not None and len(last.data) + len(data) <= CHUNK_BYTES:
            last.data += data
            last.rows += rows
        else:
            self._chunks.append(Chunk(bytearray(data), rows))
        self._count(len(data), rows)

    def pop(self) -> Chunk:
        """Take the oldest chunk out."""
        chunk = self._chunks.popleft()
        self.bytes -= len(chunk.data)
        self.rows -= chunk.rows
        return chunk

    def put_back(self, chunk: Chunk) -> None:
        """Put a chunk before all others."""
        self._chunks.appendleft(chunk)
        self._count(len(chunk.data), chunk.rows)

    def put_before(self, older: WriteBuffer) -> None:
        """Put all that another buffer holds before this one's rows; rows that it had dropped stay counted."""
        self.dropped += older.dropped
        for chunk in reversed(older._chunks):
            self._chunks.appendleft(chunk)
        self._count(older.bytes, older.rows)

    def _count(self, more_bytes: int, more_rows: int) -> None:
        self.bytes += more_bytes
        self.rows += more_rows
        while self.bytes > self._most_bytes and len(self._chunks) > 1:
            self.dropped += self.pop().rows
