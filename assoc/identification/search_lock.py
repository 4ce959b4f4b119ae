"""Lock of the search: an update searches many poses and assignments, or only refines the last solution."""

from __future__ import annotations

from enum import Enum

import numpy as np
from numpy.typing import NDArray

from assoc.params import LockParams

FloatArray = NDArray[np.float64]


class SearchState(Enum):
    """Mode of an update."""

    SEARCHING = "searching"
    """Many starting points: another solution may still turn out to be the right one."""
    LOCKED = "locked"
    """The last solution is refined and a few exchanges of vehicles are tried."""


class SearchLock:
    """Locks the search once enough tracks have certain answers, and unlocks it when one of them becomes doubtful."""

    def __init__(self, params: LockParams) -> None:
        self._params = params
        self.state = SearchState.SEARCHING
        self._started_s = np.inf
        self._last_drop_s = -np.inf
        self._last_best_score: dict[int, float] = {}

    def start(self, t: float) -> None:
        """Note the time of the first frame; later calls change nothing."""
        self._started_s = min(self._started_s, t)

    def unlock(self, t: float) -> None:
        """Search again: something is known that the last solution did not have."""
        self._last_drop_s, self.state = t, SearchState.SEARCHING

    def update(self, t: float, certainty: FloatArray, share: float, best_score: dict[int, float]) -> None:
        """Lock or unlock by the results of an update.

        Args:
            t: Time, seconds.
            certainty: (m,) probability of the likeliest answer of each track.
            share: Posterior weight of the best hypothesis.
            best_score: Largest score of each track that is seen, nats, by its column of the history.
        """
        q = self._params
        before = self._last_best_score
        if any(score < before.get(column, -np.inf) - q.score_drop for column, score in best_score.items()):
            self._last_drop_s = t
        self._last_best_score = best_score
        certain = certainty > q.confidence
        enough = certain.sum() >= max(q.least_tracks, q.share * len(certain)) and share > q.hypothesis_share
        lasting = min(t - self._started_s, t - self._last_drop_s) > q.after_s
        self.state = SearchState.LOCKED if lasting and (certain.all() or enough) else SearchState.SEARCHING
