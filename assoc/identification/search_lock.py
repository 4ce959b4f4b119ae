"""Whether the search over poses and assignments is still open, or locked on one answer."""

from __future__ import annotations

from enum import Enum

import numpy as np
from numpy.typing import NDArray

from assoc.params import LockParams

__all__ = ["SearchLock", "SearchState"]

FloatArray = NDArray[np.float64]


class SearchState(Enum):
    """What an update does."""

    SEARCHING = "searching"
    """Many starts: the answer may still be another one."""
    LOCKED = "locked"
    """The last answer is refined, a few exchanges are tried and nothing else."""


class SearchLock:
    """Locks the search once enough tracks have certain answers, and opens it when one of them becomes doubtful."""

    def __init__(self, params: LockParams) -> None:
        self._params = params
        self.state = SearchState.SEARCHING
        self._started_s = np.inf
        self._last_drop_s = -np.inf
        self._last_best_score: dict[int, float] = {}

    def start(self, t: float) -> None:
        """Begin to count at the first frame; later calls change nothing."""
        self._started_s = min(self._started_s, t)

    def update(self, t: float, certainty: FloatArray, share: float, best_score: dict[int, float]) -> None:
        """Go by the answers of an update.

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
        most = certain.sum() >= max(q.least_tracks, q.share * len(certain)) and share > q.hypothesis_share
        lasting = min(t - self._started_s, t - self._last_drop_s) > q.after_s
        self.state = SearchState.LOCKED if lasting and (certain.all() or most) else SearchState.SEARCHING
