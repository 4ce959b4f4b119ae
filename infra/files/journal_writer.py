"""The thread that brings rows from a journal to their files. It alone waits for the disk."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from infra.files.append import AppendFile
from infra.files.journal import PIECE_BYTES, Journal, Piece
from infra.files.segment import segments

GATHER_S = 0.04
"""Rows of this long are written together: fewer system calls. Until then they are in memory that outlives the
process."""
HANG_S = 60.0
"""A disk that hangs is waited for this long at the end: as long as memory lasts; a station that lives waits less."""
_LOOK_S = 0.1
"""Seconds between checks whether a disk that failed takes rows again."""


class JournalWriter:
    """Thread that writes a journal's rows to files until it is stopped.

    Args:
        journal: where rows wait.
        files: by the journal's index.
        whole: for a file's index and some bytes from the beginning of a row: the length of the whole rows in them.
        goes_on: rows may wait that a process before this one had begun to write.
    """

    def __init__(
        self, journal: Journal, files: Sequence[AppendFile], whole: Callable[[int, bytes], int], *, goes_on: bool
    ) -> None:
        self._journal, self._files, self._whole = journal, files, whole
        self._goes_on = goes_on
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="journal writer", daemon=True)
        self._thread.start()

    def stop(self) -> bool:
        """Have everything written and end; return whether that was possible: a disk that hangs is left after a
        minute."""
        self._stop.set()
        self._journal.due.set()
        self._thread.join(HANG_S)
        return not self._thread.is_alive()

    def _run(self) -> None:
        journal = self._journal
        while not self._stop.is_set():
            journal.due.wait()
            journal.due.clear()
            time.sleep(GATHER_S)
            while (piece := journal.oldest()) is not None:
                if self._goes_on:
                    piece = self._without_written(piece)
                    self._goes_on = False
                self._bring(piece)
                if journal.waiting_bytes < PIECE_BYTES and not self._stop.is_set():
                    time.sleep(GATHER_S)  # rather than to be woken for each batch

    def _bring(self, piece: Piece) -> None:
        """Write rows, and wait until a disk that does not take them does."""
        for file, data in piece.data.items():
            if data:
                self._files[file].write(data, piece.rows[file])
        while any(self._files[file].has_waiting_rows for file in piece.data) and not self._stop.wait(_LOOK_S):
            continue  # the flusher repairs
        self._journal.remove(piece)

    def _without_written(self, piece: Piece) -> Piece:
        """Rest of the oldest rows that is not yet in the files of a process that died while it wrote them.

        A file then ends with the first bytes of what waits. A row that was torn there is written again, whole.
        """
        data = {
            file: data[self._whole(file, data[: _written(self._files[file].path, data)]) :]
            for file, data in piece.data.items()
        }
        return Piece(piece.stop, data, piece.rows)


def _written(path: Path, data: bytes) -> int:
    """Number of the waiting bytes that are already at the end of a file's last segment."""
    try:
        with segments(path)[-1].open("rb") as file:
            size = file.seek(0, 2)
            file.seek(max(size - len(data), 0))
            tail = file.read()
    except (OSError, IndexError):
        return 0
    start, mark = 0, data[:8]
    while (start := tail.find(mark, start)) >= 0:
        if data.startswith(tail[start:]):
            return len(tail) - start
        start += 1
    return 0
