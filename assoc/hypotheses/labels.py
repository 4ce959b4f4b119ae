"""From joint hypotheses to names with probabilities."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from assoc.hypotheses.marginals import best_assignment, marginals
from assoc.hypotheses.search import Hypothesis

__all__ = ["discount_lookalikes", "mixed_marginals", "most_probable_names", "posterior_weights"]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_LEAST_WEIGHT = 1e-4
"""Hypotheses with less than this share of the best one's weight are left out."""
_MOST_BIAS_GAP = 5.0
"""Upper limit of |M|²/2σ_b², nats: how strongly a large bias may speak for a look-alike."""
_SPREAD_M = 12.0
"""Distance over which a look-alike may follow one of our vehicles, metres."""


def posterior_weights(hypotheses: list[Hypothesis]) -> FloatArray:
    """Posterior weights ∝ exp(value)."""
    value = np.array([h.value for h in hypotheses])
    w = np.exp(value - np.max(value))
    return np.asarray(w / np.sum(w))


def mixed_marginals(
    hypotheses: list[Hypothesis],
    share: FloatArray,
    bias_std: float,
    chance: float,
    in_view: FloatArray,
    log_not_lost: FloatArray,
) -> FloatArray:
    """Marginals averaged over hypotheses.

    Args:
        hypotheses: Joint hypotheses over m tracks and n vehicles.
        share: Their weights.
        bias_std: σ_b, metres.
        chance: Prior chance that a track is a look-alike that moves like one of ours.
        in_view: (n,) part of the scores that a vehicle has because it should be in view.
        log_not_lost: (m, n) ln chance that a vehicle is not one of the lost tracks that were once in view together with
                this track.

    Returns:
        (m, n + 1); the last column is "none of ours".
    """
    m, n = hypotheses[0].score.shape
    total, used = np.zeros((m, n + 1)), 0.0
    for hypothesis, w in zip(hypotheses, share, strict=True):
        if w >= _LEAST_WEIGHT * np.max(share):
            bias = hypothesis.final.mean[:m]
            score = discount_lookalikes(hypothesis.score, bias, bias_std, chance, in_view)
            # two tracks in view at once are two vehicles, however well one moves like the other's
            total += w * marginals(score + log_not_lost)
            used += w
    return np.asarray(total / used)


def discount_lookalikes(
    score: FloatArray, bias: FloatArray, bias_std: float, chance: float, in_view: FloatArray
) -> FloatArray:
    """Reduce scores by the chance that a track is a look-alike moving like one of our vehicles a few metres away.

    Clutter that follows vehicle j at a distance fits j's motion with a bias that is no bias. Its likelihood is that
    of the pair with the bias density N(M; 0, σ_b²) replaced by a flat one over about 12 m:
    gap = 2 ln(12/σ_b) − min(|M|²/2σ_b², 5);  L' = L − ln((1 − c) + c·exp(max_j (L_j − gap_j))).

    Args:
        score: (m, n) ln ratios.
        bias: (m, n, 2) bias means, metres.
        bias_std: σ_b, metres.
        chance: c.
        in_view: (n,) part of the scores that a look-alike of the vehicle does not have.

    Returns:
        (m, n) ln ratios of "is the vehicle" to "unrelated or such a look-alike".
    """
    if score.shape[1] == 0:
        return score
    gap = 2.0 * np.log(_SPREAD_M / bias_std) - np.minimum(
        np.sum(bias * bias, axis=2) / (2.0 * bias_std**2), _MOST_BIAS_GAP
    )
    alike = np.max(score - in_view - gap, axis=1)
    return np.asarray(score - np.logaddexp(np.log1p(-chance), np.log(chance) + alike)[:, None])


def most_probable_names(p: FloatArray) -> IntArray:
    """(m,) most probable one-to-one naming by the marginals, −1 for "none of ours"."""
    ours = np.log(np.maximum(p[:, :-1], 1e-300))
    none = np.log(np.maximum(p[:, -1:], 1e-300))
    return best_assignment(ours - none)
