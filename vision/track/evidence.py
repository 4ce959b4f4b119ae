"""Whether a track is of a vehicle, from the scores of its boxes.

The vehicles of one film share its light, distance and slant, and so the scores that they get. What looks like one and
is none gets lower ones, or one now and then. With x = ln(s / (1 − s)) − ln(s₀ / (1 − s₀)) for a box of score s, where
s₀ is the score from which on boxes count, and u the mean of x over the boxes of confirmed tracks in the last seconds, a
track gains

    x − u + MARGIN     with each box,     −MISS     in each frame without one,

and is reported from ``ENOUGH`` on: a sequential test in which u makes up for what the detector cannot know.

Reference:
    A. Wald, "Sequential Tests of Statistical Hypotheses", Ann. Math. Statist. 16(2), 1945,
    doi:10.1214/aoms/1177731118.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["ENOUGH", "UsualScore"]

Floats = NDArray[np.float64]

ENOUGH = 2.5
"""Of the sum, nats. Raise → fewer tracks on nothing; lower → tracks are reported sooner."""
MARGIN = 1.15
"""By how much less than usual a box may have and still speak for a vehicle, nats."""
MISS = 0.5
"""Against a track in each frame without a box, nats: most vehicles are seen in most frames."""
RANGE = (-0.3, 0.85)
"""Of u. Where only bright vehicles were seen, dark ones with scores of s₀ = 0.3 still are after some frames; where only
weak boxes were, two of that score are enough."""
MEMORY_S = 1.0
"""Time constant of u."""
SURE = 0.99
"""Scores count as at most so much, and as at least the rest."""


class UsualScore:
    """What scores vehicles get in this film.

    Args:
        least: the score from which on boxes count.
    """

    def __init__(self, least: float) -> None:
        self._least = float(_logit(np.array(least)))
        self._usual = RANGE[0]

    def gain(self, score: Floats, unseen: NDArray[np.bool_]) -> Floats:
        """(k,) evidence for tracks in a frame, nats, by the scores of their last boxes."""
        usual = min(max(self._usual, RANGE[0]), RANGE[1])
        return np.where(unseen, -MISS, _logit(score) - self._least - usual + MARGIN)

    def learn(self, score: Floats, dt: float) -> None:
        """Take in the scores (k,) of confirmed tracks in a frame, ``dt`` seconds after the one before."""
        if len(score):
            mean = float(_logit(score).mean()) - self._least
            self._usual += -np.expm1(-dt / MEMORY_S) * (mean - self._usual)


def _logit(score: Floats) -> Floats:
    """ln of the odds."""
    p = np.minimum(np.maximum(score, 1.0 - SURE), SURE)
    return np.asarray(np.log(p / (1.0 - p)))
