"""Untouched video packets into Matroska files that can be played at every moment, also after the process was killed.

Every frame is a cluster of its own and handed to the system at once, so at most the last one is lost. A recording is
a row of files, ``video.mkv``, ``video.1.mkv``, …: the next begins where the stream cannot go on in the last one
(another codec or size, a disk that failed for a while, a process that died), always at a key frame. Each has in its
header which frame of the recording its first one is (``FIRST_FRAME``) and when that was taken (``START_US``).
"""

from __future__ import annotations

import contextlib
import heapq
import os
from fractions import Fraction
from pathlib import Path

import av
from av.container import OutputContainer
from av.packet import Packet
from av.video.stream import VideoStream as CodedStream

from infra.files.restorable_file import RestorableFile
from infra.files.segment import segment_path
from vision.errors import VideoError

FIRST_FRAME, START_US = "FIRST_FRAME", "START_US"
OPTIONS = {"cluster_time_limit": "0", "flush_packets": "1", "allow_raw_vfw": "1"}
TICK = Fraction(1, 1000)
"""Matroska's, s."""
RETRY_S, LONGEST_RETRY_S = 2.0, 8.0
"""Pause after a failed write, before a new file is tried, s; it doubles with each further failure."""
MAX_SEGMENTS = 10_000
"""Files of one recording; a disk that fails each time must not fill a folder with names."""


def require_new(path: Path) -> None:
    """Refuse a place that cannot be recorded to.

    Raises:
        VideoError: the file exists already, or its folder does not.
    """
    if path.exists():
        raise VideoError(f"recording {path}: the file exists already and is not overwritten; name another")
    if not path.parent.is_dir():
        raise VideoError(f"recording {path}: the folder does not exist; create it")


class Recording:
    """Files that packets are appended to, one after the other.

    One that is deleted or moved while it is written is put back, and the next one begun.

    Attributes:
        segment: number of the file being written, -1 before the first.
    """

    def __init__(self, path: Path, segment: int = -1) -> None:
        self.path = path
        self.segment = segment
        self._error = ""
        self._kept: RestorableFile | None = None
        self._put_back: RestorableFile | None = None
        self._container: OutputContainer | None = None
        self._stream: CodedStream | None = None
        self._format: tuple[str, int, int] | None = None
        self._last_dts = -1
        self._start_s = 0.0
        self._retry_s = 0.0
        self._pause_s = RETRY_S

    @property
    def error(self) -> str:
        """Fault that came last, empty once a later file is being written."""
        return self._error or (self._put_back.error if self._put_back else "")

    def wants_segment(self, stream: CodedStream, unix_s: float) -> bool:
        """Tell whether a key frame of ``stream`` has to begin a new file."""
        if self._container is None:
            return unix_s >= self._retry_s
        return self._format != _format(stream)

    def begin(self, stream: CodedStream, first_frame: int, unix_s: float) -> None:
        """Start the next file with the frame ``first_frame`` taken at ``unix_s``."""
        self._end()
        try:
            container = self._create(first_frame, unix_s)
            self._stream = container.add_stream_from_template(stream)
            self._container = container
        except (av.FFmpegError, OSError, ValueError) as error:
            self._fail(error, unix_s)
            return
        self._format, self._start_s, self._last_dts = _format(stream), unix_s, -1

    def write(self, packet: Packet[CodedStream], unix_s: float) -> None:
        """Append a packet whose frame was taken at ``unix_s``; a failure ends the file and is kept in ``error``."""
        if self._container is None or self._stream is None or packet.pts is None:
            return
        before = packet.pts, packet.dts, packet.time_base
        step = float((packet.time_base or TICK) / TICK)
        pts = max(round((unix_s - self._start_s) / TICK), 0)
        dts = pts if packet.dts is None else pts - round((packet.pts - packet.dts) * step)
        # decoding times must rise, also across a reconnection
        self._last_dts = dts = max(dts, self._last_dts + 1)
        packet.time_base, packet.pts, packet.dts, packet.stream = TICK, max(pts, dts), dts, self._stream
        try:
            self._container.mux(packet)
            self._error, self._pause_s = "", RETRY_S
            self._look_after(unix_s)
        except (av.FFmpegError, OSError, ValueError) as error:
            self._fail(error, unix_s)
        packet.pts, packet.dts, packet.time_base = before

    def close(self) -> None:
        """Write the end of the file."""
        self._end()
        if self._put_back is not None:
            self._put_back.close()

    def _end(self) -> None:
        container, self._container, self._stream = self._container, None, None
        try:
            if container is not None:
                container.close()
        except (av.FFmpegError, OSError) as error:
            self._error = self._error or f"recording {self.path}: its end could not be written, {error}"
        kept, self._kept = self._kept, None
        if kept is not None:
            kept.close()

    def _look_after(self, unix_s: float) -> None:
        """Notice that the file is gone, which FFmpeg never would."""
        if self._kept is not None and self._kept.is_gone():
            kept, self._kept = self._kept, None
            self._end()
            kept.restore()
            self._put_back, self._retry_s = kept, unix_s
            self._error = f"recording {kept.path}: deleted or moved while it was written"

    def _create(self, first_frame: int, unix_s: float) -> OutputContainer:
        while self.segment < MAX_SEGMENTS:
            self.segment += 1
            path = segment_path(self.path, self.segment)
            if not os.path.lexists(path):
                break
        path.parent.mkdir(mode=0o755, parents=True, exist_ok=True)
        self._kept = RestorableFile(path)
        container: OutputContainer = av.open(self._kept.name, "w", format="matroska", options=OPTIONS)
        container.metadata.update({FIRST_FRAME: str(first_frame), START_US: str(round(unix_s * 1e6))})
        return container

    def _fail(self, error: Exception, unix_s: float) -> None:
        path = segment_path(self.path, max(self.segment, 0))
        self._error = f"recording {path}: broken off, {error}"
        self._retry_s, self._pause_s = unix_s + self._pause_s, min(2 * self._pause_s, LONGEST_RETRY_S)
        self._end()
        with contextlib.suppress(OSError):
            if path.stat().st_size == 0:  # nothing of it came on the disk: the next attempt has its name
                path.unlink()
                self.segment -= 1


def _format(stream: CodedStream) -> tuple[str, int, int]:
    context = stream.codec_context
    return context.name, context.width, context.height


class DisplayOrder:
    """Display order of frames whose packets come in decoding order.

    Example:
        >>> order = DisplayOrder()
        >>> [order.add(pts, dts) for pts, dts in ((0, 0), (3, 1), (2, 2), (4, 3))]
        [[(0, 0)], [], [(1, 2)], [(2, 3)]]
    """

    def __init__(self, count: int = 0) -> None:
        self.count = count
        """Frames given out so far, and so the index of the next."""
        self._waiting: list[int] = []
        self._last = -(1 << 62)

    def add(self, pts: int, dts: int) -> list[tuple[int, int]]:
        """Take in a packet; index and pts of the frames whose place is now certain."""
        heapq.heappush(self._waiting, pts)
        # nothing that comes later is shown before its own decoding time
        return self._release(dts)

    def repeats(self, pts: int) -> bool:
        """Tell whether this time stamp was there already or comes too late to have a place."""
        return pts <= self._last or pts in self._waiting

    def place(self, pts: int) -> int:
        """Index of a frame that is still waiting, judged by those that wait with it."""
        return self.count + sum(other < pts for other in self._waiting)

    def flush(self) -> list[tuple[int, int]]:
        """The frames that still wait; time stamps may start again afterwards."""
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
