"""How sure a name can be that rests on place alone.

Of two vehicles that drive alike, D apart, the wrong naming has the squared biases |b_1 + D|² + |b_2 − D|² instead of
|b_1|² + |b_2|², which costs it

    Δ ~ N(D²/σ_b², 2 D²/σ_b²) nats,    P(Δ < 0) = Φ(−D/√2 σ_b).

The biases are one draw that lasts for a minute, so that watching longer does not help, and Δ tells how likely the
naming is only as far as biases really are normal with this σ_b. So in tight formations no name is surer than such
namings are right on average.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

__all__ = ["limit_by_place"]

FloatArray = NDArray[np.float64]

_SIZE_NODES, _SIZE_WEIGHTS = np.exp(0.5 * np.sqrt(3.0) * np.array([-1.0, 0.0, 1.0])), np.array([1.0, 4.0, 1.0]) / 6.0
"""Factors and weights that integrate over σ_b, log-normal with 1σ of 0.5: a dozen biases do not tell it better, and
those of wrong names make it look small."""
_USUAL_STD = 4.0
"""Losses up to so many 1σ above the mean are those of place alone, of the likeliest of many namings and without a new
pose for the others; what is beyond was shown by motion."""
_LEAST = 0.88
"""Lowest limit: below it the alternatives are weighed by their own evidence, but no name is sure."""


def limit_by_place(p: FloatArray, score: FloatArray, place: FloatArray, bias_std: float) -> FloatArray:
    """Limit names to how often place tells vehicles apart that drive alike; the rest goes to their neighbours.

    The limit of a track is 1 − Σ_k Φ(−D_k/√2 σ_b), 0.88 at least, over the other named tracks. One with which an
    exchange would lose more than place explains counts e times less for each nat.

    Args:
        p: (m, n + 1) marginals, the last column "none of ours".
        score: (m, n) ln ratios of the best hypothesis.
        place: (m, 2) of the tracks on the ground, metres; NaN unseen.
        bias_std: σ_b, metres.
    """
    name = np.argmax(p, axis=1)
    rows = np.flatnonzero(name < score.shape[1])
    if len(rows) < 2:
        return p
    vehicle = name[rows]
    at = score[np.ix_(rows, vehicle)]
    own = np.diagonal(at)
    loss = own[:, None] + own[None, :] - at - at.T
    away = np.hypot(*np.moveaxis(place[rows][:, None] - place[rows][None], 2, 0))
    away = np.where(np.isfinite(away), away, np.inf)
    np.fill_diagonal(away, np.inf)
    # D/σ_b for each node of σ_b
    ratio = away[..., None] / (bias_std * _SIZE_NODES)
    usual = ratio**2 + _USUAL_STD * np.sqrt(2.0) * ratio
    shown = np.exp(-np.maximum(loss[..., None] - usual, 0.0))
    wrong = (ndtr(-ratio / np.sqrt(2.0)) * shown) @ _SIZE_WEIGHTS
    doubt = np.sum(wrong, axis=1)
    limit = np.maximum(1.0 - doubt, _LEAST)
    over = np.maximum(p[rows, vehicle] - limit, 0.0)
    p = p.copy()
    p[rows, vehicle] -= over
    p[np.ix_(rows, vehicle)] += over[:, None] * wrong / np.maximum(doubt, np.finfo(float).tiny)[:, None]
    return p
