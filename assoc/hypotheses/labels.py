"""From joint hypotheses to names with probabilities."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from assoc.hypotheses.doubles import share_discount, share_evidence, shared_tracks
from assoc.hypotheses.look_alikes import discount_lookalikes
from assoc.hypotheses.marginals import best_assignment, marginals
from assoc.hypotheses.search import Hypothesis, UpdateContext, discounts_of

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

_MIN_WEIGHT = 1e-4
"""Hypotheses with less than this share of the best one's weight are left out."""


def posterior_weights(hypotheses: list[Hypothesis]) -> FloatArray:
    """Posterior weights ∝ exp(value)."""
    value = np.array([h.value for h in hypotheses])
    w = np.exp(value - np.max(value))
    return np.asarray(w / np.sum(w))


def mixed_marginals(
    hypotheses: list[Hypothesis],
    share: FloatArray,
    context: UpdateContext,
    log_not_lost: FloatArray,
    elsewhere: BoolArray,
) -> FloatArray:
    """Marginals averaged over hypotheses.

    Args:
        hypotheses: Joint hypotheses over m tracks and n vehicles.
        share: Their weights.
        context: What the update worked on.
        log_not_lost: (m, n) ln chance that a vehicle is not one of the lost tracks that were once in view together with
                this track.
        elsewhere: (m, n) vehicles that were another track while this one was seen.

    Returns:
        (m, n + 1); the last column is "none of ours".
    """
    bias_std, in_view = context.noise.bias_std, context.in_view
    m, n = hypotheses[0].score.shape
    total, used = np.zeros((m, n + 1)), 0.0
    for hypothesis, w in zip(hypotheses, share, strict=True):
        if w >= _MIN_WEIGHT * np.max(share):
            bias = hypothesis.final.mean[:m]
            shared = shared_tracks(
                hypothesis.score, hypothesis.score - in_view - context.log_odds, bias, bias_std, elsewhere
            )
            score = share_evidence(hypothesis.score, shared)
            found = discounts_of(context, score, hypothesis.final, hypothesis.vehicle)
            score = share_discount(score, discount_lookalikes(score, found), shared)
            # two tracks in view at once are two vehicles, however well one moves like the other's
            total += w * marginals(score + log_not_lost)
            used += w
    return np.asarray(total / used)


def most_probable_names(p: FloatArray) -> IntArray:
    """(m,) most probable one-to-one naming by the marginals, −1 for "none of ours"."""
    ours = np.log(np.maximum(p[:, :-1], 1e-300))
    none = np.log(np.maximum(p[:, -1:], 1e-300))
    return best_assignment(ours - none)
