"""One time line for a recording during which the wall clock was set.

``clock.csv`` says from which record on, and by how much. Times are told by the clock as it first stood, so that
records and pictures keep their order and their distances.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gcs.session.segmented import read_segments
from infra.files.segments import segments

__all__ = ["Steps"]

Ints = NDArray[np.int64]

SEARCH_US = 1_000_000
"""Steps of a second and more are found in the stamps themselves, where record numbers are off because of damage."""
SEARCH_ROWS = 5000
NEAR_US = 5_000_000
MOST_STEPS = 1000
"""Of a clock that was set by somebody; each is looked for in all records."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Steps:
    """When the clock was set, (k,) each."""

    record: Ints
    """Number of the first record stamped afterwards."""
    t_us: Ints
    """Unix µs by the new setting when it was noticed."""
    step_us: Ints
    """By how much, positive forwards."""
    skipped: int = 0
    """Rows of ``clock.csv`` that cannot be used."""

    @classmethod
    def none(cls) -> Steps:
        """Of a clock that nobody touched."""
        empty = np.zeros(0, dtype=np.int64)
        return cls(record=empty, t_us=empty, step_us=empty)

    @classmethod
    def read(cls, path: Path) -> Steps:
        """Read ``clock.csv``; there is none where nobody set the clock.

        Raises:
            SessionError: the file is no such table.
        """
        if not segments(path):
            return cls.none()
        table = read_segments(path, ("record", "t_us", "step_us"))
        names = ("record", "t_us", "step_us")
        columns = {name: table[name][:MOST_STEPS].astype(np.int64) for name in names}
        return cls(**columns, skipped=table.skipped + max(len(table) - MOST_STEPS, 0))

    def __len__(self) -> int:
        return len(self.record)

    def of_records(self, stamped_us: Ints) -> Ints:
        """(n,) stamps of all records on one time line."""
        t_us = stamped_us.copy()
        for record, step_us in zip(self.record.tolist(), self.step_us.tolist(), strict=True):
            t_us[_first_after(stamped_us, record, step_us) :] -= step_us
        return t_us

    def of_pictures(self, stamped_us: Ints, start_us: int) -> Ints:
        """(n,) stamps of pictures on the same time line.

        Args:
            stamped_us: in the order of the pictures.
            start_us: of the telemetry.
        """
        t_us = stamped_us.copy()
        for new_us, step_us in zip(self.t_us.tolist(), self.step_us.tolist(), strict=True):
            old_us = new_us - step_us
            before, after = stamped_us[:-1], stamped_us[1:]
            near = (np.abs(before - old_us) < NEAR_US) & (np.abs(after - new_us) < NEAR_US)
            near &= np.abs(after - before - step_us) < abs(step_us) / 2
            if near.any():
                t_us[int(np.argmax(near)) + 1 :] -= step_us
            elif len(t_us) and (stamped_us[0] >= new_us - NEAR_US if step_us > 0 else stamped_us[0] < start_us):
                t_us -= step_us  # the first picture came after the step
        return t_us


def _first_after(stamped_us: Ints, record: int, step_us: int) -> int:
    """Row of the first record stamped after a step: its number, or the step in the stamps that is nearest to it."""
    if abs(step_us) < SEARCH_US:
        return record
    low = max(record - SEARCH_ROWS, 1)
    moved = np.diff(stamped_us[low - 1 : record + SEARCH_ROWS])
    rows = low + np.flatnonzero(np.abs(moved - step_us) < abs(step_us) / 2)
    return int(rows[np.argmin(np.abs(rows - record))]) if len(rows) else record
