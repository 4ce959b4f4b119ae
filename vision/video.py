"""Video files, frame by frame: which picture is the i-th shown, when it was taken, and exactly that one on demand.

A file is read through once at opening, without decoding, for the time stamp of every picture; after that index and
time are known of each, also when the frame rate varies. Times are Unix microseconds, pictures BGR.
"""

from __future__ import annotations

from collections.abc import Generator, Iterable, Iterator
from contextlib import closing
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from types import TracebackType

import av
import av.logging
import numpy as np
from av.container import InputContainer
from av.packet import Packet
from av.video.frame import VideoFrame
from av.video.stream import VideoStream
from numpy.typing import ArrayLike, NDArray

from vision.errors import VideoError

__all__ = ["Frame", "VideoFile"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Frame:
    """One picture."""

    index: int
    """Position in the video in display order, from 0."""
    t_us: int
    """Unix µs at which it was taken."""
    image: NDArray[np.uint8]
    """(H, W, 3) BGR."""


class VideoFile:
    """A recorded video.

    Attributes:
        path: the file.
        n: pictures that have both an image and a time.
        width: px.
        height: px.
        fps: mean pictures per second, NaN for a single picture.
        times_us: (n,) int64 Unix µs of each picture in display order, read-only.
        mismatch: how many more times were given than the file has pictures; negative when fewer, 0 when they agree.
    """

    def __init__(self, path: Path, index: _Index, times_us: NDArray[np.int64], mismatch: int) -> None:
        self.path = path
        self.n = len(times_us)
        self.width, self.height = index.width, index.height
        span_s = (times_us[-1] - times_us[0]) / 1e6 if self.n > 1 else 0.0
        self.fps = float((self.n - 1) / span_s) if span_s > 0 else float("nan")
        self.times_us = times_us
        self.mismatch = mismatch
        self._index = index
        self._reader: _Reader | None = None

    @classmethod
    def open(cls, path: Path | str, times_us: ArrayLike | None = None, *, start_us: int = 0) -> VideoFile:
        """Open a file and learn the time stamp of every picture.

        Args:
            path: any container and codec that FFmpeg reads; a file that ends early plays what is there.
            times_us: (k,) Unix µs of each picture in display order; the shorter of file and times counts.
            start_us: without ``times_us``: Unix µs of the first picture, the file's own time stamps say the rest.

        Raises:
            VideoError: no such file, not a video, no picture in it.
        """
        path = Path(path)
        index = _read_index(path)
        if times_us is None:
            elapsed_us = np.array([round((pts - index.pts[0]) * index.tick_us) for pts in index.pts], dtype=np.int64)
            times = start_us + elapsed_us
        else:
            times = np.array(times_us, dtype=np.int64).reshape(-1)
        mismatch = 0 if times_us is None else len(times) - len(index.pts)
        times = times[: len(index.pts)].copy()
        if not len(times):
            raise VideoError(f"video {path}: the list of frame times is empty; leave it out to use the file's own")
        times.flags.writeable = False
        return cls(path, index, times, mismatch)

    def frames(self, start: int = 0) -> Iterator[Frame]:
        """Pictures in display order from ``start`` on; a picture that cannot be decoded is left out.

        Closing the iterator releases the file. Several iterators may run at once.
        """
        if start >= self.n:
            return
        with closing(_Reader(self.path, self._index)) as reader:
            reader.go(max(start, 0))
            for index, image in reader.pictures():
                if index >= self.n:
                    return
                yield self._frame(index, image)

    def read(self, index: int) -> Frame:
        """Exactly the ``index``-th picture.

        Raises:
            IndexError: outside 0..n-1.
            VideoError: the picture is damaged and cannot be decoded.
        """
        if not 0 <= index < self.n:
            raise IndexError(f"video {self.path}: no frame {index}, it has 0 to {self.n - 1}")
        if self._reader is None:
            self._reader = _Reader(self.path, self._index)
        image = self._reader.read(index)
        if image is None:
            raise VideoError(f"video {self.path}: frame {index} is damaged and cannot be decoded")
        return self._frame(index, image)

    def close(self) -> None:
        """Release the file; iterators that still run keep theirs until they are closed."""
        if self._reader is not None:
            self._reader.close()
            self._reader = None

    def __enter__(self) -> VideoFile:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, tb: TracebackType | None) -> None:
        self.close()

    def _frame(self, index: int, image: NDArray[np.uint8]) -> Frame:
        return Frame(index=index, t_us=int(self.times_us[index]), image=image)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Index:
    """Every picture's time stamp."""

    width: int
    height: int
    pts: list[int]
    """Display order, in ticks."""
    order: dict[int, int]
    """pts → index."""
    key_pts: NDArray[np.int64]
    """Pictures that decoding can begin at, ascending."""
    tick_us: float


def _read_index(path: Path) -> _Index:
    """Read a file through without decoding."""
    with closing(_open(path)) as container:
        stream = container.streams.video[0]
        stamps: list[int] = []
        keys: list[int] = []
        for packet in _packets(container, stream):
            pts = _stamp(packet)
            if pts is None or packet.is_discard:
                continue
            if packet.is_keyframe:
                keys.append(pts)
            # pictures ahead of the first key picture have nothing to be decoded from
            if keys and pts >= keys[0]:
                stamps.append(pts)
        shown = sorted(set(stamps))
        width, height = stream.codec_context.width, stream.codec_context.height
        if not shown or not width:
            raise VideoError(f"video {path}: no picture with a time stamp in it; remux it, for example to .mkv")
        return _Index(
            width=width,
            height=height,
            pts=shown,
            order={stamp: i for i, stamp in enumerate(shown)},
            key_pts=np.array(sorted(keys), dtype=np.int64),
            tick_us=float(stream.time_base * 1_000_000),
        )


