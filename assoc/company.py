"""Who was seen beside whom: a track that was nobody while a vehicle was surely another's is hardly that one later."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

__all__ = ["Company"]

IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]


class Company:
    """Remembers, for tracks that surely were nobody, the vehicles that surely were in the picture elsewhere."""

    def __init__(self) -> None:
        self._beside: dict[int, frozenset[int]] = {}

    def forget(self, columns: Iterable[int]) -> None:
        """Tracks that began anew, or that may be somebody else by now."""
        for column in columns:
            self._beside.pop(column, None)

    def note(self, nobody: IntArray, named: IntArray, vehicles: IntArray) -> None:
        """Take in what is sure now.

        Args:
            nobody: Columns of tracks that surely are none of ours.
            named: Columns of those that surely are one of ours.
            vehicles: Which of ours are surely seen.
        """
        self.forget(named.tolist())
        seen = frozenset(vehicles.tolist())
        for column in nobody.tolist():
            self._beside[column] = self._beside.get(column, frozenset()) | seen

    def of(self, columns: IntArray, n_vehicles: int) -> BoolArray:
        """(m, n) vehicles beside which each track was nobody."""
        beside = np.zeros((len(columns), n_vehicles), np.bool_)
        for row, column in enumerate(columns.tolist()):
            beside[row, list(self._beside.get(column, ()))] = True
        return beside
