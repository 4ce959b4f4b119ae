"""Counting what a link brings."""

from __future__ import annotations

import math
import time

from mavlink.links.report import LinkCounts
from mavlink.protocol.framing import FrameCounts


class Counters:
    """Running counts of one link: one thread writes, any thread may read."""

    def __init__(self) -> None:
        self._bytes = self._good = self._bad = self._junk = self._unknown = 0
        self._last_good_s: float | None = None

    def add(self, size: int, frames: FrameCounts) -> None:
        """Count received bytes and what was in them."""
        self._bytes += size
        self._good += frames.good
        self._bad += frames.bad
        self._junk += frames.junk_bytes
        self._unknown += frames.unknown
        if frames.good:
            self._last_good_s = time.monotonic()

    def snapshot(self, dropped: int = 0, turned_away: int = 0) -> LinkCounts:
        """The counts now, with those that the system keeps."""
        last_s = self._last_good_s
        return LinkCounts(
            packets=self._good + self._unknown,
            bytes=self._bytes,
            bad=self._bad,
            junk_bytes=self._junk,
            unknown=self._unknown,
            dropped=dropped,
            turned_away=turned_away,
            silent_s=math.inf if last_s is None else time.monotonic() - last_s,
        )
