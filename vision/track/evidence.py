"""Evidence that a track is of a vehicle, from the scores and sizes of its boxes.

The vehicles of one film share its light, distance and slant, and so the scores that they get. What looks like one and
is none gets lower ones, or one now and then, and is often smaller. With x = ln(s / (1 − s)) − ln(s₀ / (1 − s₀)) for a
box of score s, where s₀ is the score from which on boxes count, u the mean of x over the boxes of confirmed tracks in
the last seconds, l the logarithm of a track's size and v its mean over the confirmed tracks n at the same height of the
picture, which are about as far away, a track gains

    max(SLOPE (x − u) + MARGIN, MIN_LOOK) − min(½ ((v − l − ALIKE) / SIZE_STD)², MAX_SMALL) n / (n + 1)   with each box,
    −MISS     in each frame without one in which it was looked for,

and is reported from ``ENOUGH`` on: a sequential test in which u and v make up for what the detector cannot know. Where
a vehicle reports to be, a box is reported at once: small vehicles of ours may drive among large ones.

Reference:
    A. Wald, "Sequential Tests of Statistical Hypotheses", Ann. Math. Statist. 16(2), 1945,
    doi:10.1214/aoms/1177731118.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vision.track.track_state import ENOUGH, TrackState

Floats = NDArray[np.float64]

MARGIN = 1.15
"""Score below the usual that a box may have and still speak for a vehicle, nats."""
SLOPE = 1.5
"""Factor on differences of logit scores: detectors' scores lie closer together than the odds that they stand for."""
MISS = 0.5
"""Evidence against a track in each frame without a box, nats: most vehicles are seen in most frames."""
MIN_LOOK = 0.2
"""Least evidence for a track with each box that counts, nats: dark vehicles among bright ones are reported after a
dozen boxes."""
RANGE = (-0.3, 3.0)
"""Range of u. Where vehicles are hardly seen, two boxes of s₀ are enough; where clear, scores of 0.9 for s₀ = 0.3
are as usual."""
MEMORY_S = 1.0
"""Time constant with which the usual score u is averaged, seconds."""
SURE = 0.99
"""Upper limit of scores; the lower one is 1 less this."""
ALIKE, SIZE_STD = 0.2, 0.25
"""Largest amount by which most vehicles are smaller than the rest, and 1σ beyond that, of the logarithm of sizes."""
MAX_SMALL = 1.0
"""Most evidence against a track for its size in each frame, nats: less than MARGIN."""
BESIDE = 8.0
"""1σ of the difference in height of the picture at which tracks are compared by size, in sizes of the track."""
REPORTED_REACH = 3.0
"""Distance within which a track is where a vehicle reports to be, in sizes of the track."""


class TrackEvidence:
    """Gathers evidence for the tracks that are not reported yet.

    Args:
        least: the score from which on boxes count.
    """

    def __init__(self, least: float) -> None:
        self._least = float(_logit(np.array(least)))
        self._usual = RANGE[0]

    def gather(self, state: TrackState, dt: float, reported_px: Floats | None, reach_px: float) -> None:
        """Take in a frame.

        Args:
            dt: s since the frame before.
            reported_px: (n, 2) where vehicles report to be; None unknown.
        """
        young = state.evidence < ENOUGH
        self._learn(state.score[~young & ~state.unseen], dt)
        rows = np.flatnonzero(young)
        if not len(rows):
            return
        new = state.select(rows)
        usual = min(max(self._usual, RANGE[0]), RANGE[1])
        looks = np.maximum(SLOPE * (_logit(new.score) - self._least - usual) + MARGIN, MIN_LOOK)
        gain = np.where(new.unseen, -MISS * ~new.skipped, looks - _too_small(new, state))
        if reported_px is not None and len(reported_px):
            away = np.linalg.norm(new.x[:, None, :2] - reported_px, axis=2).min(axis=1)
            gain[~new.unseen & (away < np.maximum(REPORTED_REACH * new.length, reach_px))] = ENOUGH
        state.evidence[rows] += gain

    def _learn(self, score: Floats, dt: float) -> None:
        """Take in the scores (k,) of tracks that are reported."""
        if len(score):
            mean = float(_logit(score).mean()) - self._least
            self._usual += -float(np.expm1(-dt / MEMORY_S)) * (mean - self._usual)


def _too_small(new: TrackState, state: TrackState) -> Floats:
    """(k,) what the sizes of new tracks say against them, nats, by those that are confirmed."""
    known = np.flatnonzero(state.confirmed & ~state.unseen)
    size, height = state.length[known], state.x[known, 1]
    # w = e^(−Δy² / 2 (BESIDE L)²),  n = Σ w,  v = Σ w ln L / n
    away = (new.x[:, 1, None] - height) / (BESIDE * size)
    weight = np.exp(-0.5 * away * away)
    n = weight.sum(axis=1)
    less = np.maximum((weight @ np.log(size)) / np.maximum(n, 1e-9) - np.log(new.length) - ALIKE, 0.0) / SIZE_STD
    return np.asarray(np.minimum(0.5 * less * less, MAX_SMALL) * n / (n + 1.0))


def _logit(score: Floats) -> Floats:
    """ln of the odds."""
    p = np.minimum(np.maximum(score, 1.0 - SURE), SURE)
    return np.asarray(np.log(p / (1.0 - p)))
