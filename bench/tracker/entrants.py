"""All trackers of a comparison behind one call: a frame in, the track of each box and the time it took out."""

from __future__ import annotations

import time
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from bench.paper.bytetrack import ByteTrack
from bench.tracker.libraries import PUBLISHED, Absent, Published
from bench.tracker.named import Named
from bench.tracker.scene import SimulatedFrame
from bench.tracker.sort import OcSort, Sort
from vision.track.tracker import Tracker
from vision.track.tracks import Tracks

__all__ = ["OURS", "WITH_IDENTITIES", "WITH_WARP", "Entrant", "entrants"]

IntArray = NDArray[np.int64]

OURS = "ours"
WITH_WARP = "ours, camera motion given"
WITH_IDENTITIES = "ours, identities fed in"
CONFIRMED = 2
"""Sightings from which on our tracks count; those of the peers wait for as many or more."""


class Entrant(Protocol):
    """A tracker in a comparison."""

    def step(self, frame: SimulatedFrame) -> tuple[IntArray, float]:
        """The track of each box (m,), -1 none, and the processor time of the update, ms."""
        ...


class _RollcallEntrant:
    def __init__(self, use_warp: bool) -> None:
        self._tracker, self._use_warp = Tracker(), use_warp

    def step(self, frame: SimulatedFrame) -> tuple[IntArray, float]:
        warp = frame.warp if self._use_warp else None
        began = time.thread_time()
        tracks = self._tracker.update(frame.boxes, frame.t_us, warp=warp)
        took = time.thread_time() - began
        return _track_of_boxes(tracks, len(frame.boxes)), 1e3 * took


class _Identified:
    def __init__(self) -> None:
        self._named = Named()

    def step(self, frame: SimulatedFrame) -> tuple[IntArray, float]:
        began = time.thread_time()
        tracks = self._named.update(frame)
        took = time.thread_time() - began
        self._named.learn(frame, tracks)
        return _track_of_boxes(tracks, len(frame.boxes)), 1e3 * took


class _ByteTrackEntrant:
    def __init__(self) -> None:
        self._tracker = ByteTrack()

    def step(self, frame: SimulatedFrame) -> tuple[IntArray, float]:
        began = time.thread_time()
        tracks = self._tracker.update(frame.boxes)
        took = time.thread_time() - began
        return _track_of_boxes(tracks, len(frame.boxes), 1), 1e3 * took


class _SortEntrant:
    def __init__(self, tracker: Sort) -> None:
        self._tracker = tracker

    def step(self, frame: SimulatedFrame) -> tuple[IntArray, float]:
        began = time.thread_time()
        tracks = self._tracker.update(frame.boxes)
        return tracks, 1e3 * (time.thread_time() - began)


class _LibraryEntrant:
    def __init__(self, name: str) -> None:
        self._tracker = Published(name)

    def step(self, frame: SimulatedFrame) -> tuple[IntArray, float]:
        boxes = self._tracker.prepare(frame)
        began = time.thread_time()
        found = self._tracker.update(boxes)
        took = time.thread_time() - began
        return self._tracker.track_of_boxes(found, len(frame.boxes)), 1e3 * took


def entrants() -> tuple[dict[str, Entrant], list[str]]:
    """New trackers by name, and a line for each that cannot run here."""
    made: dict[str, Entrant] = {
        OURS: _RollcallEntrant(False),
        WITH_WARP: _RollcallEntrant(True),
        WITH_IDENTITIES: _Identified(),
        "SORT": _SortEntrant(Sort()),
        "ByteTrack": _ByteTrackEntrant(),
        "OC-SORT": _SortEntrant(OcSort()),
    }
    skipped = []
    for name in PUBLISHED:
        try:
            made[name] = _LibraryEntrant(name)
        except Absent as why:
            skipped.append(f"skipped: {name} ({why})")
    return made, skipped


def _track_of_boxes(tracks: Tracks, count: int, least: int = CONFIRMED) -> IntArray:
    out = np.full(count, -1)
    seen = (tracks.detection >= 0) & (tracks.hits >= least)
    out[tracks.detection[seen]] = tracks.track_id[seen]
    return out
