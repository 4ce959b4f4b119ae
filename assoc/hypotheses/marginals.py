"""Assignments of tracks to vehicles, in which either may stay unassigned, and their marginals.

A score L (m × n, natural log) is how much likelier a track *is* a vehicle than that the two are unrelated; leaving
a track or a vehicle alone scores 0.

A large problem is taken apart: pairs that no good assignment contains separate it into small ones.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
_ROUNDS = 40
"""Most rounds of belief propagation; a few are the rule."""
_CONVERGED = 1e-5
"""Change of a message at which it has converged."""
_EXACT_SIZE = 10
"""Largest smaller side of a part that is summed exactly: 2¹⁰ states."""
_NEGLIGIBLE = 12.0
"""Pairs that cost this much against the best assignment, nats, are not weighed."""
BoolArray = NDArray[np.bool_]


def least_losses(score: FloatArray, best: IntArray) -> FloatArray:
    """Least loss, nats, of the assignments that contain a pair, against the best assignment of all.

    A row that takes another's column drives that row out, to a free column, to none or on to the next row's. With
    w_ik = a_i,σ(k) − a_i,σ(i) and D its longest paths,  loss_i,σ(k) = −(w_ik + max(D_ki, R_k + C_i)), where
    R_k = max_l (D_kl + exit_l) is the driven-out row's best end and C_i what others gain by i's old column.

    Args:
        score: (m, n) log ratios, finite.
        best: (m,) column of each row in a best assignment, −1 none.

    Returns:
        (m, n) nats, ≥ 0 up to rounding; 0 for pairs of the best assignment.
    """
    m, n = score.shape
    rows, taken = np.arange(m), np.flatnonzero(best >= 0)
    base = np.where(best >= 0, score[rows, best], 0.0)
    free = np.setdiff1d(np.arange(n), best[taken])
    leaving = np.max(score[:, free], axis=1, initial=0.0) - base
    D = np.full((m, m), -np.inf)
    D[:, taken] = score[:, best[taken]] - base[:, None]
    D[rows, rows] = 0.0
    w = D.copy()
    for k in taken:
        np.maximum(D, D[:, k, None] + D[None, k], out=D)
    ends = np.max(D + leaving[None, :], axis=1)
    vacancy = np.maximum(np.max(D, axis=0), 0.0)
    loss = np.empty((m, n))
    loss[:, free] = base[:, None] - score[:, free] - vacancy[:, None]
    loss[:, best[taken]] = -(w[:, taken] + np.maximum(D.T[:, taken], ends[None, taken] + vacancy[:, None]))
    loss[taken, best[taken]] = 0.0
    return loss


def separate(plausible: BoolArray) -> list[tuple[IntArray, IntArray]]:
    """Rows and columns of each connected part of a bipartite graph (m, n) that has at least one edge."""
    m, n = plausible.shape
    i, j = np.nonzero(plausible)
    graph = coo_array((np.ones(len(i)), (i, m + j)), shape=(m + n, m + n))
    _, part = connected_components(graph, directed=False)
    wanted = np.unique(part[i])
    return [(np.flatnonzero(part[:m] == k), np.flatnonzero(part[m:] == k)) for k in wanted]


def best_assignment(score: FloatArray) -> IntArray:
    """Assignment of the largest total score; pairs that do not beat "unrelated" stay apart.

    Args:
        score: (m, n) log ratios; −inf forbids.

    Returns:
        (m,) vehicle of each track, −1 none.
    """
    gain = np.maximum(score, 0.0)
    answer = np.full(len(score), -1, np.int64)
    if gain.size:
        rows, columns = linear_sum_assignment(gain, maximize=True)
        worth = gain[rows, columns] > 0.0
        answer[rows[worth]] = columns[worth]
    return answer


def _log_sum_others(a: FloatArray, axis: int) -> FloatArray:
    """ln Σ_{k≠j} exp a_k along an axis, without cancellation where one term is everything."""
    top = np.expand_dims(np.argmax(a, axis=axis), axis)
    peak = np.take_along_axis(a, top, axis)
    share = np.exp(a - peak)
    np.put_along_axis(share, top, 0.0, axis)
    rest = np.sum(share, axis=axis, keepdims=True)
    # not the largest: peak + ln(1 + rest − share); the largest: peak + ln rest, with its own smaller peak
    others = peak + np.log(1.0 + np.maximum(rest - share, 0.0))
    second = a.copy()
    np.put_along_axis(second, top, -np.inf, axis)
    peak2 = np.maximum(np.max(second, axis=axis, keepdims=True), -1e300)
    tail = peak2 + np.log(np.maximum(np.sum(np.exp(second - peak2), axis=axis, keepdims=True), 1e-300))
    np.put_along_axis(others, top, tail, axis)
    return np.asarray(others)


def marginals(score: FloatArray) -> FloatArray:
    """Probabilities of each pairing over all one-to-one assignments.

    Pairs that only assignments far worse than the best contain are left out, which takes the problem apart; a part
    whose smaller side has at most ten members is summed exactly, a larger one by belief propagation.

    Args:
        score: (m, n) log ratios against "unrelated"; −inf forbids.

    Returns:
        (m, n + 1); the last column is "none of ours", rows sum to 1.
    """
    m, n = score.shape
    p = np.zeros((m, n + 1))
    a = np.maximum(score, -1e4)
    for rows, columns in separate(least_losses(a, best_assignment(a)) < _NEGLIGIBLE) if score.size else ():
        part = a[np.ix_(rows, columns)]
        if part.size == 1:
            p[rows[0], columns[0]] = 1.0 / (1.0 + np.exp(-part[0, 0]))
        else:
            exact = min(part.shape) <= _EXACT_SIZE
            found = exact_marginals(part) if exact else loopy_marginals(part)[0]
            p[np.ix_(rows, columns)] = found[:, :-1]
    p[:, n] = np.maximum(1.0 - np.sum(p, axis=1), 0.0)
    return p


def exact_marginals(score: FloatArray) -> FloatArray:
    """Compute marginals by summing over all assignments: forward and backward over rows, states are sets of taken
    columns.

    With f_i(S) the weight of all ways in which the first i rows take exactly the set S and g_i(S) that of the rows
    from i on given S,  p_ij ∝ Σ_{S ∌ j} f_i(S) ψ_ij g_{i+1}(S ∪ j).  Logs throughout; costs m·n·2ⁿ.
    """
    if score.shape[1] > score.shape[0]:
        p = exact_marginals(score.T)[:, :-1].T
        return np.concatenate([p, np.maximum(1.0 - np.sum(p, axis=1, keepdims=True), 0.0)], axis=1)
    m, n = score.shape
    a = np.maximum(score, -1e4)
    states = np.arange(2**n)
    without = [states[(states >> j) & 1 == 0] for j in range(n)]
    forward, backward = np.full((m + 1, 2**n), -np.inf), np.zeros((m + 1, 2**n))
    forward[0, 0] = 0.0
    for i in range(m):
        forward[i + 1] = forward[i]
        for j, free in enumerate(without):
            taken = free | (1 << j)
            forward[i + 1, taken] = np.logaddexp(forward[i + 1, taken], forward[i, free] + a[i, j])
    for i in reversed(range(m)):
        backward[i] = backward[i + 1]
        for j, free in enumerate(without):
            backward[i, free] = np.logaddexp(backward[i, free], backward[i + 1, free | (1 << j)] + a[i, j])
    log_p = np.empty((m, n + 1))
    for i in range(m):
        for j, free in enumerate(without):
            log_p[i, j] = np.logaddexp.reduce(forward[i, free] + a[i, j] + backward[i + 1, free | (1 << j)])
        log_p[i, n] = np.logaddexp.reduce(forward[i] + backward[i + 1])
    p = np.exp(log_p - np.max(log_p, axis=1, keepdims=True))
    return np.asarray(p / np.sum(p, axis=1, keepdims=True))


def loopy_marginals(score: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Approximate marginals by loopy belief propagation: exact without loops, overconfident with short ones.

    Reference: Williams and Lau, "Approximate evaluation of marginal association probabilities with belief
    propagation", IEEE TAES 50(4), 2014.

    Args:
        score: (..., m, n) log ratios against "unrelated"; −inf forbids.

    Returns:
        (..., m, n + 1); the last column is "none of ours". (...) ln of the sum over all assignments, Bethe's.
    """
    *many, m, n = score.shape
    if m == 0 or n == 0:
        return np.concatenate([np.zeros((*many, m, n)), np.ones((*many, m, 1))], axis=-1), np.zeros(many)
    a = np.maximum(score, -1e4)
    down = np.zeros_like(a)
    for _ in range(_ROUNDS):
        # μ_ij = ψ_ij / (1 + Σ_{k≠j} ψ_ik ν_ik);  ν_ij = 1 / (1 + Σ_{l≠i} μ_lj)
        up = a - np.logaddexp(0.0, _log_sum_others(a + down, axis=-1))
        after = -np.logaddexp(0.0, _log_sum_others(up, axis=-2))
        change = float(np.max(np.abs(np.exp(after) - np.exp(down))))
        down = after
        if change < _CONVERGED:
            break
    b = np.concatenate([a + down, np.zeros((*many, m, 1))], axis=-1)
    # ln Z = Σ_i ln (1 + Σ_j ψ_ij ν_ij) + Σ_j ln (1 + Σ_i μ_ij) − Σ_ij ln (1 + ν_ij μ_ij)
    rows = np.sum(np.logaddexp.reduce(b, axis=-1), axis=-1)
    columns = np.sum(np.logaddexp(0.0, np.logaddexp.reduce(up, axis=-2)), axis=-1)
    total = rows + columns - np.sum(np.logaddexp(0.0, up + down), axis=(-2, -1))
    b = np.exp(b - np.max(b, axis=-1, keepdims=True))
    return np.asarray(b / np.sum(b, axis=-1, keepdims=True)), np.asarray(total)
