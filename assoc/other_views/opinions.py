"""What a view answers once it has heard the others: of several answers about one object the better founded counts.

All views compare with the same reports, whose errors they share: two that agree prove no more than one. So answers are
not multiplied. With k_v = P_v(fits) (ln (n + 1) − H(p_v)), what a view knows of an object, H the entropy of its answer,
the view that knows most answers, together with those who answer something else, in a pool whose weights add up to 1 (a
logarithmic opinion pool; Genest and Zidek 1986, doi:10.1214/ss/1177013825):

    ln p = Σ w_v ln p_v + const,   w_v ∝ k_v⁴

Where one view knows and the other does not, it is the one's answer; where both know the same, it is as sure as the
surer one; where they know different things, neither is sure. What another view says is taken with the probability m
that its box is the same object: p_v = m p + (1 − m)/(n + 1).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_LEAST = 1e-6
"""Least probability of anything."""
_KEPT_S = 8.0
"""What another view told of a track counts e times less so long after it was seen there last, seconds."""


def founded(p: FloatArray) -> FloatArray:
    """(m,) nats that answers (m, n + 1) tell beyond none: ln (n + 1) − H."""
    return np.asarray(np.log(p.shape[1]) + np.sum(p * np.log(np.maximum(p, _LEAST)), axis=1))


def pooled(answers: Sequence[FloatArray], fits: Sequence[FloatArray]) -> FloatArray:
    """(m, n + 1) answers of several views on the same m objects, pooled.

    Args:
        answers: (m, n + 1) each; rows add up to 1.
        fits: (m,) each: how far it is to be trusted, 0 to 1.
    """
    known = np.array([fit * np.maximum(founded(p), 0.0) for p, fit in zip(answers, fits, strict=True)])
    best, says = np.argmax(known, axis=0), np.array([np.argmax(p, axis=1) for p in answers])
    rows = np.arange(known.shape[1])
    counts = says != says[best, rows]
    counts[best, rows] = True
    weight = np.where(counts, known, 0.0) ** 4
    total = np.sum(weight, axis=0)
    weight = np.where(total > _LEAST, weight / np.maximum(total, _LEAST), np.eye(len(answers), 1))
    log_p = sum(w[:, None] * np.log(np.maximum(p, _LEAST)) for w, p in zip(weight, answers, strict=True))
    p = np.exp(log_p - np.max(log_p, axis=1, keepdims=True))
    # to the last digit: names are given from a threshold on, at which answers are held
    return np.where(weight[0][:, None] == 1.0, answers[0], p / np.sum(p, axis=1, keepdims=True))


def without_taken(before: FloatArray, after: FloatArray) -> FloatArray:
    """(m, n + 1) answers once what each learnt from elsewhere counts for the others: two boxes are two vehicles.

        p_ij ← p_ij Π_k≠i (1 − p'_kj) / (1 − p_kj),   where p'_kj > p_kj is the likeliest of k

    Args:
        before: (m, n + 1) by the view alone, in which two boxes are two vehicles already.
        after: (m, n + 1) each row with what is known elsewhere.
    """
    left = np.minimum((1.0 - after) / np.maximum(1.0 - before, _LEAST), 1.0)
    learnt = after >= np.max(after, axis=1, keepdims=True)
    learnt[:, -1] = False
    log_left = np.where(learnt, np.log(np.maximum(left, _LEAST)), 0.0)
    others = np.sum(log_left, axis=0) - log_left
    p = after * np.exp(others)
    p /= np.maximum(np.sum(p, axis=1, keepdims=True), _LEAST)
    return np.where(np.any(others < 0.0, axis=1, keepdims=True), p, after)


def mixed(p: FloatArray, same: FloatArray) -> FloatArray:
    """(m, n + 1) what a view says of the m tracks of another one.

    Args:
        p: (k, n + 1) of its own k tracks.
        same: (m, k) probability of each to be the same object.
    """
    unknown = np.maximum(1.0 - np.sum(same, axis=1, keepdims=True), 0.0)
    said = same @ p + unknown / p.shape[1]
    return np.asarray(said / np.sum(said, axis=1, keepdims=True))


class Hearsay:
    """What another view said of the tracks of this one, for as long as it counts."""

    def __init__(self) -> None:
        self._said: dict[int, tuple[float, FloatArray, float]] = {}
        """When, seconds; (n + 1,) what; how far it was to be trusted."""

    def update(
        self, t: float, track_id: IntArray, said: FloatArray, trust: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """(m, n + 1) what counts now, and (m,) how much; what was said before counts where nothing is now.

        Args:
            t: Time, seconds.
            track_id: (m,) tracks.
            said: (m, n + 1) what is said now.
            trust: (m,) how far it is to be trusted, 0 nothing.
        """
        self._said = {key: kept for key, kept in self._said.items() if 0.0 <= t - kept[0] < 3.0 * _KEPT_S}
        said, trust = said.copy(), trust.copy()
        for row, key in enumerate(track_id.tolist()):
            if key in self._said:
                at, before, trusted = self._said[key]
                left = trusted * float(np.exp(-(t - at) / _KEPT_S))
                if len(before) == said.shape[1] and left > trust[row]:
                    said[row], trust[row] = before, left
                    continue
            if trust[row] > 0.0:
                self._said[key] = t, said[row].copy(), float(trust[row])
        return said, trust
