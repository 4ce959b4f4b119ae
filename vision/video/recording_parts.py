"""The files of one recording, and which of its frames each has."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from dataclasses import replace
from glob import escape
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vision.errors import VideoError
from vision.video.film_process import FilmReader
from vision.video.recording import FIRST_FRAME, START_US

MAX_BETWEEN = 1_000_000
"""Most frames between two files, nine hours of them: a file that begins later than that carries a wrong number."""
_FAR_US = 1 << 60
"""Bound of times in µs, so that a damaged time stamp does not overflow 64 bits."""
_DIGITS = 18
"""Digits of a number that 64 bits hold."""


class RecordingPart:
    """A file with the frames ``first`` to ``end`` − 1 of a recording.

    Attributes:
        n: frames of it that count; a process that died may have recorded one more than it reported.
        start_us: Unix µs of its first frame, 0 when the file does not have it.
    """

    def __init__(self, path: Path, reader: FilmReader, first: int = 0, start_us: int = 0) -> None:
        self.path = path
        self.index = reader.index
        self.first = first
        self.start_us = start_us
        self.n = len(self.index.pts)
        self._unused: FilmReader | None = reader
        self._lending = threading.Lock()
        self._reader: FilmReader | None = None

    @property
    def end(self) -> int:
        """Index after its last frame."""
        return self.first + self.n

    def elapsed_us(self) -> NDArray[np.int64]:
        """(n,) time of each frame after the first."""
        pts = self.index.pts
        elapsed = [round((stamp - pts[0]) * self.index.tick_us) for stamp in pts[: self.n]]
        return np.array([min(max(us, -_FAR_US), _FAR_US) for us in elapsed], dtype=np.int64)

    def reader(self) -> FilmReader:
        """Open a decoder for the caller alone."""
        with self._lending:
            reader, self._unused = self._unused, None
        reader = reader or FilmReader(self.path, self.index)
        reader.index = self.index
        return reader

    def read(self, index: int) -> NDArray[np.uint8] | None:
        """Decode the ``index``-th frame of the file, None when it is damaged."""
        if self._reader is None:
            self._reader = self.reader()
        return self._reader.read(index)

    def close(self) -> None:
        """Release the file; it is opened again where a picture of it is asked for."""
        with self._lending:
            unused, self._unused = self._unused, None
        for reader in filter(None, (unused, self._reader)):
            reader.close()
        self._reader = None


def read_parts(path: Path) -> tuple[RecordingPart, ...]:
    """A video file and its continuations, in order.

    Raises:
        VideoError: no such file, not a video, no frame in it, nor in a continuation.
    """
    try:
        reader = FilmReader(path)
        first, start_us = _place(reader.tags)
        parts = [RecordingPart(path, reader, first if 0 <= first <= MAX_BETWEEN else 0, start_us)]
    except VideoError:
        # a first file without a frame is no reason to do without the others
        parts = list(_following(path))
        if not parts:
            raise
    else:
        parts += _following(path)
    parts.sort(key=lambda part: part.first)
    for k, (part, following) in enumerate(pairwise(parts), 1):
        if following.first > part.end + MAX_BETWEEN:
            del parts[k:]
            break
    for part, following in pairwise(parts):
        part.n = min(part.n, following.first - part.first)
    width, height = parts[0].index.width, parts[0].index.height
    for part in parts:
        # one video has one size: frames of another are scaled to it
        part.index = replace(part.index, width=width, height=height)
    return tuple(part for part in parts if part.n > 0)


def _following(path: Path) -> list[RecordingPart]:
    parts: list[RecordingPart] = []
    for further in _numbered(path):
        try:
            reader = FilmReader(further)
            first, start_us = _place(reader.tags)
            part = RecordingPart(further, reader, first, start_us)
            part.close()  # a process for each of many files would take the memory of as many
            if first >= 0:
                parts.append(part)
        except VideoError:
            # broken off before its first frame
            continue
    return parts


def _numbered(path: Path) -> list[Path]:
    """The files of a recording after the first, in order; one that was deleted does not end the row."""
    files = path.parent.glob(f"{escape(path.stem)}.*{path.suffix}")
    named = [(file.stem.removeprefix(f"{path.stem}."), file) for file in files]
    return [file for _, file in sorted((int(number), file) for number, file in named if number.isdecimal())]


def _place(tags: Mapping[str, str]) -> tuple[int, int]:
    """First frame and its time from a file's header, -1 when it is not there."""
    first, start_us = (_number(tags.get(name, "")) for name in (FIRST_FRAME, START_US))
    return first, max(start_us, 0)


def _number(tag: str) -> int:
    """A tag's number, -1 for none."""
    return int(tag) if tag.isdecimal() and len(tag) < _DIGITS else -1
