"""Pairs of boxes and the tracks that they continue: costs and one-to-one assignment. Pure functions."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

Floats = NDArray[np.float64]
Indices = NDArray[np.intp]


class Pairs(NamedTuple):
    """p tracks and boxes that may belong together."""

    row: Indices
    """(p,) of the track."""
    column: Indices
    """(p,) of the box."""
    cost: Floats
    """(p,)"""

    def where(self, mask: NDArray[np.bool_]) -> Pairs:
        """Return the pairs of a mask (p,)."""
        return Pairs(self.row[mask], self.column[mask], self.cost[mask])

    def undisputed(self, limit: float) -> bool:
        """Tell whether all cost less than ``limit`` and no two share a track or a box, so that all are taken."""
        if not len(self.row):
            return True
        # sets of a few numbers are quicker than any array of them
        alone = len(set(self.row.tolist())) == len(self.row) == len(set(self.column.tolist()))
        return alone and bool(self.cost.max() < limit)

    def disputed(self, limit: float) -> NDArray[np.bool_]:
        """(p,) those that share a track or a box with another or cost ``limit`` or more."""
        shared = (np.bincount(self.row)[self.row] > 1) | (np.bincount(self.column)[self.column] > 1)
        return shared | (self.cost >= limit)


def assign(rows: Indices, columns: Indices, cost: Floats, limit: float) -> tuple[Indices, Indices]:
    """Cheapest one-to-one assignment among candidate pairs, where leaving a pair unmatched costs ``limit``.

    Candidates that share neither row nor column are taken at once; only the rest goes through the linear assignment.

    Args:
        rows: (p,) row of each candidate.
        columns: (p,) column of each candidate.
        cost: (p,) its cost.
        limit: a candidate that costs as much or more is never taken.

    Returns:
        Matched rows and columns, (q,) each.
    """
    worth = cost < limit
    if not worth.all():
        rows, columns, cost = rows[worth], columns[worth], cost[worth]
    if not len(rows):
        return rows, columns
    alone = (np.bincount(rows)[rows] == 1) & (np.bincount(columns)[columns] == 1)
    if alone.all():
        return rows, columns
    contested = ~alone
    r, row = _numbered(rows[contested])
    c, column = _numbered(columns[contested])
    table = np.full((len(r), len(c)), limit)
    table[row, column] = cost[contested]
    i, j = linear_sum_assignment(table)
    taken = table[i, j] < limit
    return np.concatenate([rows[alone], r[i[taken]]]), np.concatenate([columns[alone], c[j[taken]]])


def _numbered(values: Indices) -> tuple[Indices, Indices]:
    """The values that occur, in order, and the place of each among them."""
    occurs = np.bincount(values) > 0
    return np.flatnonzero(occurs), (np.cumsum(occurs) - 1)[values]


def one_to_one(pairs: Indices, rows: int, columns: int) -> Indices:
    """Pairs (p, 2) within range whose row and column no earlier pair has."""
    pairs = pairs[(pairs >= 0).all(axis=1) & (pairs[:, 0] < rows) & (pairs[:, 1] < columns)]
    for column in (0, 1):
        pairs = pairs[np.sort(np.unique(pairs[:, column], return_index=True)[1])]
    return pairs
