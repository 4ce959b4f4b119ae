"""Answers of a view once it has heard the others: of several answers about one object the better founded counts.

All views compare with the same reports, whose errors they share: two that agree prove no more than one. So answers are
not multiplied. m_v is the probability that what view v answers about is the same object, and k_v = m_v P_v(fits)
(ln (n + 1) − H(p_v)) what it knows of it, H the entropy of its answer. The view that knows most answers, together with
those who answer something else, in a pool whose weights add up to 1 (a logarithmic opinion pool; Genest and Zidek 1986,
doi:10.1214/ss/1177013825), as far as it is the same object:

    p = (1 − M) p_own + M Π p_v^w_v / Σ,   w_v ∝ k_v⁴,   M the mean of the others' m_v by their weights

with p_v at least 0.05/(n + 1) where several count.

Where one view knows and the other does not, it is the one's answer; where both know the same, it is as sure as the
surer one; where they know different things, neither is sure.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_TINY = 1e-6
"""Least probability of anything."""
_COUNTS = 0.05
"""Weight against a view's own from which on what others say counts."""
_WRONG = 0.05
"""Probability that a view is wrong about all that it holds for impossible: no view forbids what another one knows."""
_KEPT_S = 8.0
"""Seconds after which another view's word about a track that it sees no more counts e times less."""


def information_of(p: FloatArray) -> FloatArray:
    """Nats that answers (m, n + 1) tell beyond none, (m,): ln (n + 1) − H."""
    return np.asarray(np.log(p.shape[1]) + np.sum(p * np.log(np.maximum(p, _TINY)), axis=1))


def pooled(answers: Sequence[FloatArray], same: Sequence[FloatArray], fits: Sequence[float]) -> FloatArray:
    """(m, n + 1) answers of several views on the same m objects, pooled; the first is the one that is asked.

    Args:
        answers: (m, n + 1) each; rows add up to 1.
        same: (m,) each: probability that it is about the same object.
        fits: Of each, how far it is to be trusted, 0 to 1.
    """
    m, own = np.array(same), answers[0]
    known = m * np.array(fits)[:, None] * np.maximum([information_of(p) for p in answers], 0.0)
    best, says = np.argmax(known, axis=0), np.array([np.argmax(p, axis=1) for p in answers])
    rows = np.arange(len(own))
    counts = says != says[best, rows]
    counts[best, rows] = True
    weight = np.where(counts, known, 0.0) ** 4
    others = np.sum(weight[1:], axis=0)
    # to the last digit as it was where no other view counts: names are given from a threshold on, and held at it
    heard = np.flatnonzero(others > _COUNTS * weight[0])
    if not len(heard):
        return own
    weight = weight[:, heard] / np.sum(weight[:, heard], axis=0)
    # alone, an answer is taken as it is
    least = np.where(np.max(weight, axis=0) < 1.0, _WRONG / own.shape[1], _TINY)[:, None]
    log_p = sum(w[:, None] * np.log(np.maximum(p[heard], least)) for w, p in zip(weight, answers, strict=True))
    pool = np.exp(log_p - np.max(log_p, axis=1, keepdims=True))
    pool /= np.sum(pool, axis=1, keepdims=True)
    M = (np.sum(weight[1:] * m[1:, heard], axis=0) / np.sum(weight[1:], axis=0))[:, None]
    p = own.copy()
    p[heard] = (1.0 - M) * own[heard] + M * pool
    return p


def without_taken(before: FloatArray, after: FloatArray) -> FloatArray:
    """(m, n + 1) answers once what each learnt from elsewhere counts for the others: two boxes are two vehicles.

        p_ij ← p_ij Π_k≠i (1 − p'_kj) / (1 − p_kj),   where p'_kj > p_kj is the likeliest of k

    Args:
        before: (m, n + 1) by the view alone, in which two boxes are two vehicles already.
        after: (m, n + 1) each row with what is known elsewhere.
    """
    left = np.minimum((1.0 - after) / np.maximum(1.0 - before, _TINY), 1.0)
    learnt = after >= np.max(after, axis=1, keepdims=True)
    learnt[:, -1] = False
    log_left = np.where(learnt, np.log(np.maximum(left, _TINY)), 0.0)
    others = np.sum(log_left, axis=0) - log_left
    p = after * np.exp(others)
    p /= np.maximum(np.sum(p, axis=1, keepdims=True), _TINY)
    return np.where(np.any(others < 0.0, axis=1, keepdims=True), p, after)


def answers_for(p: FloatArray, same: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Answers of a view on the m tracks of another one.

    Args:
        p: (k, n + 1) of its own k tracks.
        same: (m, k) probability of each to be the same object.

    Returns:
        (m, n + 1) its answers on the objects that they may be; (m,) probability that each is one of them.
    """
    total = np.sum(same, axis=1)
    even = np.full((len(same), p.shape[1]), 1.0 / p.shape[1])
    said = np.where(total[:, None] > _TINY, same @ p / np.maximum(total, _TINY)[:, None], even)
    return said, np.minimum(total, 1.0)


class Hearsay:
    """Words of another view about the tracks of this one, for as long as it counts."""

    def __init__(self) -> None:
        self._said: dict[int, tuple[float, FloatArray, float]] = {}
        """Opinions: time, seconds; (n + 1,) probabilities; the probability that it was about the same object."""

    def update(self, t: float, track_id: IntArray, said: FloatArray, same: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(m, n + 1) what counts now, and (m,) how far; what was said before counts where less is now.

        Args:
            t: Time, seconds.
            track_id: (m,) tracks.
            said: (m, n + 1) what is said now.
            same: (m,) probability that it is about the same object.
        """
        self._said = {key: kept for key, kept in self._said.items() if 0.0 <= t - kept[0] < 3.0 * _KEPT_S}
        said, same = said.copy(), same.copy()
        for row, key in enumerate(track_id.tolist()):
            if key in self._said:
                at, before, was_same = self._said[key]
                left = was_same * float(np.exp(-(t - at) / _KEPT_S))
                if len(before) == said.shape[1] and left > same[row]:
                    said[row], same[row] = before, left
                    continue
            if same[row] > 0.0:
                self._said[key] = t, said[row].copy(), float(same[row])
        return said, same
