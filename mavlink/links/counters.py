"""Counting what a link brings."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

from mavlink.protocol.framing import FrameCounts

__all__ = ["LinkCounts", "Tally", "now_us"]


def now_us() -> int:
    """Unix µs now."""
    return time.time_ns() // 1000


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkCounts:
    """What a link has brought so far."""

    packets: int = 0
    """Good frames, and those of unknown messages."""
    bytes: int = 0
    bad: int = 0
    """Frames with a wrong checksum."""
    junk_bytes: int = 0
    unknown: int = 0
    """Frames of unknown messages among the packets."""
    dropped: int = 0
    """Datagrams that the system threw away because nobody read them in time."""
    turned_away: int = 0
    """Datagrams of strangers that were not let in while they came in masses."""
    silent_s: float = math.inf
    """Since the last packet, inf before the first."""


class Tally:
    """Running counts of one link: one thread writes, any thread may read :attr:`counts`."""

    def __init__(self) -> None:
        self._bytes = self._good = self._bad = self._junk = self._unknown = 0
        self._heard_s: float | None = None

    def take(self, size: int, frames: FrameCounts) -> None:
        """Counts received bytes and what was in them."""
        self._bytes += size
        self._good += frames.good
        self._bad += frames.bad
        self._junk += frames.junk_bytes
        self._unknown += frames.unknown
        if frames.good:
            self._heard_s = time.monotonic()

    @property
    def counts(self) -> LinkCounts:
        """The counts now."""
        return self.told()

    def told(self, dropped: int = 0, turned_away: int = 0) -> LinkCounts:
        """The counts now, with those that the system keeps."""
        heard_s = self._heard_s
        return LinkCounts(
            packets=self._good + self._unknown,
            bytes=self._bytes,
            bad=self._bad,
            junk_bytes=self._junk,
            unknown=self._unknown,
            dropped=dropped,
            turned_away=turned_away,
            silent_s=math.inf if heard_s is None else time.monotonic() - heard_s,
        )
