"""Faults of the program itself in flight: counted, shown, written with their tracebacks; none of them ends a flight."""

from __future__ import annotations

import contextlib
import logging
import os
import threading
import time
import traceback
from pathlib import Path

from infra.files.safe_open import open_to_append
from infra.plain_text import plain
from infra.secrets import conceal

_log = logging.getLogger(__name__)

LASTING = 20
"""Number of faults of one job in a row that mean that it does not work any more."""
MAX_KEPT = 100
_WAIT_S = 0.2
"""Time that a traceback may take to be written, s; on a disk that hangs it is written later."""


class Faults:
    """Log of faults in a flight's jobs; its methods may be called from any thread.

    Args:
        path: where tracebacks go, each place in the program once; made with the first.

    Attributes:
        count: faults so far.
        last: the latest one in words.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._kept: set[tuple[str, int]] = set()
        self._failing: dict[str, tuple[int, str]] = {}
        self.count = 0
        self.last = ""

    def record(self, job: str, error: Exception) -> None:
        """Count a fault, and write its traceback if it is the first at its place in the program.

        Args:
            job: a few words: what was being done.
        """
        self.count += 1
        self.last = conceal(f"{job}: {type(error).__name__}: {error}")
        frames = traceback.extract_tb(error.__traceback__)
        place = (frames[-1].filename, frames[-1].lineno or 0) if frames else ("", 0)
        if place not in self._kept and len(self._kept) < MAX_KEPT:
            self._kept.add(place)
            _log.error("fault while %s", job, exc_info=error)
            self._write_traceback(job, error)

    def turn_failed(self, job: str, error: Exception) -> None:
        """Note that a turn of a job that is repeated failed."""
        self.record(job, error)
        times, _ = self._failing.get(job, (0, ""))
        self._failing[job] = times + 1, self.last

    def turn_succeeded(self, job: str) -> None:
        """Note that a turn of a job succeeded."""
        self._failing.pop(job, None)

    @property
    def persistent(self) -> str:
        """The job that does not work any more and why, empty while all do."""
        return next((words for times, words in tuple(self._failing.values()) if times >= LASTING), "")

    def _write_traceback(self, job: str, error: Exception) -> None:
        text = f"{time.strftime('%FT%TZ', time.gmtime())} {job}\n{''.join(traceback.format_exception(error))}\n"
        data = conceal("\n".join(map(plain, text.split("\n")))).encode()
        writing = threading.Thread(target=self._append, args=(data,), name="faults", daemon=True)
        writing.start()
        writing.join(_WAIT_S)

    def _append(self, data: bytes) -> None:
        # a fault must not fail on a full disk, nor wait for one that hangs
        with contextlib.suppress(OSError), os.fdopen(open_to_append(self._path, links=False), "ab") as file:
            file.write(data)
