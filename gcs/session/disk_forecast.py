"""How long the disk will last."""

from __future__ import annotations

import math
from collections import deque

__all__ = ["SpaceForecast"]

WINDOW_S, SHORTEST_S = 60.0, 5.0
"""Growth is measured over the last minute, and over five seconds at least."""


class SpaceForecast:
    """Remembers what was free and what was written in the last minute."""

    def __init__(self) -> None:
        self._seen: deque[tuple[float, int, int]] = deque()

    def update(self, now_s: float, free_bytes: int, written_bytes: int) -> float:
        """Take a measurement; seconds until the disk is full if it goes on so, inf while nothing grows.

        Args:
            now_s: monotonic.
            free_bytes: left on the disk.
            written_bytes: of the whole session so far, video included.
        """
        self._seen.append((now_s, free_bytes, written_bytes))
        while self._seen[0][0] < now_s - WINDOW_S:
            self._seen.popleft()
        then_s, then_free, then_written = self._seen[0]
        if now_s - then_s < SHORTEST_S:
            return math.inf
        # t = free / rate; others may fill the disk too: the faster of what we write and what goes
        grown = max(written_bytes - then_written, then_free - free_bytes, 0)
        return free_bytes * (now_s - then_s) / grown if grown else math.inf
