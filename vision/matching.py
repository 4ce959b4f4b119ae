"""Which box continues which track: gates, costs, one-to-one assignment. Pure functions."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

__all__ = ["assign", "mahalanobis"]

Floats = NDArray[np.float64]
Indices = NDArray[np.intp]


def mahalanobis(offset: Floats, S: Floats) -> tuple[Floats, Floats]:
    """Squared Mahalanobis distance of offsets (a, b, 2) under covariances S (a, 2, 2), and det S (a,).

    Returns:
        d² (a, b), det (a,).
    """
    xx, xy, yy = S[:, 0, 0], S[:, 0, 1], S[:, 1, 1]
    det = xx * yy - xy**2
    dx, dy = offset[..., 0], offset[..., 1]
    # d² = (Syy dx² − 2 Sxy dx dy + Sxx dy²) / det S
    squared = (yy[:, None] * dx**2 - 2 * xy[:, None] * dx * dy + xx[:, None] * dy**2) / det[:, None]
    return squared, det


def assign(rows: Indices, columns: Indices, cost: Floats, limit: float) -> tuple[Indices, Indices]:
    """Cheapest one-to-one assignment among candidate pairs, where leaving a pair unmatched costs ``limit``.

    Candidates that nobody contests are taken at once; only the rest goes through the linear assignment.

    Args:
        rows: (p,) row of each candidate.
        columns: (p,) column of each candidate.
        cost: (p,) its cost.
        limit: a candidate that costs as much or more is never taken.

    Returns:
        Matched rows and columns, (q,) each.
    """
    worth = cost < limit
    rows, columns, cost = rows[worth], columns[worth], cost[worth]
    if not len(rows):
        return rows, columns
    alone = (np.bincount(rows)[rows] == 1) & (np.bincount(columns)[columns] == 1)
    if alone.all():
        return rows, columns
    r, c = np.unique(rows[~alone]), np.unique(columns[~alone])
    table = np.full((len(r), len(c)), limit)
    table[np.searchsorted(r, rows[~alone]), np.searchsorted(c, columns[~alone])] = cost[~alone]
    i, j = linear_sum_assignment(table)
    taken = table[i, j] < limit
    return np.concatenate([rows[alone], r[i[taken]]]), np.concatenate([columns[alone], c[j[taken]]])
