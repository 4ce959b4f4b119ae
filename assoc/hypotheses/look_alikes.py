"""Tracks that move like one of our vehicles and are none: others in the same queue."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

_MAX_BIAS_GAP = 5.0
"""Upper limit of |M|²/2σ_b², nats: how strongly a large bias may speak for a look-alike."""
SPREAD_M = 12.0
"""Distance over which a look-alike may follow one of our vehicles, metres."""
_YOUNG_S = 0.5
"""Age from which ages are told apart, seconds."""


def look_alike_gap(bias: FloatArray, bias_std: float) -> FloatArray:
    """(m, n) ln of the density of a bias over that of an offset spread evenly over about 12 m.

    gap = 2 ln(12/σ_b) − min(|M|²/2σ_b², 5), which is how much less a track fits as a look-alike beside the vehicle.

    Args:
        bias: (m, n, 2) bias means M, metres.
        bias_std: σ_b, metres.
    """
    near = np.minimum(np.sum(bias * bias, axis=2) / (2.0 * bias_std**2), _MAX_BIAS_GAP)
    return np.asarray(2.0 * np.log(SPREAD_M / bias_std) - near)


@dataclass(frozen=True, slots=True)
class Discounts:
    """Shares of the vehicles' reports that look-alikes explain."""

    log_d: FloatArray
    """(m, n) ln D_j for the age of each track."""
    changed: BoolArray
    """(m, n) scores that a change of vehicle would lower: what they had before it is another vehicle's."""
    kept: BoolArray
    """(m, n) scores of the best assignment and the best of each vehicle, of which a changed one may be what is left."""


def discounts(
    score: FloatArray,
    inherited: FloatArray,
    bias: FloatArray,
    bias_std: float,
    chance: float,
    in_view: FloatArray,
    age_s: FloatArray,
    vehicle: IntArray,
) -> Discounts:
    """Discounts for the chance that a vehicle has no box, and a track beside it moves as it does.

    Clutter that follows vehicle j at a distance, or others of its formation, fit j's motion with an offset that is no
    bias. Their likelihood is that of the pair with the bias density N(M; 0, σ_b²) replaced by a flat one
    (:func:`look_alike_gap`). So if no track is j, its reports are as likely as beside unrelated tracks times

        D_j = (1 − c) + c·exp(max_k (L_kj − gap_kj)).

    Scores grow while a track lives: of what an older track k says, the share since track i began, age_i/age_k, stands
    against i. What a score inherits from another vehicle, as which the track moved before, says nothing of how it moved
    like this one.

    Args:
        score: (m, n) ln ratios, m and n at least 1.
        inherited: (m, n) their parts from before a change of vehicle.
        bias: (m, n, 2) bias means, metres.
        bias_std: σ_b, metres.
        chance: c.
        in_view: (n,) part of the scores that a look-alike of the vehicle does not have.
        age_s: (m,) age of each track, seconds.
        vehicle: (m,) of each track in the best assignment, −1 none.
    """
    gain = -in_view - look_alike_gap(bias, bias_std)
    share = np.minimum((age_s[:, None] + _YOUNG_S) / (age_s + _YOUNG_S), 1.0)
    rows = np.flatnonzero(vehicle >= 0)
    assigned = np.zeros(score.shape, np.bool_)
    assigned[rows, vehicle[rows]] = True
    changed = (inherited > 0.0) & (score < inherited) & ~assigned
    beside = (score - inherited) * share[:, :, None] + gain
    itself = np.arange(len(score))
    beside[itself, itself] = np.where(changed, -np.inf, score + gain)
    log_d = np.logaddexp(np.log1p(-chance), np.log(chance) + np.max(beside, axis=1))
    return Discounts(log_d, changed, assigned | (score == np.max(score, axis=1, keepdims=True)))


def discount_lookalikes(score: FloatArray, found: Discounts) -> FloatArray:
    """Reduce scores by what look-alikes explain, L'_ij = L_ij − ln D_j.

    Tracks that compete for one vehicle keep their difference. The rest of a score is reduced like the scores that it
    may be a rest of, the best one of its track and that of the best assignment.

    Args:
        score: (m, n) ln ratios.
        found: D of them.

    Returns:
        (m, n) ln ratios of "is the vehicle" to "unrelated or such a look-alike".
    """
    own = np.max(np.where(found.kept, found.log_d, 0.0), axis=1, keepdims=True)
    return np.asarray(score - np.where(found.changed, np.maximum(found.log_d, own), found.log_d))


def unseen_evidence(found: Discounts, vehicle: IntArray) -> float:
    """Σ ln D_j over the vehicles without a track: what look-alikes beside them explain of their reports.

    An assignment that leaves them out weighs exp(Σ L) times exp of this.

    Args:
        found: D of its scores.
        vehicle: (m,) the assignment, −1 none.
    """
    unseen = np.ones(found.log_d.shape[1], np.bool_)
    unseen[vehicle[vehicle >= 0]] = False
    return float(np.sum(np.max(found.log_d, axis=0)[unseen]))
