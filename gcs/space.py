"""How long the disk will last."""

from __future__ import annotations

import math
from collections import deque

from gcs.snapshot import Event, Level

__all__ = ["SpaceForecast"]

WARN_MIN, ALARM_MIN = 10.0, 2.0
ALARM_BYTES = 200_000_000
CLEAR = 1.25
"""A level ends only when there is this much more than it asks for: no flicker at the edge."""
WINDOW_S, SHORTEST_S = 60.0, 5.0
"""Growth is measured over the last minute, and over five seconds at least."""


class SpaceForecast:
    """Minutes of recording left, from what is free and how fast it goes.

    Attributes:
        minutes_left: at the rate of the last minute; inf while nothing grows.
        level: what is to be said of it; None: nothing.
    """

    def __init__(self) -> None:
        self.minutes_left = math.inf
        self.level: Level | None = None
        self._seen: deque[tuple[float, int, int]] = deque()

    def update(self, now_s: float, t_us: int, free_bytes: int, written_bytes: int) -> tuple[Event, ...]:
        """Take a measurement, and tell when the level changes.

        Args:
            now_s: monotonic.
            t_us: Unix µs for the event.
            free_bytes: left on the disk.
            written_bytes: of the whole session so far, video included.
        """
        self._seen.append((now_s, free_bytes, written_bytes))
        while self._seen[0][0] < now_s - WINDOW_S:
            self._seen.popleft()
        then_s, then_free, then_written = self._seen[0]
        rate = 0.0
        if now_s - then_s >= SHORTEST_S:
            # others may fill the disk too: the faster of what we write and what goes
            rate = max(written_bytes - then_written, then_free - free_bytes, 0) / (now_s - then_s)
        self.minutes_left = free_bytes / rate / 60 if rate else math.inf
        level = self._judge(free_bytes)
        if level == self.level:
            return ()
        self.level = level
        megabytes = f"{free_bytes / 1e6:,.0f} MB free"
        left = "" if math.isinf(self.minutes_left) else f", {self.minutes_left:.1f} min at {rate / 1e6:.1f} MB/s"
        text = f"disk has room again: {megabytes}" if level is None else f"disk is filling up: {megabytes}{left}"
        return (Event(t_us=t_us, level=level or "info", kind="recording", text=text),)

    def _judge(self, free_bytes: int) -> Level | None:
        least = CLEAR if self.level == "alarm" else 1.0
        if self.minutes_left < ALARM_MIN * least or free_bytes < ALARM_BYTES * least:
            return "alarm"
        least = CLEAR if self.level is not None else 1.0
        return "warning" if self.minutes_left < WARN_MIN * least else None
