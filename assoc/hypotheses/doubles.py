"""Vehicles that report the place of another one: how well they fit does not tell whose the track there is.

A vehicle k without a track of its own that fits the track of vehicle j lies, or it drives beside j and has no box. Its
reports move like the track in both cases, so that their evidence counts for k as for j and says nothing about whose
track it is. With E the evidence of a pair without its prior odds, F the density of an offset spread over 12 m, N̄ that
of a bias, averaged over how large biases are, ΔE by how much the best of them fits better, and a the chance that the
vehicle has another track,

    N = exp(E) (π + ν F/N̄(M) + ν exp(ΔE − 12 − E/10)),   L′ = L − ln(1 + (1 − a) N) + K,

where K keeps the chance of the track to be one of ours at all. The last term is a copy that is late.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from assoc.hypotheses.look_alikes import SPREAD_M, look_alike_gap
from assoc.hypotheses.marginals import best_assignment

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

_LIES = 0.02
"""π, chance that a vehicle without a track of its own reports the place of another."""
_UNSEEN_BESIDE = 0.03
"""ν, chance that it drives in the same traffic and has no box."""
_MIN_LOG_COPY = 0.0
"""ln N from which a vehicle is weighed."""

_REACH_STD = 6.0
"""Biases of this many σ_b are no vehicle's own: one that reports to be further away from a track does not copy it."""
_WEAK = 8.0
"""Score, nats, below which a vehicle has no track of its own worth the name."""
_EITHER_FIT, _EITHER_FIT_SHARE = 12.0, 0.1
"""Amount by which one of two that report one place with errors of their own may fit better: nats, and share of its
E."""
_MAX_BESIDE = 4.0
"""Upper limit of ln F/N̄ and of what motion tells: certain enough, whatever a copy does that has no model."""
_SIZE_SPREAD = 0.3
"""1σ of ln σ_b: it is learnt from a dozen biases, and some vehicles wander more than others."""
_SIZE_NODES = np.exp(_SIZE_SPREAD * np.sqrt(3.0) * np.array([-1.0, 0.0, 1.0]))
_SIZE_WEIGHTS = np.array([1.0, 4.0, 1.0]) / 6.0
"""Factors and weights that integrate over σ_b (Gauss and Hermite, three nodes)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Shared:
    """A track that several vehicles report to be at."""

    row: int
    vehicles: tuple[int, ...]
    """The one that the best assignment gives it first, then those without a track of their own."""
    log_copy: FloatArray
    """(q,) ln N of each of them, less what other tracks explain."""
    lies: FloatArray
    """(q,) chance that it lies rather than drives beside the other, if the track is not its own."""


def shared_tracks(
    score: FloatArray, evidence: FloatArray, bias: FloatArray, bias_std: float, elsewhere: BoolArray
) -> list[Shared]:
    """Tracks that fit a vehicle without a track of its own besides the one that they are assigned to.

    Args:
        score: (m, n) ln ratios.
        evidence: (m, n) their part that is not prior odds.
        bias: (m, n, 2) bias means, metres.
        bias_std: σ_b, metres.
        elsewhere: (m, n) vehicles that were another track beside this one: it is not theirs, whatever they report now.
    """
    beside = _beside(bias, bias_std)
    log_copy = evidence + np.log(_LIES + beside)
    if not np.any(np.sum(log_copy > _MIN_LOG_COPY, axis=1) > 1):
        return []
    gap = look_alike_gap(bias, bias_std)
    choice = best_assignment(score)
    own = np.zeros(score.shape[1])
    taken = np.flatnonzero(choice >= 0)
    own[choice[taken]] = score[taken, choice[taken]]
    # who may be at another's track besides, and at which one best
    away2 = np.sum(bias * bias, axis=2)
    reach = min(SPREAD_M, _REACH_STD * bias_std)
    possible = (log_copy > _MIN_LOG_COPY) & (own < _WEAK) & ~elsewhere & (away2 < reach**2)
    possible[taken, choice[taken]] = False
    possible &= (choice >= 0)[:, None] & (log_copy[np.arange(len(score)), choice] > _MIN_LOG_COPY)[:, None]
    at = np.argmin(np.where(possible, away2, np.inf), axis=0)
    copies = np.any(possible, axis=0)
    found = []
    for row in np.unique(at[copies]).tolist():
        vehicles = np.array([choice[row], *np.flatnonzero(copies & (at == row))])
        late = _late(evidence[row, vehicles])
        found.append(
            Shared(
                row=row,
                vehicles=tuple(vehicles.tolist()),
                log_copy=evidence[row, vehicles] + np.log(_LIES + beside[row, vehicles] + late),
                lies=_LIES / (_LIES + _UNSEEN_BESIDE * np.exp(-gap[row, vehicles])),
            )
        )
    return found


def share_evidence(score: FloatArray, shared: list[Shared]) -> FloatArray:
    """(m, n) scores L′ in which vehicles that report one place share the evidence of the track there."""
    if not shared:
        return score
    score = score.copy()
    for track in shared:
        explained = np.logaddexp(0.0, track.log_copy)
        vehicles = list(track.vehicles)
        score[:, vehicles] -= explained
        score[track.row, vehicles] += np.sum(explained)
    return score


def share_discount(score: FloatArray, reduced: FloatArray, shared: list[Shared]) -> FloatArray:
    """The scores reduced for look-alikes, with one reduction for all vehicles that report the place of a track.

    That a vehicle drives beside that track without a box is among what N weighs already: were each one's score reduced
    by its own gap as well, the distance to the track would count twice.

    Args:
        score: (m, n) L′.
        reduced: (m, n) L′ reduced for each vehicle by the chance of a look-alike.
        shared: Tracks that several vehicles report to be at.
    """
    reduced = reduced.copy()
    for track in shared:
        vehicles = list(track.vehicles)
        reduction = np.max(score[track.row, vehicles] - reduced[track.row, vehicles])
        reduced[track.row, vehicles] = score[track.row, vehicles] - reduction
    return reduced


def shares_of_two(evidence: FloatArray, bias: FloatArray, bias_std: float) -> FloatArray:
    """Chances that a track is one or the other of two vehicles that report its place.

    p_1 : p_2 = w_2 : w_1, with w = π + ν F/N̄(M) + ν exp(ΔE − 12 − E/10) of one if the track is the other one's.

    Args:
        evidence: (2,) E of the track with each of them, nats.
        bias: (2, 2) bias means M, metres.
        bias_std: σ_b, metres.
    """
    weight = _LIES + _beside(bias, bias_std) + _late(evidence)
    return weight[::-1] / np.sum(weight)


def _late(evidence: FloatArray) -> FloatArray:
    """(q,) ν exp(ΔE − 12 − E/10) for each of some vehicles at one track: that it is a copy that is late.

    Its offset changes as the other brakes and turns. With its delay it would fit as well as the other, by ΔE better.
    Two that report one place with errors of their own differ as well, the more the longer they are compared.

    Args:
        evidence: (q,) E, nats.
    """
    best = np.max(evidence)
    less = best - evidence - _EITHER_FIT - _EITHER_FIT_SHARE * np.maximum(best, 0.0)
    return np.asarray(_UNSEEN_BESIDE * np.exp(np.minimum(less, _MAX_BESIDE)))


def _beside(bias: FloatArray, bias_std: float) -> FloatArray:
    """(...) ν F/N̄(M): that a vehicle drives within 12 m of a track without a box, or is a copy that is late.

    F is the density of an offset spread over 12 m, N̄ that of a bias, averaged over how large biases are.

    Args:
        bias: (..., 2) bias means M, metres.
        bias_std: σ_b, metres.
    """
    var = (bias_std * _SIZE_NODES) ** 2
    density = np.log(_SIZE_WEIGHTS / var) - np.sum(bias * bias, axis=-1)[..., None] / (2.0 * var)
    gap = 2.0 * np.log(SPREAD_M) + np.logaddexp.reduce(density, axis=-1)
    return np.asarray(_UNSEEN_BESIDE * np.exp(-np.maximum(gap, -_MAX_BESIDE)))
