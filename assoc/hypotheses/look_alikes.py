"""Tracks that move like one of our vehicles and are none: others in the same queue."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["SPREAD_M", "discount_lookalikes", "look_alike_gap"]

FloatArray = NDArray[np.float64]

_MOST_BIAS_GAP = 5.0
"""Upper limit of |M|²/2σ_b², nats: how strongly a large bias may speak for a look-alike."""
SPREAD_M = 12.0
"""Distance over which a look-alike may follow one of our vehicles, metres."""


def look_alike_gap(bias: FloatArray, bias_std: float) -> FloatArray:
    """(m, n) ln of the density of a bias over that of an offset spread evenly over about 12 m.

    gap = 2 ln(12/σ_b) − min(|M|²/2σ_b², 5), which is how much less a track fits as a look-alike beside the vehicle.

    Args:
        bias: (m, n, 2) bias means M, metres.
        bias_std: σ_b, metres.
    """
    near = np.minimum(np.sum(bias * bias, axis=2) / (2.0 * bias_std**2), _MOST_BIAS_GAP)
    return np.asarray(2.0 * np.log(SPREAD_M / bias_std) - near)


def discount_lookalikes(
    score: FloatArray, bias: FloatArray, bias_std: float, chance: float, in_view: FloatArray
) -> FloatArray:
    """Reduce scores by the chance that a track is a look-alike moving like one of our vehicles a few metres away.

    Clutter that follows vehicle j at a distance fits j's motion with a bias that is no bias. Its likelihood is that
    of the pair with the bias density N(M; 0, σ_b²) replaced by a flat one (:func:`look_alike_gap`):
    L' = L − ln((1 − c) + c·exp(max_j (L_j − gap_j))).

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
    alike = np.max(score - in_view - look_alike_gap(bias, bias_std), axis=1)
    return np.asarray(score - np.logaddexp(np.log1p(-chance), np.log(chance) + alike)[:, None])
