"""Boxes that are longer than their vehicle: round it and another one, or round two others.

A detector draws one box round two vehicles that nearly touch. Where both were followed before, the tracker sees it;
where the two came into view like this, or one of them was never apart for long enough to be a track, only the box's
length tells. Which of the two the box counts for cannot be known, so that no name of it is sure in that frame.
"""

from __future__ import annotations

from statistics import median

import numpy as np
from numpy.typing import NDArray

from assoc.records import Observation

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

LONGER = 1.35
"""A box of this many times its vehicle's length is a common one: noise and turning make it longer by up to a fifth, a
second vehicle beside or behind by half to twice."""
RIGHT = 0.75
"""Share of long boxes whose name is right: about half of those round two vehicles, nearly all of those that are long
for another reason, as where a detector's boxes vary."""
_CERTAIN = 0.9
"""Probability of a name from which the box's length is learnt as the vehicle's."""
_GROW_S, _SHRINK_S, _PART_S = 8.0, 0.5, 4.0
"""Time constants with which a learnt length grows and shrinks, seconds: no box is shorter than its vehicle for long,
while a common one may last for seconds. A vehicle twice as long as the others is named after 3.5 s. The last is for
boxes that are so short that they may be round a part of the vehicle."""
_PART = 0.72
"""Share of its vehicle's length up to which a box may be round a part of it."""
_MIN_BOXES = 3
"""Boxes from which their median tells the length of vehicles that were not learnt yet."""
_LONGEST_STEP_S = 0.5
"""Longest time between two frames that counts, seconds."""


class CommonBoxes:
    """Learns how long the box of each vehicle is, and doubts names of boxes that are longer."""

    def __init__(self, n: int) -> None:
        self._length_m = np.full(n, np.nan)
        self._t = -np.inf

    def limited(self, t: float, observation: Observation, p: FloatArray, stated: BoolArray) -> FloatArray:
        """The probabilities of a frame's names, those of common boxes at most 0.75.

        Args:
            t: Time of the frame, seconds.
            observation: Its tracks.
            p: (m, n + 1) marginals, the last column "none of ours".
            stated: (m,) tracks whose name is stated by the operator, who sees the box.
        """
        length, n = observation.length_m, len(self._length_m)
        if length is None or not n:
            return p
        name, seen = np.argmax(p, axis=1), np.isfinite(length) & (observation.gap_s <= 0.0)
        rows = np.flatnonzero(seen & (name < n))
        usual = self._usual(length[seen])
        own = self._length_m[name[rows]]
        own = np.where(np.isnan(own), usual, own)
        common = rows[(length[rows] > LONGER * own) & ~stated[rows]]
        self._learn(t, name[rows], length[rows], own, p[rows, name[rows]] > _CERTAIN)
        if not len(common):
            return p
        p = p.copy()
        over = np.maximum(p[common, name[common]] - RIGHT, 0.0)
        p[common, name[common]] -= over
        p[common, n] += over
        return p

    def _usual(self, length: FloatArray) -> float:
        """Length of a vehicle of which nothing is learnt: the median of those known, else of the boxes; NaN unknown."""
        known = self._length_m[np.isfinite(self._length_m)]
        if len(known) >= _MIN_BOXES:
            return float(median(known.tolist()))
        return float(median(length.tolist())) if len(length) >= _MIN_BOXES else np.nan

    def _learn(self, t: float, vehicle: NDArray[np.int64], seen: FloatArray, own: FloatArray, sure: BoolArray) -> None:
        """Move the vehicles' lengths (k,) from what they were, ``own``, towards those seen, where names are sure."""
        step_s = min(max(t - self._t, 0.0), _LONGEST_STEP_S)
        self._t = t
        part = seen < _PART * own
        own = np.where(part, own, np.fmin(own, seen))
        time_s = np.where(seen > own, _GROW_S, np.where(part, _PART_S, _SHRINK_S))
        self._length_m[vehicle[sure]] = (own + (seen - own) * -np.expm1(-step_s / time_s))[sure]
