"""The log of a process that goes on where one before it has died: a segment of its own, and numbers that go on."""

from __future__ import annotations

from pathlib import Path

from mavlink.append import AppendFile
from mavlink.caretaker import Caretaker
from mavlink.clock_watch import ClockWatch
from mavlink.ingest.shared import Shared, Word
from mavlink.segments import segments
from mavlink.tlog_writer import CLOCK_COLUMNS, REFUSED_COLUMNS, SYNC_S, TlogWriter

__all__ = ["NextLog", "open_log"]


class NextLog(TlogWriter):
    """Appends to a log that exists, in the next segment that is free.

    Args:
        path: of the first segment.
        records: how many the segments so far have.
    """

    def __init__(self, path: Path, records: int) -> None:
        self.path = path
        self._log = AppendFile(path, lazy=True)
        self._log.write(b"", records)  # no bytes: only the numbers go on
        self._refused = _table(path.with_name("refused.csv"), REFUSED_COLUMNS)
        self._clock_steps = _table(path.with_name("clock.csv"), CLOCK_COLUMNS)
        self._clock = ClockWatch()
        self._caretaker = Caretaker((self._log, self._refused, self._clock_steps), SYNC_S)


def open_log(path: Path, generation: int, memory: Shared) -> TlogWriter:
    """The log of a process.

    Args:
        path: of the first segment.
        generation: of the process; only the first makes a new log.
        memory: knows what those before it have written.

    Raises:
        TlogError: the first process finds a log, or cannot make one.
    """
    if generation == 1:
        return TlogWriter(path)
    words = memory.words
    size = sum(segment.stat().st_size for segment in segments(path))
    records = words[Word.RECORDS] - min(words[Word.WAITING], words[Word.RECORDS])
    if size > words[Word.LOG_BYTES]:  # it died between writing and counting
        records += words[Word.PENDING]
    words[Word.RECORDS], words[Word.LOG_BYTES], words[Word.PENDING] = records, size, 0
    return NextLog(path, records)


def _table(path: Path, columns: tuple[str, ...]) -> AppendFile:
    return AppendFile(path, header=(",".join(columns) + "\n").encode(), ram_bytes=8 << 20, lazy=True)
