"""Vehicles that report the place of another one: how well they fit does not tell whose the track there is.

A vehicle k without a track of its own that fits the track of vehicle j lies, or it drives beside j and has no box. Its
reports move like the track in both cases, so that their evidence counts for k as for j
and says nothing about whose track it is. With E the evidence of a pair without its prior odds, gap as in
:func:`look_alike_gap`, and a the chance that the vehicle has another track,

    N = exp(E) (π + ν exp(−gap)),   L′ = L − ln(1 + (1 − a) N) + K,

where K keeps the chance of the track to be one of ours at all.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from assoc.hypotheses.look_alikes import SPREAD_M, look_alike_gap
from assoc.hypotheses.marginals import best_assignment

__all__ = ["Shared", "share_evidence", "shared_tracks"]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

_LIES = 0.02
"""π, chance that a vehicle without a track of its own reports the place of another."""
_UNSEEN_BESIDE = 0.03
"""ν, chance that it drives in the same traffic and has no box."""
_LEAST = 0.0
"""ln N from which a vehicle is weighed."""

_REACH_STD = 6.0
"""Biases of so many σ_b are no vehicle's own: one that reports to be further away from a track does not copy it."""
_WEAK = 8.0
"""Score, nats, below which a vehicle has no track of its own worth the name."""


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
    beside = _UNSEEN_BESIDE * np.exp(-look_alike_gap(bias, bias_std))
    log_copy = evidence + np.log(_LIES + beside)
    if not np.any(np.sum(log_copy > _LEAST, axis=1) > 1):
        return []
    choice = best_assignment(score)
    own = np.zeros(score.shape[1])
    taken = np.flatnonzero(choice >= 0)
    own[choice[taken]] = score[taken, choice[taken]]
    # who may be at another's track besides, and at which one best
    away2 = np.sum(bias * bias, axis=2)
    reach = min(SPREAD_M, _REACH_STD * bias_std)
    possible = (log_copy > _LEAST) & (own < _WEAK) & ~elsewhere & (away2 < reach**2)
    possible[taken, choice[taken]] = False
    possible &= (choice >= 0)[:, None] & (log_copy[np.arange(len(score)), choice] > _LEAST)[:, None]
    at = np.argmin(np.where(possible, away2, np.inf), axis=0)
    copies = np.any(possible, axis=0)
    found = []
    for row in np.unique(at[copies]).tolist():
        vehicles = np.array([choice[row], *np.flatnonzero(copies & (at == row))])
        found.append(
            Shared(
                row=row,
                vehicles=tuple(vehicles.tolist()),
                log_copy=log_copy[row, vehicles],
                lies=_LIES / (_LIES + beside[row, vehicles]),
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
