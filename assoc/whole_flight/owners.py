"""Whose each segment is, where no vehicle is two that were seen together: the best naming, and its probabilities."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import Bounds, LinearConstraint, milp
from scipy.sparse import csr_matrix

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

_SWEEPS, _DAMPING = 60, 0.3
"""Sweeps of belief propagation, and the share of a new message that is taken over in each."""
_TAKEN, _FREE = 0.95, 1e-3
"""Probabilities that belief propagation starts from: of the best naming, and of any other."""


def best_owners(score: FloatArray, apart: BoolArray) -> IntArray:
    """(S,) vehicle of each segment, −1 none, by the largest sum of scores.

    An integer programme: each segment has one vehicle at most, and no vehicle has two segments that are apart.

    Args:
        score: (S, n) ln odds of each pair.
        apart: (S, S) pairs of segments that cannot be one vehicle.
    """
    owner = np.full(len(score), -1)
    segment, vehicle = np.nonzero(score > 0.0)
    if not len(segment):
        return owner
    groups = [np.flatnonzero(segment == s) for s in np.unique(segment)]
    for j in np.unique(vehicle):
        own = np.flatnonzero(vehicle == j)
        groups += list(own[np.argwhere(np.triu(apart[np.ix_(segment[own], segment[own])]))])
    rows = np.repeat(np.arange(len(groups)), [len(group) for group in groups])
    at_most_one = csr_matrix((np.ones(len(rows)), (rows, np.concatenate(groups))), (len(groups), len(segment)))
    found = milp(
        -score[segment, vehicle],
        constraints=LinearConstraint(at_most_one, -np.inf, 1.0),
        integrality=np.ones(len(segment), np.int64),
        bounds=Bounds(0.0, 1.0),
    )
    if found.x is not None:
        chosen = found.x > 0.5
        owner[segment[chosen]] = vehicle[chosen]
    return owner


def owner_probabilities(score: FloatArray, apart: BoolArray, owner: IntArray) -> FloatArray:
    """(S, n + 1) probabilities of each segment's vehicles, the last column "none of ours".

    Belief propagation over p ∝ Π exp(score), where two segments that are apart are not one vehicle: what segment g
    tells f of vehicle j is 1 − p_g(j), p_g without what f told. It begins at the best naming.

    Args:
        score: (S, n) ln odds of each pair.
        apart: (S, S) pairs of segments that cannot be one vehicle.
        owner: (S,) the best naming.
    """
    start = np.full(score.shape, _FREE)
    named = np.flatnonzero(owner >= 0)
    start[named, owner[named]] = _TAKEN
    # (g, f, j) ln of what g tells f
    told = np.where(apart[:, :, None], np.log1p(-start)[:, None, :], 0.0)
    for _ in range(_SWEEPS):
        heard = np.sum(told, axis=0)
        without = (score + heard)[:, None, :] - told.transpose(1, 0, 2)
        told += _DAMPING * (np.where(apart[:, :, None], _log_not(without), 0.0) - told)
    return _with_none(score + np.sum(told, axis=0))


def _log_not(log_odds: FloatArray) -> FloatArray:
    """ln (1 − p) of each vehicle, by ln odds (…, n) against "none of ours", also where p is 1 but for a hair."""
    every = np.concatenate([log_odds, np.zeros((*log_odds.shape[:-1], 1))], axis=-1)
    first = np.argmax(every, axis=-1)[..., None]
    total = np.logaddexp.reduce(every, axis=-1, keepdims=True)
    not_p = np.log1p(-np.minimum(np.exp(every - total), 0.5))
    np.put_along_axis(every, first, -np.inf, axis=-1)
    np.put_along_axis(not_p, first, np.logaddexp.reduce(every, axis=-1, keepdims=True) - total, axis=-1)
    return np.asarray(not_p[..., :-1])


def _with_none(log_odds: FloatArray) -> FloatArray:
    """Probabilities (…, n + 1) of ln odds (…, n) against "none of ours"."""
    every = np.concatenate([log_odds, np.zeros((*log_odds.shape[:-1], 1))], axis=-1)
    weight = np.exp(every - np.max(every, axis=-1, keepdims=True))
    return np.asarray(weight / np.sum(weight, axis=-1, keepdims=True))
