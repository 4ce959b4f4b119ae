"""Tracks that were in view together: two boxes in one image are two vehicles, also after one of them is lost.

While both tracks are seen the assignment ensures that. Once one of them is lost, its last probabilities still count
against the tracks that were seen beside it; a track that began only since may be its vehicle.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

_MAX_NATS = 8.0
"""Most that lost tracks count against another, nats: their names may have been wrong."""

_PROBABLE = 0.95
"""Probability above which a vehicle surely is one of the tracks seen beside another."""
_HISTORY_S = 5.0
"""Time for which a vehicle must have been another track, seconds: the first names of two that report one place may be
wrong."""
_LONGEST_STEP_S = 1.0
"""Time that counts between two updates, seconds."""


class CoVisibility:
    """Remembers which tracks each was seen beside, and its probabilities when it was seen last.

    Tracks are columns of the history.
    """

    def __init__(self, n_vehicles: int) -> None:
        self._belief = np.zeros((0, n_vehicles))
        self._beside = np.zeros((0, 0), np.bool_)
        """(C, C) whether a track was seen beside another, too far from it to have been exchanged with it."""
        self._elsewhere_s = np.zeros((0, n_vehicles))
        """(C, n) for how long a vehicle surely was another track that was seen beside this one, seconds."""
        self._t = -np.inf

    def begin(self, columns: IntArray, width: int) -> None:
        """Start tracks that are new in their ``columns``, of ``width`` in all."""
        more = width - len(self._belief)
        self._belief = np.pad(self._belief, ((0, more), (0, 0)))
        self._beside = np.pad(self._beside, ((0, more), (0, more)))
        self._elsewhere_s = np.pad(self._elsewhere_s, ((0, more), (0, 0)))
        self._belief[columns] = 0.0
        self._beside[columns] = self._beside[:, columns] = False
        self._elsewhere_s[columns] = 0.0

    def reset(self, columns: IntArray) -> None:
        """Clear what is known of tracks that may be another vehicle by now."""
        self._beside[columns] = False
        self._elsewhere_s[columns] = 0.0

    def forget(self, column: int) -> None:
        """Clear what a track was, which was wrong: it keeps no vehicle from the tracks beside it."""
        if column < len(self._belief):
            self._belief[column] = 0.0

    def update(self, t: float, seen: IntArray, place: FloatArray, belief: FloatArray, reach_m: float) -> None:
        """Remember the tracks of a frame.

        Args:
            t: Its time, seconds.
            seen: (s,) their columns.
            place: (s, 2) on the ground, metres.
            belief: (s, n) probability of each vehicle.
            reach_m: Tracks nearer than this may be exchanged.
        """
        away = np.linalg.norm(place[:, None] - place[None], axis=2)
        beside = away >= reach_m
        self._beside[np.ix_(seen, seen)] = beside
        self._belief[seen] = belief
        self._elsewhere_s[seen] += min(t - self._t, _LONGEST_STEP_S) * (beside @ belief > _PROBABLE)
        self._t = t

    def log_handover(self, before: IntArray, change: FloatArray) -> FloatArray:
        """Evidence of tracks that broke off for those that a tracker went on with: ln (p + (1 − p) c).

        Args:
            before: (k,) their columns, −1 none.
            change: (k,) c, chance that a tracker went on with another one.

        Returns:
            (k, n), 0 where nothing broke off.
        """
        claim = np.log(change[:, None] + (1.0 - change)[:, None] * self._belief[before])
        return np.asarray(np.where(before[:, None] >= 0, claim, 0.0))

    def elsewhere(self, columns: IntArray) -> BoolArray:
        """(m, n) vehicles that have surely been another track for long while these were seen."""
        return np.asarray(self._elsewhere_s[columns] >= _HISTORY_S)

    def log_not_lost(self, columns: IntArray, seen: BoolArray) -> FloatArray:
        """Return the log probability that each vehicle is none of the lost tracks that were seen beside a track: ln (1
        − max_k p_k).

        Args:
            columns: (m,) tracks.
            seen: (m,) those in sight; all others are lost.

        Returns:
            (m, n), −8 at least.
        """
        lost = np.any(self._beside[columns], axis=0)
        lost[columns[seen]] = False
        held = np.zeros((len(columns), self._belief.shape[1]))
        for k in np.flatnonzero(lost):
            held = np.maximum(held, self._beside[columns, k][:, None] * self._belief[k])
        return np.asarray(np.log(np.maximum(1.0 - held, np.exp(-_MAX_NATS))))
