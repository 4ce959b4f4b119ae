"""Owners of segments, where no vehicle is two that were seen together: the best naming, and probabilities of all."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import Bounds, LinearConstraint, milp
from scipy.sparse import csr_matrix

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

_NEGLIGIBLE = -8.0
"""Pairs with less ln odds than this are in no naming that counts."""


class Namings:
    """All namings in which each segment has one vehicle at most, and no vehicle two segments that are apart.

    A naming is worth the sum of the scores of its pairs; the best is found by an integer programme.

    Args:
        score: (S, n) ln odds of each pair against "none of ours".
        apart: (S, S) pairs of segments that cannot be one vehicle.
    """

    def __init__(self, score: FloatArray, apart: BoolArray) -> None:
        self._score = score
        self._segment, self._vehicle = np.nonzero(score > _NEGLIGIBLE)
        groups = [np.flatnonzero(self._segment == s) for s in np.unique(self._segment)]
        for j in np.unique(self._vehicle):
            own = np.flatnonzero(self._vehicle == j)
            rivals = np.triu(apart[np.ix_(self._segment[own], self._segment[own])])
            groups += list(own[np.argwhere(rivals)])
        rows = np.repeat(np.arange(len(groups)), [len(group) for group in groups])
        columns = np.concatenate(groups) if groups else np.zeros(0, np.int64)
        shape = len(groups), len(self._segment)
        self._at_most_one = LinearConstraint(csr_matrix((np.ones(len(rows)), (rows, columns)), shape), -np.inf, 1.0)

    def best(self) -> IntArray:
        """(S,) vehicle of each segment in the best naming, −1 none."""
        owner = np.full(len(self._score), -1)
        chosen, _ = self._solved(np.zeros(len(self._segment)), np.ones(len(self._segment)))
        owner[self._segment[chosen]] = self._vehicle[chosen]
        return owner

    def probabilities(self) -> FloatArray:
        """(S, n + 1) probabilities of each segment's vehicles, the last column "none of ours".

        p ∝ exp V, V the best naming's worth of those in which the segment is that vehicle, or none of ours: right where
        few namings are nearly as good as the best.
        """
        worth = np.full((len(self._score), self._score.shape[1] + 1), -np.inf)
        least, most = np.zeros(len(self._segment)), np.ones(len(self._segment))
        chosen, best = self._solved(least, most)
        worth[:, -1] = best
        for k, (segment, vehicle) in enumerate(zip(self._segment.tolist(), self._vehicle.tolist(), strict=True)):
            if chosen[k]:
                worth[segment, vehicle] = best
                most[self._segment == segment] = 0.0
                worth[segment, -1] = self._solved(least, most)[1]
                most[:] = 1.0
            else:
                least[k] = 1.0
                worth[segment, vehicle] = self._solved(least, most)[1]
                least[k] = 0.0
        p = np.exp(worth - np.max(worth, axis=1, keepdims=True))
        return np.asarray(p / np.sum(p, axis=1, keepdims=True))

    def _solved(self, least: FloatArray, most: FloatArray) -> tuple[BoolArray, float]:
        """Pairs of the best naming of those that have all with ``least`` 1 and none with ``most`` 0, and its worth."""
        if not len(least):
            return np.zeros(0, np.bool_), 0.0
        gain = self._score[self._segment, self._vehicle]
        found = milp(
            -gain,
            constraints=self._at_most_one,
            integrality=np.ones(len(gain), np.int64),
            bounds=Bounds(least, most),
        )
        chosen = np.zeros(len(gain), np.bool_) if found.x is None else found.x > 0.5
        return chosen, float(np.sum(gain[chosen])) if found.x is not None else -np.inf
