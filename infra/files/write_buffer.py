"""Rows that wait in memory, oldest first."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

__all__ = ["Backlog", "Piece"]

PIECE_BYTES = 1 << 16
"""Rows are kept in pieces of about this size: a hundred times fewer objects than rows."""


@dataclass(slots=True)
class Piece:
    """Some whole rows."""

    data: bytearray
    rows: int


class Backlog:
    """Whole rows in order, bounded in bytes: past the bound the oldest piece goes and is counted.

    Attributes:
        bytes: held.
        rows: held.
        dropped: rows that went because of the bound.
    """

    def __init__(self, most_bytes: int) -> None:
        self.bytes = self.rows = self.dropped = 0
        self._most_bytes = most_bytes
        self._pieces: deque[Piece] = deque()

    def __bool__(self) -> bool:
        return bool(self._pieces)

    def append(self, data: bytes | bytearray, rows: int) -> None:
        """Put rows behind the others."""
        last = self._pieces[-1] if self._pieces else None
        if last is not None and len(last.data) + len(data) <= PIECE_BYTES:
            last.data += data
            last.rows += rows
        else:
            self._pieces.append(Piece(bytearray(data), rows))
        self._count(len(data), rows)

    def pop(self) -> Piece:
        """Take the oldest piece out."""
        piece = self._pieces.popleft()
        self.bytes -= len(piece.data)
        self.rows -= piece.rows
        return piece

    def put_back(self, piece: Piece) -> None:
        """Put a piece before all others."""
        self._pieces.appendleft(piece)
        self._count(len(piece.data), piece.rows)

    def put_before(self, older: Backlog) -> None:
        """Put all that another backlog holds before this one's rows; rows that it had dropped stay counted."""
        self.dropped += older.dropped
        for piece in reversed(older._pieces):
            self._pieces.appendleft(piece)
        self._count(older.bytes, older.rows)

    def _count(self, more_bytes: int, more_rows: int) -> None:
        self.bytes += more_bytes
        self.rows += more_rows
        while self.bytes > self._most_bytes and len(self._pieces) > 1:
            self.dropped += self.pop().rows
