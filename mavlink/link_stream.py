"""One byte stream (a TCP connection, a serial port): frames out of it, counted."""

from __future__ import annotations

from mavlink.dialect import DEFINITIONS
from mavlink.frame import FrameCounts, Framer
from mavlink.link_batch import Batch
from mavlink.link_tally import Tally
from mavlink.packet import Packet

__all__ = ["Backoff", "Stream"]


class Stream:
    """Frames out of one byte stream.

    Args:
        tally: of the link.
        peer: number of the sender.
    """

    def __init__(self, tally: Tally, peer: int) -> None:
        self.peer = peer
        self._framer = Framer()
        self._tally = tally

    def take(self, data: bytes, t_us: int, batch: Batch) -> int:
        """Adds the frames that these bytes complete; empty bytes are the end of the stream.

        Returns:
            How many of them have a right checksum.
        """
        before = self._framer.counts
        frames = self._framer.feed(data) if data else self._framer.finish()
        after = self._framer.counts
        counts = FrameCounts(
            after.good - before.good,
            after.bad - before.bad,
            after.junk_bytes - before.junk_bytes,
            after.unknown - before.unknown,
        )
        self._tally.take(len(data), counts)
        for frame in frames:
            if counts.unknown and Packet(0, frame).message_id not in DEFINITIONS:
                batch.unchecked.add(len(batch))
            batch.times_us.append(t_us)
            batch.frames.append(frame)
            batch.peers.append(self.peer)
        return counts.good


class Backoff:
    """When to try again: twice as long after each failure, and soon again after a success.

    Args:
        first_s: wait after the first failure.
        most_s: longest wait.
    """

    def __init__(self, first_s: float = 0.5, most_s: float = 4.0) -> None:
        self._first_s, self._most_s = first_s, most_s
        self._wait_s = first_s
        self._next_s = 0.0

    def due(self, now_s: float) -> bool:
        """Whether it may be tried now (monotonic seconds); the next time is then later."""
        if now_s < self._next_s:
            return False
        self._next_s = now_s + self._wait_s
        self._wait_s = min(2.0 * self._wait_s, self._most_s)
        return True

    def succeeded(self) -> None:
        """What was tried worked."""
        self._wait_s = self._first_s
