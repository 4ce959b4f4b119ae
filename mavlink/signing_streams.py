"""What is remembered of every signed stream: its newest timestamp, and the time that it proves.

A stream is (system, component, link id); the table is common to all links, or a frame of one could be replayed on
another. Times are ticks of 10 µs since 2015-01-01 UTC (https://mavlink.io/en/guide/message_signing.html).
"""

from __future__ import annotations

from collections.abc import Iterator

__all__ = ["AHEAD", "BEHIND", "EPOCH_US", "MOST_STREAMS", "SECOND", "Streams", "ticks_of"]

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


def ticks_of(t_us: int) -> int:
    """Unix µs as ticks."""
    return (t_us - EPOCH_US) // 10


class Streams:
    """The table of streams. Only who has a key gets in; who fills it up throws out streams of its own."""

    def __init__(self) -> None:
        self._of: list[dict[int, int]] = [{} for _ in range(256)]  # by system: component << 8 | link id -> timestamp
        self._count = 0
        self.proven = 0
        """It was later than this when the newest accepted frame came: its timestamp less what senders may be ahead."""

    def __len__(self) -> int:
        return self._count

    def newest(self, system_id: int, component_id: int, link_id: int) -> int | None:
        """The last timestamp of a stream, None for one never heard."""
        return self._of[system_id].get(component_id << 8 | link_id)

    def admit(self, system_id: int, component_id: int, link_id: int, timestamp: int, oldest: int = 0) -> bool:
        """Keeps the timestamp of a verified frame, if it is newer than the last of its stream.

        Args:
            system_id, component_id, link_id: of the stream.
            timestamp: of the frame.
            oldest: the least that a stream never heard before may have.
        """
        streams, stream = self._of[system_id], component_id << 8 | link_id
        newest = streams.get(stream)
        if newest is None:
            if timestamp < oldest:
                return False
            self._make_room()
            self._count += 1
        elif timestamp <= newest:
            return False
        streams[stream] = timestamp
        if timestamp > self.proven + AHEAD:
            self.proven = timestamp - AHEAD
        return True

    def rows(self) -> Iterator[tuple[int, int, int, int]]:
        """System id, component id, link id and timestamp of every stream."""
        for system_id, streams in enumerate(self._of):
            # a copy is taken in one step, so another thread may go on adding
            for stream, timestamp in streams.copy().items():
                yield system_id, stream >> 8, stream & 0xFF, timestamp

    def _make_room(self) -> None:
        if self._count < MOST_STREAMS:
            return
        crowd = max(self._of, key=len)
        del crowd[next(iter(crowd))]
        self._count -= 1
