"""Untouched video packets into a Matroska file that can be played at every moment, also after the process was killed.

Clusters are closed every half second and handed to the system at once, so at most that much is lost. Numbers and times
of the pictures are those that a reader of the file will find: display order, counted from the first key picture.
"""

from __future__ import annotations

import heapq
from fractions import Fraction
from pathlib import Path

import av
from av.container import OutputContainer
from av.packet import Packet
from av.video.stream import VideoStream as CodedStream

from vision.errors import VideoError

__all__ = ["PictureOrder", "Recording"]

OPTIONS = {"cluster_time_limit": "500", "flush_packets": "1"}
TICK = Fraction(1, 1000)
"""Matroska's, s."""


class Recording:
    """A file that packets are appended to.

    Raises:
        VideoError: the file exists already, or its folder does not.
    """

    def __init__(self, path: Path) -> None:
        if path.exists():
            raise VideoError(f"recording {path}: the file exists already and is not overwritten; name another")
        if not path.parent.is_dir():
            raise VideoError(f"recording {path}: the folder does not exist; create it")
        self.path = path
        self.error = ""
        """Why it broke off, empty while all is well."""
        self._container: OutputContainer | None = None
        self._stream: CodedStream | None = None
        self._codec = ""
        self._last_dts = -1

    def write(self, packet: Packet[CodedStream], stream: CodedStream, time_s: float) -> None:
        """Append a packet of ``stream`` whose picture is shown ``time_s`` after the start of the recording.

        A failure (disk full, another codec after a reconnection) ends the recording and is told in ``error``.
        """
        if self.error:
            return
        try:
            if self._container is None or self._stream is None:
                self._container, self._stream = self._create(stream)
            elif self._codec != stream.codec_context.name:
                raise VideoError(f"the stream changed to {stream.codec_context.name}; start a new recording")
            self._mux(packet, time_s)
        except (av.FFmpegError, OSError, ValueError, VideoError) as error:
            self.error = f"recording {self.path}: broken off, {error}"
            self.close()

    def close(self) -> None:
        """Write the end of the file."""
        container, self._container, self._stream = self._container, None, None
        if container is None:
            return
        try:
            container.close()
        except (av.FFmpegError, OSError) as error:
            self.error = self.error or f"recording {self.path}: its end could not be written, {error}"

    def _create(self, stream: CodedStream) -> tuple[OutputContainer, CodedStream]:
        self._codec = stream.codec_context.name
        container: OutputContainer = av.open(str(self.path), "w", format="matroska", options=OPTIONS)
        return container, container.add_stream_from_template(stream)

    def _mux(self, packet: Packet[CodedStream], time_s: float) -> None:
        if self._container is None or self._stream is None or packet.pts is None:
            return
        before = packet.pts, packet.dts, packet.time_base, packet.stream
        step = float((packet.time_base or TICK) / TICK)
        pts = round(time_s / TICK)
        dts = pts if packet.dts is None else pts - round((packet.pts - packet.dts) * step)
        # decoding times must rise, also across a reconnection
        self._last_dts = dts = max(dts, self._last_dts + 1)
        packet.time_base, packet.pts, packet.dts, packet.stream = TICK, max(pts, dts), dts, self._stream
        self._container.mux(packet)
        packet.pts, packet.dts, packet.time_base, packet.stream = before


class PictureOrder:
    """Display order of pictures whose packets come in decoding order.

    Example:
        >>> order = PictureOrder()
        >>> [order.add(pts, dts) for pts, dts in ((0, 0), (3, 1), (2, 2), (4, 3))]
        [[(0, 0)], [], [(1, 2)], [(2, 3)]]
    """

    def __init__(self) -> None:
        self.count = 0
        """Pictures given out so far, and so the index of the next."""
        self._waiting: list[int] = []
        self._last = -(1 << 62)

    def add(self, pts: int, dts: int) -> list[tuple[int, int]]:
        """Take in a packet; index and pts of the pictures whose place is now certain."""
        heapq.heappush(self._waiting, pts)
        # nothing that comes later is shown before its own decoding time
        return self._release(dts)

    def repeats(self, pts: int) -> bool:
        """Whether this time stamp was there already or comes too late to have a place."""
        return pts <= self._last or pts in self._waiting

    def place(self, pts: int) -> int:
        """Index of a picture that is still waiting, judged by those that wait with it."""
        return self.count + sum(other < pts for other in self._waiting)

    def flush(self) -> list[tuple[int, int]]:
        """The pictures that still wait; time stamps may start anew afterwards."""
        released = self._release(1 << 62)
        self._last = -(1 << 62)
        return released

    def _release(self, until: int) -> list[tuple[int, int]]:
        released = []
        while self._waiting and self._waiting[0] <= until:
            self._last = heapq.heappop(self._waiting)
            released.append((self.count, self._last))
            self.count += 1
        return released
