"""Text files written line by line. Those of a job end with an error; those of a flight go on.

A flight's lines outlive a full or failing disk, and a disk that hangs blocks nothing.
"""

from __future__ import annotations

import threading
from dataclasses import replace
from pathlib import Path
from typing import Protocol, TextIO

from gcs.errors import SessionError
from infra.files.append import AppendFile
from infra.files.disk import OS_DISK, Disk
from infra.files.record_state import RecordState
from infra.files.write_buffer import Chunk, WriteBuffer

RAM_BYTES = 16 << 20
"""Memory for lines that wait, bytes: over a minute of the evidence of twenty boxes at thirty frames a second."""
HANG_S = 5.0
"""Time that closing waits for a disk that hangs, counted from when it began to, s."""


class Lines(Protocol):
    """A text file that takes whole lines."""

    def write(self, text: str, /) -> object:
        """Append lines."""

    def flush(self) -> None:
        """Hand them to the system."""

    def close(self) -> None:
        """Close the file."""


def open_new(path: Path, header: str = "") -> TextIO:
    """Open a file for writing that must not exist yet; an error ends who writes, as in a job without a flight."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        file = path.open("x", encoding="utf-8", newline="\n")
        file.write(header)
        return file
    except FileExistsError:
        raise SessionError(f"{path}: exists already and is never overwritten; choose another place") from None
    except OSError as error:
        raise SessionError(f"{path}: cannot be written: {error.strerror}") from error


class LineFile:
    """Takes whole lines, which a thread of its own writes; only making the file can fail.

    Args:
        path: must not exist; nothing recorded is ever overwritten.
        header: first line of every segment, with its line end.
        disk: the operating system, or a test's.

    Raises:
        SessionError: the file exists or cannot be made.
    """

    def __init__(self, path: Path, header: str = "", *, disk: Disk = OS_DISK, lazy: bool = False) -> None:
        try:
            self.file = AppendFile(path, header=header.encode(), ram_bytes=RAM_BYTES, lazy=lazy, disk=disk)
        except OSError as error:
            raise SessionError(f"{path}: cannot be made: {error.strerror}; choose another place") from error
        self._changed = threading.Condition()  # all that follows
        self._waiting = WriteBuffer(RAM_BYTES)
        self._in_hand: Chunk | None = None
        self._closing = self._abandoned = False
        self._thread = threading.Thread(target=self._run, name=path.name, daemon=True)
        self._thread.start()

    def write(self, text: str, /) -> None:
        """Append whole lines; they are with the system soon."""
        if text:
            with self._changed:
                self._waiting.append(text.encode(errors="replace"), text.count("\n"))
                self._changed.notify_all()

    def flush(self) -> None:
        """Do nothing: what was written is on its way."""

    def settle(self, timeout_s: float) -> bool:
        """Wait until the system has all lines, or has refused them; whether it has."""
        with self._changed:
            return self._changed.wait_for(lambda: not self._waiting and self._in_hand is None, timeout_s)

    def close(self) -> None:
        """Write what still waits and close; ``state`` then has what was lost."""
        with self._changed:
            self._closing = True
            self._changed.notify_all()
        self._thread.join(max(HANG_S - self.file.state.stalled_s, 0.0))
        self._abandoned = self._thread.is_alive()
        if not self._abandoned:
            self.file.close()

    @property
    def state(self) -> RecordState:
        """State of the file."""
        with self._changed:
            state, held, dropped = self.file.state, self._in_hand, self._waiting.dropped
            rows = self._waiting.rows + (held.rows if held else 0)
            size = self._waiting.bytes + (len(held.data) if held else 0)
        if self._abandoned:
            return replace(state, lost=state.lost + dropped + rows)
        return replace(
            state, waiting=state.waiting + rows, waiting_bytes=state.waiting_bytes + size, lost=state.lost + dropped
        )

    def _run(self) -> None:
        """Write pieces as they come: this thread alone waits for the disk."""
        while True:
            with self._changed:
                self._in_hand = None
                self._changed.notify_all()
                self._changed.wait_for(lambda: self._waiting or self._closing)
                if not self._waiting:
                    return
                piece = self._in_hand = self._waiting.pop()
            self.file.write(bytes(piece.data), piece.rows)
