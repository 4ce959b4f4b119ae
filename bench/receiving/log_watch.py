"""Watches a telemetry log grow: records by system id, and the longest time without any."""

from __future__ import annotations

import threading
import time
from collections import Counter
from pathlib import Path

POLL_S = 0.05
STALL_S = 0.2
MAGICS = {0xFE: (8, 3), 0xFD: (12, 5)}
"""Length of a frame without its payload, and the offset of the system id."""


class LogWatch:
    """Follows ``telemetry*.tlog`` of one session folder from the outside, until closed.

    Growth is looked for twenty times a second. A stall is a longer time without it while the watch itself was awake;
    counting begins with the first record.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._read: dict[Path, int] = {}
        self._size = 0
        self._grown_s = 0.0
        self._polls = 0
        self._worst_s = 0.0
        self._since_s = 0.0
        self.stalls = 0
        """Times of more than 200 ms without growth."""
        self.longest_s = 0.0
        self.recorded: Counter[int] = Counter()
        """Records by system id."""
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)
        self._thread.start()

    def take_longest_s(self) -> float:
        """Longest time without growth since the last call."""
        worst, self._worst_s = self._worst_s, 0.0
        return worst

    def read(self) -> None:
        """Count what was recorded since the last call."""
        for path in sorted(self._folder.glob("telemetry*.tlog")):
            at = self._read.get(path, 0)
            with path.open("rb") as file:
                file.seek(at)
                data = file.read()
            self._read[path] = at + self._walk(data)

    def close(self) -> None:
        """Stop watching."""
        self._stop.set()
        self._thread.join()

    def _walk(self, data: bytes) -> int:
        """Bytes of whole records."""
        at, stop = 0, len(data)
        while at + 22 <= stop:
            bare, sender = MAGICS.get(data[at + 8], (0, 0))
            if not bare:
                raise ValueError(f"{self._folder}: no record at byte {at} of what was appended")
            end = at + 8 + bare + data[at + 9] + (13 if bare == 12 and data[at + 10] & 1 else 0)
            if end > stop:
                break
            self.recorded[data[at + 8 + sender]] += 1
            at = end
        return at

    def _watch(self) -> None:
        while not self._stop.wait(POLL_S):
            now = time.monotonic()
            size = sum(path.stat().st_size for path in self._folder.glob("telemetry*.tlog"))
            self._polls += 1
            if size <= self._size:
                continue
            gap_s = now - self._grown_s if self._grown_s else 0.0
            # long, and hardly a poll in it: it was this thread that slept
            if gap_s <= STALL_S or self._polls > 2:
                self._worst_s, self.longest_s = max(self._worst_s, gap_s), max(self.longest_s, gap_s)
                self.stalls += gap_s > STALL_S
            self._size, self._grown_s, self._polls = size, now, 0
