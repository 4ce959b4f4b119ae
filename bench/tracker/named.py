"""Our tracker with identities fed in: tracks are named, and continued, where vehicles report to be.

A substitute for the program's identifier that needs only pixels, so that crowds of two hundred stay quick.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from bench.tracker.scene import SimulatedFrame
from vision.track.tracker import Tracker
from vision.track.tracks import Stitch, Tracks

__all__ = ["Named"]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

REACH = 30.0
"""No vehicle is this far from its report, px."""
MEMORY = 0.9
"""Share of the evidence that is left after a frame."""
SURE = 5
"""Sightings before a track has a name."""


class Named:
    """Tracker with known identities of its tracks."""

    def __init__(self) -> None:
        self._tracker = Tracker()
        self._distance: dict[int, FloatArray] = {}
        """Track → mean squared distance to every vehicle's report, px²."""
        self._name: dict[int, int] = {}

    def update(self, frame: SimulatedFrame) -> Tracks:
        """Take in one frame."""
        return self._tracker.update(
            frame.boxes, frame.t_us, warp=frame.warp, stitch=self._stitch(frame), known=self._name
        )

    def learn(self, frame: SimulatedFrame, tracks: Tracks) -> None:
        """Name the tracks again."""
        seen = tracks.detection >= 0
        centre = frame.boxes.centre[tracks.detection[seen]]
        squared = np.square(centre[:, None] - frame.reported).sum(axis=2)
        for track, now in zip(tracks.track_id[seen].tolist(), squared, strict=True):
            self._distance[track] = MEMORY * self._distance.get(track, now) + (1 - MEMORY) * now
        hits = dict(zip(tracks.track_id.tolist(), tracks.hits.tolist(), strict=True))
        self._distance = {track: d for track, d in self._distance.items() if track in hits}
        sure = [track for track in self._distance if hits[track] >= SURE]
        self._name = {}
        if sure:
            reach2 = (REACH * frame.scale) ** 2
            cost = np.minimum(np.stack([self._distance[track] for track in sure]), reach2)
            i, j = linear_sum_assignment(cost)
            close = cost[i, j] < reach2
            self._name = {sure[row]: int(vehicle) for row, vehicle in zip(i[close], j[close], strict=True)}

    def _stitch(self, frame: SimulatedFrame) -> Stitch:
        def continued(track_id: IntArray, centres: FloatArray) -> NDArray[np.intp]:
            vehicle = np.array([self._name.get(int(track), -1) for track in track_id], np.int64)
            rows = np.flatnonzero(vehicle >= 0)
            squared = np.square(frame.reported[vehicle[rows], None] - centres).sum(axis=2)
            reach2 = (REACH * frame.scale) ** 2
            i, j = linear_sum_assignment(np.minimum(squared, reach2))
            close = squared[i, j] < reach2
            return np.stack([rows[i[close]], j[close]], axis=1).astype(np.intp)

        return continued
