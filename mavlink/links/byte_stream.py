"""One byte stream (a TCP connection, a serial port): frames out of it, counted, and whole frames into it."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable
from typing import Protocol

from infra.wall_clock import now_us
from mavlink.links.batch import Batch
from mavlink.links.counters import Counters
from mavlink.protocol.dialect import DEFINITIONS
from mavlink.protocol.framing import FrameCounts, Framer
from mavlink.protocol.packet import Packet

PATIENCE_S = 0.3
"""Time for which the bytes of a frame may be on their way: radios and TCP hand them on in pieces, with pauses
between."""
ORDERS_BYTES, FORWARDED_BYTES = 1 << 12, 1 << 18
"""Most that may wait for a slow other end: few of our own frames, as orders must not come late; of forwarded packets a
second's worth of a hundred vehicles."""


def queue_bytes(is_output: bool) -> int:
    """Bytes that may wait to be sent where frames are forwarded, and elsewhere."""
    return FORWARDED_BYTES if is_output else ORDERS_BYTES


class FrameStream:
    """Frames out of the bytes of one stream.

    Args:
        peer: number of the sender.
        patience_s: for how long an unfinished frame may hold up what follows it.
        clock_s: monotonic.
    """

    def __init__(
        self,
        counters: Counters,
        peer: int,
        *,
        patience_s: float = PATIENCE_S,
        clock_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self.peer = peer
        self.patience_s = patience_s
        self._framer = Framer()
        self._counters = counters
        self._clock_s = clock_s
        self._since_s = math.inf
        """Time since which the frame that is waited for is unfinished."""
        self._searched = 0
        """Number of waiting bytes that hide nothing."""

    @property
    def overdue(self) -> bool:
        """True if :meth:`add` has something to look for though nothing may have come."""
        waiting = self._framer.waiting
        return waiting > self._searched and self._clock_s() - self._since_s >= self.patience_s

    def add(self, data: bytes | None, t_us: int, batch: Batch) -> int:
        """Add to a batch the frames that these bytes complete, and those hidden behind an unfinished one for too long.

        Args:
            data: what came; None: nothing; empty: the end of the stream.

        Returns:
            How many of them have a right checksum.
        """
        before = self._framer.counts
        frames = self._frames_of(data) if data else [] if data is None else self._framer.finish()
        if self.overdue:
            frames += self._hidden_frames()
        after = self._framer.counts
        counts = FrameCounts(
            after.good - before.good,
            after.bad - before.bad,
            after.junk_bytes - before.junk_bytes,
            after.unknown - before.unknown,
        )
        self._counters.add(len(data or b""), counts)
        for frame in frames:
            if counts.unknown and Packet(0, frame).message_id not in DEFINITIONS:
                batch.unchecked.add(len(batch))
            batch.times_us.append(t_us)
            batch.frames.append(frame)
            batch.peers.append(self.peer)
        return counts.good

    def _frames_of(self, data: bytes) -> list[bytes]:
        """Frames that these bytes complete; notes when another frame is begun that they do not."""
        waited = self._framer.waiting
        frames = self._framer.receive_bytes(data)
        if not waited or self._framer.waiting < waited + len(data):
            self._since_s, self._searched = self._clock_s(), 0
        return frames

    def _hidden_frames(self) -> list[bytes]:
        waited = self._framer.waiting
        frames = self._framer.skip_unfinished()
        self._searched = self._framer.waiting
        if self._searched < waited:
            self._since_s = self._clock_s()  # another frame is waited for now
        return frames


class _File(Protocol):
    """An open socket or serial port that does not block."""

    def fileno(self) -> int: ...

    def close(self) -> None: ...


class Connection:
    """One open byte stream. Frames go out whole: what it has begun to send it ends before the next.

    Args:
        receive: gives the bytes that are there, None when there are none now, empty at the end of the stream.
        queue_bytes: this much may wait for the other end to take it.
    """

    def __init__(
        self, file: _File, receive: Callable[[], bytes | None], frames: FrameStream, *, queue_bytes: int
    ) -> None:
        self.file = file
        self.frames = frames
        self.is_broken = False
        """True if nothing can be sent any more: what has come is read before it is closed."""
        self._receive = receive
        self._queue_bytes = queue_bytes
        self._unsent = b""

    @property
    def fds(self) -> tuple[int, ...]:
        """Descriptors to wait for; none once it is closed."""
        try:
            fd = self.file.fileno()
        except (OSError, ValueError):
            return ()
        return (fd,) if fd >= 0 else ()

    @property
    def overdue(self) -> bool:
        """True if an unfinished frame has hidden others for too long, or it is to be closed."""
        return self.is_broken or self.frames.overdue

    def read_into(self, batch: Batch) -> tuple[bool, int]:
        """Add the frames that have come to a batch, at the end of the stream with those that were hidden.

        Returns:
            Whether the stream goes on, and how many of the frames have a right checksum.
        """
        self._flush()
        data = self._receive()
        if data is None and self.is_broken:
            data = b""
        good = self.frames.add(data, now_us(), batch)
        return data != b"", good

    def send(self, frame: bytes) -> bool:
        """Tell whether a frame was taken: False where the other end is gone, or too much waits for it already."""
        if len(self._unsent) > self._queue_bytes:
            self._flush()
        if self.is_broken or len(self._unsent) > self._queue_bytes:
            return False
        self._unsent += frame
        self._flush()
        return not self.is_broken

    def _flush(self) -> None:
        if not self._unsent or self.is_broken:
            return
        try:
            self._unsent = self._unsent[os.write(self.file.fileno(), self._unsent) :]
        except (BlockingIOError, InterruptedError):
            return
        except (OSError, ValueError):
            self.is_broken = True

    def close(self) -> None:
        """Close the connection; what waits to be sent is lost."""
        self.file.close()