class _Reader:
    """One decoder at one place in the file."""

    def __init__(self, path: Path, index: _Index) -> None:
        self._path = path
        self._index = index
        self._open()

    def close(self) -> None:
        self._pictures.close()
        self._container.close()

    def pictures(self) -> Iterator[tuple[int, NDArray[np.uint8]]]:
        """Index and image of the pictures from the one that ``go`` went to."""
        for index, frame in self._pictures:
            yield index, self._image(frame)

    def read(self, index: int) -> NDArray[np.uint8] | None:
        """That picture, None when it does not decode."""
        if not self._ahead(index):
            self.go(index)
        for found, frame in self._pictures:
            self._next = found + 1
            if found >= index:
                return self._image(frame) if found == index else None
        self._next = len(self._index.pts)
        return None

    def go(self, index: int) -> None:
        """Make ``index`` the next picture: begin to decode at a key picture before it."""
        target = self._index.pts[index]
        before = int(np.searchsorted(self._index.key_pts, target, side="right")) - 1
        step = 1
        # a container may land behind the place asked for, so what it shows is checked and asked again from earlier on
        while before > 0 and not self._land(int(self._index.key_pts[before]), target, index):
            before, step = before - step, step * 2
        if before <= 0 and index < len(self._index.pts):
            self._rewind(index)

    def _land(self, key: int, target: int, index: int) -> bool:
        """Seek to a key picture; whether decoding then begins at or before the target."""
        self._pictures.close()
        try:
            self._container.seek(key, stream=self._stream, backward=True)
        except av.FFmpegError:
            return False
        packets = _packets(self._container, self._stream)
        for packet in packets:
            stamp = _stamp(packet)
            if packet.is_keyframe and stamp is not None:
                if stamp > target:
                    return False
                self._start(chain([packet], packets), index)
                return True
        return False

    def _rewind(self, index: int) -> None:
        """Start from the beginning of the file."""
        self.close()
        self._open(index)

    def _open(self, index: int = 0) -> None:
        self._container = _open(self._path)
        self._stream = self._container.streams.video[0]
        self._stream.thread_type = "AUTO"
        self._start(_packets(self._container, self._stream), index)

    def _start(self, packets: Iterable[Packet], index: int) -> None:
        """Decode these packets from now on and show the pictures from ``index`` on."""
        self._pictures = self._decode(packets, index)
        self._next = index

    def _ahead(self, index: int) -> bool:
        """Whether decoding on is the shortest way: no key picture lies between here and there."""
        if index < self._next or self._next >= len(self._index.pts):
            return False
        keys, pts = self._index.key_pts, self._index.pts
        return bool(np.searchsorted(keys, pts[self._next], "right") == np.searchsorted(keys, pts[index], "right"))

    def _decode(self, packets: Iterable[Packet], start: int) -> Generator[tuple[int, VideoFrame], None, None]:
        """Index and decoded frame from ``start`` on; damaged packets are skipped."""
        for packet in packets:
            yield from self._shown(packet, start)
        yield from self._shown(None, start)

    def _shown(self, packet: Packet | None, start: int) -> Iterator[tuple[int, VideoFrame]]:
        """What the decoder gives out for one packet, or at the end for None."""
        try:
            frames = self._stream.codec_context.decode(packet)
        except av.FFmpegError:
            return
        for frame in frames:
            index = self._index.order.get(frame.pts if frame.pts is not None else frame.dts, -1)
            if index >= start:
                yield index, frame

    def _image(self, frame: VideoFrame) -> NDArray[np.uint8]:
        image: NDArray[np.uint8] = frame.to_ndarray(format="bgr24", width=self._index.width, height=self._index.height)
        return image


def _open(path: Path) -> InputContainer:
    """A container with a video stream in it; FFmpeg is told to be silent, as it would write over the screen."""
    av.logging.set_level(av.logging.PANIC)
    if not path.is_file():
        raise VideoError(f"video {path}: no such file")
    if path.stat().st_size == 0:
        raise VideoError(f"video {path}: the file is empty")
    try:
        container = av.open(str(path))
    except (av.FFmpegError, OSError, ValueError) as error:
        raise VideoError(f"video {path}: not a video that can be read ({_reason(error)})") from error
    if not container.streams.video:
        container.close()
        raise VideoError(f"video {path}: no video stream in it")
    return container


def _packets(container: InputContainer, stream: VideoStream) -> Iterator[Packet]:
    """The stream's packets up to the end or to where the file breaks off."""
    try:
        for packet in container.demux(stream):
            if packet.size:
                yield packet
    except av.FFmpegError:
        return


def _stamp(packet: Packet) -> int | None:
    """Presentation time in ticks; the decoding time where a container has no other."""
    stamp = packet.pts if packet.pts is not None else packet.dts
    return None if stamp is None else int(stamp)


def _reason(error: BaseException) -> str:
    """FFmpeg's words without the number and the path."""
    return str(getattr(error, "strerror", None) or error).strip().rstrip(".").lower()
