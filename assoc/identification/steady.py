"""An answer is stated as sure once it has been probable for a while: what flips within seconds was not known."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

_FOR_S = 2.0
"""Time over which the mean is taken, s: 5 s save another sixth of wrong names at 0.9, and right ones wait longer."""
_UNKNOWN = 0.5
"""Least probability that is stated for an answer "none of ours"."""


class SteadyAnswers:
    """Remembers what was thought of each track in the last seconds.

    Args:
        threshold: Least probability of a name; none falls below it by this.
    """

    def __init__(self, threshold: float) -> None:
        self._threshold = threshold
        self._past: dict[tuple[int, float], deque[tuple[float, FloatArray]]] = {}

    def limited(self, t: float, tracks: list[tuple[int, float]], p: FloatArray, free: BoolArray) -> FloatArray:
        """Marginals moved towards their mean m of the last 2 s until the likeliest answer k has c = min(p_k, m_k).

            p + (m − p) (p_k − c)/(p_k − m_k)

        Args:
            t: Time, seconds.
            tracks: m, the id of each and since when it is sure to be one vehicle, seconds.
            p: (m, n + 1), the last column "none of ours".
            free: (m,) tracks that are not limited: the operator stated what they are.
        """
        self._past = {track: self._past.get(track, deque()) for track in tracks}
        if not len(p):
            return p
        for past, row in zip(self._past.values(), p, strict=True):
            past.append((t, row))
            while past[0][0] < t - _FOR_S:
                past.popleft()
        mean = np.array([np.mean([row for _, row in past], axis=0) for past in self._past.values()])
        rows, best = np.arange(len(p)), np.argmax(p, axis=1)
        least = np.where(best < p.shape[1] - 1, self._threshold, _UNKNOWN)
        now, usual = p[rows, best], mean[rows, best]
        told = np.where(free, now, np.minimum(now, np.maximum(usual, least)))
        way = np.divide(now - told, now - usual, out=np.zeros_like(now), where=told < now)
        moved = p + way[:, None] * (mean - p)
        moved[rows, best] = told  # exactly, where it is the threshold
        return np.asarray(moved)
