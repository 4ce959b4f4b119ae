"""How sure every vehicle's name was over a whole recording, in few numbers however long that is."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from gcs.snapshot import Snapshot

__all__ = ["PARTS", "ConfidenceHistory"]

PARTS: Final = 1000
"""Of a recording: several for each cell of the widest screens."""
HELD_US: Final = 2_000_000
"""A name counts for so long without another snapshot, as on the screen."""
NAMED: Final = frozenset({"confirmed", "tentative", "coasting"})


class ConfidenceHistory:
    """Takes snapshots in; those worked out provisionally count for nothing.

    Args:
        start_us: first moment of the recording.
        stop_us: last one.
    """

    def __init__(self, start_us: int, stop_us: int) -> None:
        self._start_us, self._span_us = start_us, max(1, stop_us - start_us)
        self._least: dict[int, NDArray[np.float32]] = {}
        self._last_us: int | None = None
        self._last: dict[int, float] = {}

    def add(self, snapshot: Snapshot) -> None:
        """Take in the next snapshot: until it came, the names of the one before counted."""
        if snapshot.provisional or not snapshot.analysed:
            return
        part = self._part(snapshot.t_us)
        last_us = snapshot.t_us if self._last_us is None else self._last_us
        last, held = self._part(last_us), snapshot.t_us - last_us <= HELD_US
        now = {
            row.system_id: row.confidence if row.standing in NAMED and row.confidence == row.confidence else 0.0
            for row in snapshot.vehicles
            if row.role == "ugv"
        }
        for system_id, confidence in now.items():
            least = self._least.setdefault(system_id, np.full(PARTS, np.nan, dtype=np.float32))
            # the worst of a part counts
            least[last + 1 : part] = self._last.get(system_id, 0.0) if held else 0.0
            least[part] = np.fmin(least[part], confidence)
        self._last, self._last_us = now, snapshot.t_us

    def of(self, system_id: int) -> NDArray[np.float32]:
        """(PARTS,) least confidence in each part of the recording; 0 without a name, NaN where nothing is known yet."""
        known = self._least.get(system_id)
        return np.full(PARTS, np.nan, dtype=np.float32) if known is None else known.copy()

    def _part(self, t_us: int) -> int:
        return min(max((t_us - self._start_us) * PARTS // self._span_us, 0), PARTS - 1)
