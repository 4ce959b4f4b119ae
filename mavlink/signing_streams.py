"""What is remembered of every signed stream: its newest timestamp, and the time that it proves.

A stream is (system, component, link id); the table is common to all links, or a frame of one could be replayed on
another. Times are ticks of 10 µs since 2015-01-01 UTC (https://mavlink.io/en/guide/message_signing.html).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

__all__ = ["AHEAD", "BEHIND", "EPOCH_US", "MOST_STREAMS", "SECOND", "Row", "Streams", "ticks_of"]

EPOCH_US = 1_420_070_400_000_000
"""2015-01-01 UTC, Unix µs."""
SECOND = 100_000
"""Ticks."""
AHEAD = 65 * SECOND
"""A timestamp further ahead of this computer's clock is refused. ArduPilot signs a minute ahead on purpose (59.95 s
measured); five seconds more are for a computer's clock that is slow. A vehicle whose clock was wrong by less than this
is heard again after as long at most."""
BEHIND = 60 * SECOND
"""A stream never heard before may be this far behind."""
MOST_STREAMS = 16_384
_DELAYED = 5 * SECOND
"""A frame that comes so much later than the quickest was not under way so long: its sender's clock has changed."""


def ticks_of(t_us: int) -> int:
    """Unix µs as ticks."""
    return (t_us - EPOCH_US) // 10


class Row(NamedTuple):
    """One stream."""

    system_id: int
    component_id: int
    link_id: int
    timestamp: int
    """Of its newest frame."""
    heard: int
    """When that came, or would have come if it had been under way no longer than the quickest frame of its stream."""


class Streams:
    """The table of streams. Only who has a key gets in; who fills it up throws out streams of its own."""

    def __init__(self) -> None:
        # by system, then by component << 8 | link id: timestamp of the newest frame, and when that came, as in Row
        self._of: list[dict[int, tuple[int, int]]] = [{} for _ in range(256)]
        self._count = 0
        self.births = 0
        """Streams ever added."""
        self.proven = 0
        """It was later than this when the newest accepted frame came: its timestamp less what senders may be ahead."""

    def __len__(self) -> int:
        return self._count

    def newest(self, system_id: int, component_id: int, link_id: int) -> int | None:
        """The last timestamp of a stream, None for one never heard."""
        known = self._of[system_id].get(component_id << 8 | link_id)
        return known[0] if known else None

    def admit(self, system_id: int, component_id: int, link_id: int, timestamp: int, now: int) -> bool:
        """Keeps the timestamp of a verified frame, if it is newer than the last of its stream.

        That of a stream never heard may be :data:`BEHIND` now at most.
        """
        streams, stream = self._of[system_id], component_id << 8 | link_id
        known = streams.get(stream)
        if known is None:
            if timestamp < now - BEHIND:
                return False
            self._add()
        elif timestamp <= known[0]:
            return False
        heard = known[1] + timestamp - known[0] if known else now
        streams[stream] = timestamp, heard if 0 <= now - heard < _DELAYED else now
        if timestamp > self.proven + AHEAD:
            self.proven = timestamp - AHEAD
        return True

    def restore(self, row: Row) -> None:
        """Puts back what was remembered of a stream."""
        streams, stream = self._of[row.system_id], row.component_id << 8 | row.link_id
        if stream not in streams:
            self._add()
        streams[stream] = row.timestamp, row.heard

    def rows(self) -> Iterator[Row]:
        """Every stream; another thread may go on adding."""
        for system_id, streams in enumerate(self._of):
            for stream, (timestamp, heard) in streams.copy().items():  # copied in one step
                yield Row(system_id, stream >> 8, stream & 0xFF, timestamp, heard)

    def _add(self) -> None:
        """Makes room for one more."""
        if self._count >= MOST_STREAMS:
            crowd = max(self._of, key=len)
            del crowd[next(iter(crowd))]
            self._count -= 1
        self._count += 1
        self.births += 1
