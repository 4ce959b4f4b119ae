"""Recorded video, frame by frame: which frame is the i-th shown, when it was taken, and exactly that one on demand.

A file is read through once at opening, without decoding, for the time stamp of every frame; after that index and time
are known of each, also when the frame rate varies. Times are Unix microseconds, frames BGR. A recording that was
broken off and went on in further files (``vision.video.recording``) is one video: what lies between them are frames
that have an index and a time, and no image.
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
from vision.video.recording_parts import RecordingPart, read_parts


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Frame:
    """One frame."""

    index: int
    """Position in the video in display order, from 0."""
    t_us: int
    """Unix µs at which it was taken."""
    image: NDArray[np.uint8]
    """(H, W, 3) BGR."""


class VideoFile:
    """A recorded video.

    Attributes:
        path: the file, the first when there are several.
        n: frames that have a time, up to the last one with an image.
        width: px.
        height: px.
        fps: mean frames per second, NaN for a single frame.
        times_us: (n,) int64 Unix µs of each frame in display order, read-only.
        mismatch: how many more times were given than there are frames; negative when fewer, 0 when they agree.
        aspect: width of a coded pixel by its height.
        shown_as: in words, how pictures are shown otherwise than they are coded; empty as coded.
        missing: frames between two files of which there is no image.
    """

    def __init__(
        self, path: Path, parts: tuple[RecordingPart, ...], times_us: NDArray[np.int64], mismatch: int
    ) -> None:
        self.path = path
        self.n = len(times_us)
        self.width, self.height = parts[0].index.width, parts[0].index.height
        span_s = (times_us[-1] - times_us[0]) / 1e6 if self.n > 1 else 0.0
        self.fps = float((self.n - 1) / span_s) if span_s > 0 else float("nan")
        self.times_us = times_us
        self.aspect, self.shown_as = parts[0].index.aspect, parts[0].index.shown_as
        self.mismatch = mismatch
        self.missing = max(parts[-1].end - sum(part.n for part in parts), 0)
        self._parts = parts

    @classmethod
    def open(cls, path: Path | str, times_us: ArrayLike | None = None, *, start_us: int = 0) -> VideoFile:
        """Open a file, and those in which its recording went on, and learn the time stamp of every frame.

        Args:
            path: any container and codec that FFmpeg reads; of a file that ends early the frames that are there.
            times_us: (k,) Unix µs of each frame in display order; the shorter of file and times counts.
            start_us: without ``times_us``: Unix µs of the first frame, the file's own time stamps give the others.

        Raises:
            VideoError: no such file, not a video, no frame in it.
        """
        path = Path(path)
        parts = read_parts(path)
        end = parts[-1].end
        given = _elapsed_us(parts) + start_us if times_us is None else times_us
        times = np.array(given, dtype=np.int64).reshape(-1)
        mismatch = len(times) - end
        times = times[:end].copy()
        if not len(times):
            raise VideoError(f"video {path}: the list of frame times is empty; leave it out to use the file's own")
        times.flags.writeable = False
        return cls(path, parts, times, mismatch)

    def frames(self, start: int = 0) -> Iterator[Frame]:
        """Frames in display order from ``start`` on; a frame that cannot be decoded is left out.

        Closing the iterator releases the file. Several iterators may run at once.
        """
        for part in self._parts:
            if part.first >= self.n or start >= part.end:
                continue
            with closing(part.reader()) as reader:
                for index, image in reader.frames(max(start - part.first, 0)):
                    if index >= part.n or part.first + index >= self.n:
                        break
                    yield self._frame(part.first + index, image)

    def read(self, index: int) -> Frame:
        """Exactly the ``index``-th frame.

        Raises:
            IndexError: outside 0..n-1.
            VideoError: the frame is damaged or was never recorded.
        """
        if not 0 <= index < self.n:
            raise IndexError(f"video {self.path}: no frame {index}, it has 0 to {self.n - 1}")
        for part in self._parts:
            if part.first <= index < part.end:
                image = part.read(index - part.first)
                if image is None:
                    raise VideoError(f"video {part.path}: frame {index} is damaged and cannot be decoded")
                return self._frame(index, image)
        raise VideoError(f"video {self.path}: frame {index} was seen but not recorded")

    def close(self) -> None:
        """Release the files; iterators that still run keep theirs until they are closed."""
        for part in self._parts:
            part.close()

    def __enter__(self) -> VideoFile:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, tb: TracebackType | None) -> None:
        self.close()

    def _frame(self, index: int, image: NDArray[np.uint8]) -> Frame:
        return Frame(index=index, t_us=int(self.times_us[index]), image=image)


def _elapsed_us(parts: tuple[RecordingPart, ...]) -> NDArray[np.int64]:
    """Time of every frame after the first, by the files' own time stamps; what is missing lies evenly between."""
    begin_us = parts[0].start_us
    known = np.concatenate([np.arange(part.first, part.end) for part in parts])
    elapsed = np.concatenate([part.start_us - begin_us + part.elapsed_us() for part in parts])
    every: NDArray[np.int64] = np.round(np.interp(np.arange(parts[-1].end), known, elapsed)).astype(np.int64)
    return every
