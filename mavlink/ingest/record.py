"""The log of a process that goes on where one before it has died: a segment of its own, and numbers that go on."""

from __future__ import annotations

from pathlib import Path

from mavlink.ingest.shared import Shared, Word
from mavlink.segments import segments
from mavlink.tlog_writer import TlogWriter

__all__ = ["open_log"]


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
    return TlogWriter(path, resume_after=records)
