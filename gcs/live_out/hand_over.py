"""The newest snapshot in memory that the station writes and the processes of sinks read; nobody waits for anybody.

A reader that is slow, stopped or gone misses snapshots and nothing else: the writer never looks at readers, and takes
as much memory for many as for none. A snapshot carries a checksum (``infra.shared_memory``). A picture does not, which
would cost more than all the rest: there are three places for it in turn, and a reader drops a copy that may have been
written over meanwhile.
"""

from __future__ import annotations

import itertools
import os
import pickle
from dataclasses import replace

import numpy as np

from gcs.snapshot import Snapshot
from infra.shared_memory import NewestValue, make_memory, map_memory

_CURSOR_BYTES = 8
_SLOTS, _PICTURES = 2, 3
SNAPSHOT_BYTES = 4 << 20
"""Bytes of one snapshot without its picture: thousands of boxes with all their candidates."""
PICTURE_BYTES = 7680 * 4320 * 3
"""The largest picture; memory is taken for what is written alone."""
_PICTURES_AT = _CURSOR_BYTES + _SLOTS * SNAPSHOT_BYTES


class SnapshotWriter:
    """The station's end of the hand-over.

    Args:
        images: whether pictures are handed over too.

    Attributes:
        fd: file descriptor of the memory.
        left_out: snapshots that were too large.

    Raises:
        OSError: no memory is left.
    """

    def __init__(self, *, images: bool = False) -> None:
        size = _PICTURES_AT + (_PICTURES * PICTURE_BYTES if images else 0)
        self._file = os.fdopen(make_memory(size), "r+b", buffering=0)
        self.fd = self._file.fileno()
        self._view = memoryview(map_memory(self.fd))
        self._cursor, self._slots = _places(self._view)
        self._images = np.frombuffer(self._view[_PICTURES_AT:], dtype=np.uint8) if images else None
        self.left_out = 0

    def put(self, snapshot: Snapshot) -> None:
        """Replace the snapshot that is there."""
        number, image = self._cursor[0] + 1, snapshot.image
        shape: tuple[int, ...] = ()
        if self._images is not None and image is not None and image.nbytes <= PICTURE_BYTES:
            start = number % _PICTURES * PICTURE_BYTES
            np.copyto(self._images[start : start + image.nbytes].reshape(image.shape), image)
            shape = image.shape
        value = pickle.dumps((number, shape, replace(snapshot, image=None, events=())), pickle.HIGHEST_PROTOCOL)
        if self._slots[number % _SLOTS].put(value):
            self._cursor[0] = number
        else:
            self.left_out += 1

    def close(self) -> None:
        """Let go of the memory; it is free when the last reader is gone."""
        self._file.close()


class SnapshotReader:
    """A sink's end of the hand-over; it may begin at any time."""

    def __init__(self, fd: int, *, images: bool = False) -> None:
        self._view = memoryview(map_memory(fd))
        self._cursor, self._slots = _places(self._view)
        self._images = np.frombuffer(self._view[_PICTURES_AT:], dtype=np.uint8) if images else None
        self._seen = 0

    def newest(self) -> Snapshot | None:
        """The newest snapshot that was not given out yet; None: there is none, or it is just being replaced."""
        newest = self._cursor[0]
        if newest == self._seen:
            return None
        value = self._slots[newest % _SLOTS].get()
        if value is None:
            return None
        # only what the station packed itself is ever unpacked
        number, shape, snapshot = pickle.loads(value)
        if number <= self._seen:
            return None
        self._seen = number
        if self._images is None or not shape:
            return snapshot  # type: ignore[no-any-return]
        start = number % _PICTURES * PICTURE_BYTES
        image = self._images[start : start + int(np.prod(shape))].reshape(shape).copy()
        # this place is written again only after the one two further was finished
        return replace(snapshot, image=image) if self._cursor[0] < number + _PICTURES - 1 else None


def _places(view: memoryview) -> tuple[memoryview[int], list[NewestValue]]:
    stops = [_CURSOR_BYTES + slot * SNAPSHOT_BYTES for slot in range(_SLOTS + 1)]
    slots = [NewestValue(view[start:stop]) for start, stop in itertools.pairwise(stops)]
    return view[:_CURSOR_BYTES].cast("Q"), slots
