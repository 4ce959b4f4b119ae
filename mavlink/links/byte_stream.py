"""One byte stream (a TCP connection, a serial port): frames out of it, counted."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

from mavlink.links.batch import Batch
from mavlink.links.counters import Tally
from mavlink.protocol.dialect import DEFINITIONS
from mavlink.protocol.framing import FrameCounts, Framer
from mavlink.protocol.packet import Packet

__all__ = ["PATIENCE_S", "Backoff", "Stream"]


PATIENCE_S = 0.3
"""For so long the bytes of a frame may be on their way: radios and TCP hand them on in pieces, with pauses between."""


class Stream:
    """Frames out of one byte stream.

    Args:
        tally: of the link.
        peer: number of the sender.
        patience_s: for how long an unfinished frame may hold up what stands behind it.
        clock_s: monotonic.
    """

    def __init__(
        self,
        tally: Tally,
        peer: int,
        *,
        patience_s: float = PATIENCE_S,
        clock_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self.peer = peer
        self._framer = Framer()
        self._tally = tally
        self._patience_s = patience_s
        self._clock_s = clock_s
        self._since_s = math.inf
        """Since when the frame is unfinished that is waited for."""
        self._searched = 0
        """So many of the waiting bytes hide nothing."""

    @property
    def overdue(self) -> bool:
        """Whether :meth:`take` has something to look for though nothing may have come."""
        waiting = self._framer.waiting
        return waiting > self._searched and self._clock_s() - self._since_s >= self._patience_s

    def take(self, data: bytes | None, t_us: int, batch: Batch) -> int:
        """Adds the frames that these bytes complete, and those hidden behind a frame that is waited for too long.

        Args:
            data: what came; None: nothing; empty: the end of the stream.
            t_us: now.
            batch: gets the frames.

        Returns:
            How many of them have a right checksum.
        """
        before = self._framer.counts
        frames = self._feed(data) if data else [] if data is None else self._framer.finish()
        if self.overdue:
            frames += self._give_up()
        after = self._framer.counts
        counts = FrameCounts(
            after.good - before.good,
            after.bad - before.bad,
            after.junk_bytes - before.junk_bytes,
            after.unknown - before.unknown,
        )
        self._tally.take(len(data or b""), counts)
        for frame in frames:
            if counts.unknown and Packet(0, frame).message_id not in DEFINITIONS:
                batch.unchecked.add(len(batch))
            batch.times_us.append(t_us)
            batch.frames.append(frame)
            batch.peers.append(self.peer)
        return counts.good

    def _feed(self, data: bytes) -> list[bytes]:
        """Frames that these bytes complete; notes when another frame is begun that they do not."""
        waited = self._framer.waiting
        frames = self._framer.feed(data)
        if not waited or self._framer.waiting < waited + len(data):
            self._since_s, self._searched = self._clock_s(), 0
        return frames

    def _give_up(self) -> list[bytes]:
        waited = self._framer.waiting
        frames = self._framer.give_up()
        self._searched = self._framer.waiting
        if self._searched < waited:
            self._since_s = self._clock_s()  # another frame is waited for now
        return frames


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
