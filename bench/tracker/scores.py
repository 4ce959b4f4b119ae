"""How well ids were kept, over the boxes that the detector saw: switches, fragments, IDF1.

Reference: E. Ristani et al., "Performance Measures and a Data Set for Multi-Target, Multi-Camera Tracking", ECCV
Workshops 2016, arXiv:1609.01775 (IDF1).
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

__all__ = ["TrackingScore"]

IntArray = NDArray[np.int64]


@dataclass(slots=True)
class TrackingScore:
    """Fed with one frame after the other."""

    switches: int = 0
    """Times a vehicle's track was another than its last."""
    fragments: int = 0
    """Times a vehicle that was seen had no track, though it had had one when it was seen before."""
    true: int = 0
    tracked_boxes: int = 0
    together: Counter[tuple[int, int]] = field(default_factory=Counter)
    """Frames in which a vehicle had a track, by both."""
    last: dict[int, int] = field(default_factory=dict)
    tracked: dict[int, bool] = field(default_factory=dict)

    def add(self, vehicle: IntArray, track: IntArray) -> None:
        """Take in one frame.

        Args:
            vehicle: (m,) of each box, -1 none.
            track: (m,) of each box, -1 none.
        """
        self.true += int((vehicle >= 0).sum())
        self.tracked_boxes += int((track >= 0).sum())
        for v, t in zip(vehicle.tolist(), track.tolist(), strict=True):
            if v < 0:
                continue
            if t >= 0:
                self.switches += self.last.get(v, t) != t
                self.last[v] = t
                self.together[v, t] += 1
            elif self.tracked.get(v, False):
                self.fragments += 1
            self.tracked[v] = t >= 0

    @property
    def idf1(self) -> float:
        """2 IDTP / (true boxes + tracked boxes) with the best one-to-one naming of tracks, 0..1."""
        if not self.together:
            return 0.0
        vehicles, tracks = (sorted(set(column)) for column in zip(*self.together, strict=True))
        table = np.zeros((len(vehicles), len(tracks)))
        row, column = {v: i for i, v in enumerate(vehicles)}, {t: j for j, t in enumerate(tracks)}
        for (v, t), count in self.together.items():
            table[row[v], column[t]] = count
        i, j = linear_sum_assignment(table, maximize=True)
        return float(2 * table[i, j].sum() / (self.true + self.tracked_boxes))
