"""Greatest certainty of a name that rests on place alone.

Of two vehicles that drive alike, D apart, the wrong naming has the squared biases |b_1 + D|² + |b_2 − D|² instead of
|b_1|² + |b_2|², which costs it

    Δ ~ N(D²/σ_b², 2 D²/σ_b²) nats,    P(Δ < 0) = Φ(−D/√2 σ_b).

The biases are one draw that lasts for a minute, so that watching longer does not help, and Δ tells how likely the
naming is only as far as biases really are normal with this σ_b. So in tight formations no name is surer than such
namings are right on average.

A vehicle that the detector does not find, as it may not for as long as it is in view, leaves its report to a stranger
beside it. With q the chance that a vehicle has a box of its own, N the density of its bias and λ that of strangers that
move alike, the odds that a track is the vehicle and not such a stranger are

    q N(M) / ((1 − q) λ),

so that among parked cars a name far from its report is no surer than that.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit, ndtr

from assoc.evidence.likelihood import log_density

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]

_SIZE_NODES, _SIZE_WEIGHTS = np.exp(0.5 * np.sqrt(3.0) * np.array([-1.0, 0.0, 1.0])), np.array([1.0, 4.0, 1.0]) / 6.0
"""Factors and weights that integrate over σ_b, log-normal with 1σ of 0.5: a dozen biases do not tell it better, and
those of wrong names make it look small."""
_USUAL_STD = 4.0
"""Number of 1σ above the mean up to which a loss is that of place alone, of the likeliest of many namings and without a
new pose for the others; what is beyond was shown by motion."""
_MIN_LIMIT = 0.88
"""Lowest limit: below it the alternatives are weighed by their own evidence, but no name is sure."""

_FOUND = 0.9
"""q. On labelled films from drones 0.88 to 0.94 of the vehicles have a box; what is missed is missed for long: a kind,
a colour, a shadow that the detector does not know."""
_NEAR_M = 6.0
"""Radius within which strangers are counted, metres: two bays to either side."""
_FAR_OFF = -30.0
"""Least that being far off counts for a pair, nats: strangers that move otherwise have less."""
_FORGOTTEN_NATS_S = 0.1
"""Loss of the odds of the past in a second: biases wander in a minute, reports go wrong for some seconds."""


def limit_by_place(p: FloatArray, score: FloatArray, away: FloatArray, bias_std: float) -> FloatArray:
    """Limit names to how often place tells vehicles apart that drive alike; the rest goes to their neighbours.

    The limit of a track is 1 − Σ_k Φ(−D_k/√2 σ_b), 0.88 at least, over the other named tracks. One with which an
    exchange would lose more than place explains counts e times less for each nat.

    Args:
        p: (m, n + 1) marginals, the last column "none of ours".
        score: (m, n) ln ratios of the best hypothesis.
        away: (m, m) distance of tracks on the ground, metres; NaN where one was not seen.
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
    away = away[np.ix_(rows, rows)]
    away = np.where(np.isfinite(away), away, np.inf)
    np.fill_diagonal(away, np.inf)
    # D/σ_b for each node of σ_b
    ratio = away[..., None] / (bias_std * _SIZE_NODES)
    usual = ratio**2 + _USUAL_STD * np.sqrt(2.0) * ratio
    shown = np.exp(-np.maximum(loss[..., None] - usual, 0.0))
    wrong = (ndtr(-ratio / np.sqrt(2.0)) * shown) @ _SIZE_WEIGHTS
    doubt = np.sum(wrong, axis=1)
    limit = np.maximum(1.0 - doubt, _MIN_LIMIT)
    over = np.maximum(p[rows, vehicle] - limit, 0.0)
    p = p.copy()
    p[rows, vehicle] -= over
    p[np.ix_(rows, vehicle)] += over[:, None] * wrong / np.maximum(doubt, np.finfo(float).tiny)[:, None]
    return p


def log_odds_among_strangers(
    p: FloatArray,
    score: FloatArray,
    bias: FloatArray,
    bias_std: float,
    view: FloatArray,
    log_area: float,
    *,
    found: float = 1.0,
) -> FloatArray:
    """ln odds of each name against a stranger that stands where a vehicle without a box reports to be.

    Args:
        p: (m, n + 1) marginals, the last column "none of ours".
        score: (m, n) ln ratios of the best hypothesis.
        bias: (m, n, 2) bias means M, metres; their differences tell how far tracks are apart.
        bias_std: σ_b, metres.
        view: (n,) probability of each vehicle to be in view.
        log_area: ln of twice the ground area in view, m².
        found: Share of the vehicles in view that have a box; q is that, or less.

    Returns:
        (m,) of the likeliest name; inf where no strangers move like its vehicle, and for tracks that are none of ours.
    """
    name = np.argmax(p, axis=1)
    rows, strangers = np.flatnonzero(name < score.shape[1]), np.flatnonzero(name == score.shape[1])
    odds_of = np.full(len(p), np.inf)
    if not len(rows) or not len(strangers):
        return odds_of
    vehicle = name[rows]
    alike = score[np.ix_(strangers, vehicle)] > _FAR_OFF
    M = bias[rows, vehicle]
    near = np.linalg.norm(bias[np.ix_(strangers, vehicle)] - M, axis=2) < _NEAR_M
    beside = np.sum(alike & near, axis=0) / (np.pi * _NEAR_M**2)
    density = np.maximum(beside, np.sum(alike, axis=0) / (0.5 * np.exp(log_area)))
    var = np.full(len(rows), bias_std**2)
    boxed = np.maximum(min(_FOUND, found) * view[vehicle], np.finfo(float).tiny)
    odds = np.log(boxed / (1.0 - boxed)) + log_density(np.sum(M * M, axis=1), var, var)
    some = density > 0.0
    odds_of[rows[some]] = odds[some] - np.log(density[some])
    return odds_of


class StrangerLimit:
    """Limit of names by their odds against a stranger, the best ones of late: a report that goes wrong is no
    stranger's.

    A stranger would have had to stand where the vehicle reported to be all the time. So the odds that a name had once
    are forgotten slowly.
    """

    def __init__(self) -> None:
        self._best: dict[tuple[int, int], float] = {}
        self._t = np.inf

    def limit(self, t: float, tracks: IntArray, p: FloatArray, odds: FloatArray, stated: BoolArray) -> FloatArray:
        """Limit names; what is taken from them goes to "none of ours".

        Args:
            t: time, seconds.
            tracks: (m,) ids.
            p: (m, n + 1) marginals, the last column "none of ours".
            odds: (m,) of ``log_odds_among_strangers``.
            stated: (m,) whether an operator said whose the track is, which no place contradicts.
        """
        name = np.argmax(p, axis=1)
        forgotten = max(t - self._t, 0.0) * _FORGOTTEN_NATS_S
        self._t = t
        seen = set(tracks.tolist())
        self._best = {pair: best - forgotten for pair, best in self._best.items() if pair[0] in seen}
        p = p.copy()
        for i in np.flatnonzero(name < p.shape[1] - 1).tolist():
            pair = int(tracks[i]), int(name[i])
            remembered = self._best.get(pair, -np.inf)
            best = remembered if np.isinf(odds[i]) else max(float(odds[i]), remembered)
            if np.isfinite(best):
                self._best[pair] = best
            if np.isfinite(odds[i]) and not stated[i]:
                over = max(p[i, name[i]] - float(expit(best)), 0.0)
                p[i, name[i]] -= over
                p[i, -1] += over
        return p
