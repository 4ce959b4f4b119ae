"""Video files, frame by frame: which picture is the i-th shown, when it was taken, and exactly that one on demand.

A file is read through once at opening, without decoding, for the time stamp of every picture; after that index and
time are known of each, also when the frame rate varies. Times are Unix microseconds, pictures BGR.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vision.errors import VideoError
from vision.pictures import PictureIndex, PictureReader, read_index

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

    def __init__(self, path: Path, index: PictureIndex, times_us: NDArray[np.int64], mismatch: int) -> None:
        self.path = path
        self.n = len(times_us)
        self.width, self.height = index.width, index.height
        span_s = (times_us[-1] - times_us[0]) / 1e6 if self.n > 1 else 0.0
        self.fps = float((self.n - 1) / span_s) if span_s > 0 else float("nan")
        self.times_us = times_us
        self.mismatch = mismatch
        self._index = index
        self._reader: PictureReader | None = None

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
        index = read_index(path)
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
        with closing(PictureReader(self.path, self._index)) as reader:
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
            self._reader = PictureReader(self.path, self._index)
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
