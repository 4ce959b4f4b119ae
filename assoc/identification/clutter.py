"""Probability of look-alikes that are none of ours."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from assoc.hypotheses.search import UpdateContext
from assoc.params import IdentifierParams

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


class Clutter:
    """Remembers when tracks were seen that were none of ours."""

    def __init__(self, params: IdentifierParams) -> None:
        self._params = params
        self._seen_s = -np.inf

    def chance(self, t: float, seen: int, view: FloatArray) -> float:
        """Prior chance of a look-alike, larger while clutter was seen or more tracks are seen than expected.

        Args:
            t: Time, seconds.
            seen: Tracks that are seen.
            view: (n,) probability of each vehicle to be in view.
        """
        q, learning = self._params, self._params.learning
        if t - self._seen_s < learning.clutter_memory_s:
            return q.clutter_seen
        seen = max(seen, 1)
        # c = c₀ + (c₁ − c₀) max(seen − Σ v − ½, 0) / seen
        surplus = max(seen - float(np.sum(view)) - learning.spare_tracks, 0.0) / seen
        return q.clutter + (q.clutter_seen - q.clutter) * surplus

    def note(self, t: float, context: UpdateContext, none_of_ours: BoolArray) -> None:
        """Note when a track (m,) was certainly none of ours while more were seen than vehicles expected in view."""
        seen, expected = np.sum(context.gap_s <= 0.0), np.sum(context.view)
        if seen > expected + self._params.learning.spare_tracks and np.any(none_of_ours):
            self._seen_s = t
