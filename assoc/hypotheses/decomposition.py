"""An assignment problem taken apart: pairs that no good assignment contains separate it into small ones."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

__all__ = ["least_losses", "separate"]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]


def least_losses(score: FloatArray, best: IntArray) -> FloatArray:
    """How much worse than the best assignment every assignment is that contains a pair, at least.

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
