"""Snapshots of a whole recording in little memory: packed a few at a time, and unpacked where they are looked at."""

from __future__ import annotations

import pickle
import threading
import zlib
from array import array
from bisect import bisect_right
from dataclasses import replace
from typing import Final

from gcs.snapshot import Snapshot

CHUNK: Final = 16
"""Snapshots that are packed together: they repeat each other, and unpacking them takes some milliseconds."""
FASTEST: Final = 1
"""Fastest of zlib's levels; the higher ones save a tenth more and take three times as long."""


class SnapshotStore:
    """Snapshots in order of time, without images and events; one thread may read them while another one adds."""

    def __init__(self) -> None:
        self._at_us = array("q")
        self._packed: list[bytes] = []
        self._newest: list[Snapshot] = []
        self._unpacked: tuple[int, list[Snapshot]] = (-1, [])
        self._lock = threading.Lock()

    def __len__(self) -> int:
        return len(self._at_us)

    @property
    def start_us(self) -> int:
        """Time of the first snapshot; there must be one."""
        return self._at_us[0]

    @property
    def stop_us(self) -> int:
        """Time of the last snapshot; there must be one."""
        return self._at_us[-1]

    def add(self, at_us: int, snapshot: Snapshot) -> None:
        """Add a snapshot at the end.

        Args:
            at_us: Its time on the recording's time line; one that is earlier than the last counts as of the same time.
            snapshot: What was worked out for it.
        """
        with self._lock:
            self._newest.append(replace(snapshot, image=None, events=()))
            if len(self._newest) == CHUNK:
                # only what this process packed itself is ever unpacked
                self._packed.append(zlib.compress(pickle.dumps(self._newest, pickle.HIGHEST_PROTOCOL), FASTEST))
                self._newest = []
            self._at_us.append(max(at_us, self._at_us[-1]) if self._at_us else at_us)

    def place(self, t_us: float) -> int:
        """Number of the newest snapshot at or before a time, -1 before the first."""
        with self._lock:
            return bisect_right(self._at_us, t_us) - 1

    def snapshot(self, place: int) -> Snapshot:
        """Return a snapshot by its number."""
        chunk, k = divmod(place, CHUNK)
        with self._lock:
            if chunk == len(self._packed):
                return self._newest[k]
            if self._unpacked[0] != chunk:
                self._unpacked = chunk, pickle.loads(zlib.decompress(self._packed[chunk]))
            return self._unpacked[1][k]
