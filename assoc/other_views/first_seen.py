"""First sight of an object, by camera and track: one name in all views for what nobody can name.

A track is named after its own first sight. Where it is surely one object with another view's track, the earlier of both
counts for both; so all views end with the same name, whoever hears of whom first.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_SAME, _ANOTHER = 0.8, 0.2
"""Probability from which on two tracks count as one object, and below which they no longer do."""
_KEPT_US = 30_000_000
"""Time unseen after which a track is forgotten."""


class FirstSeen(NamedTuple):
    """An object as it was seen first, the earlier the smaller."""

    t_us: int
    view: int
    track_id: int


class Heard(NamedTuple):
    """Tracks of another view, and what they are there."""

    view: int
    track_id: IntArray
    """(k,)."""
    same: FloatArray
    """(m, k) probability that they are one object with the m tracks here."""
    first: Mapping[int, FirstSeen]


class _KnownTrack(NamedTuple):
    first: FirstSeen
    seen_us: int
    by: tuple[int, int] | None
    """View and track that it is known by, None its own."""


class FirstSeenTracks:
    """Record of which object, by its first sight, each track of a view is."""

    def __init__(self, view: int) -> None:
        self._view = view
        self._own: dict[int, FirstSeen] = {}
        self._known: dict[int, _KnownTrack] = {}

    def of(self, track_id: int) -> FirstSeen:
        """The object that a track is; of one that was never compared, its own."""
        return self._known[track_id].first if track_id in self._known else FirstSeen(0, self._view, track_id)

    @property
    def all(self) -> dict[int, FirstSeen]:
        """Objects of the tracks that were seen lately."""
        return {track: known.first for track, known in self._known.items()}

    def update(self, t_us: int, track_id: IntArray, heard: Iterable[Heard]) -> None:
        """Take in a frame.

        Args:
            t_us: when, Unix µs.
            track_id: (m,) tracks that are seen.
            heard: of each other view.
        """
        self._known = {track: known for track, known in self._known.items() if abs(t_us - known.seen_us) < _KEPT_US}
        self._own = {track: first for track, first in self._own.items() if track in self._known}
        here = track_id.tolist()
        for track in here:
            own = self._own.setdefault(track, FirstSeen(t_us, self._view, track))
            before = self._known.get(track, _KnownTrack(own, t_us, None))
            self._known[track] = before._replace(seen_us=t_us)
        for view, others, same, first in heard:
            for row, track in enumerate(here):
                for other, p in zip(others.tolist(), same[row].tolist(), strict=True):
                    self._compare(track, (view, other), p, first.get(other), here)

    def _compare(self, track: int, by: tuple[int, int], p: float, first: FirstSeen | None, here: list[int]) -> None:
        known = self._known[track]
        if known.by == by and (p < _ANOTHER or first != known.first):
            known = self._known[track] = known._replace(first=self._own[track], by=None)
        if p < _SAME or first is None or first >= known.first:
            return
        if all(self._known[each].first[1:] != first[1:] for each in here):  # two boxes are two objects
            self._known[track] = known._replace(first=first, by=by)
