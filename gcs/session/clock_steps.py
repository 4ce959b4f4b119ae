"""One time line for a recording during which the wall clock was set.

``clock.csv`` has the first record afterwards, and by how much. Times are those of the clock as it first stood, so that
records and frames keep their order and their distances.

Without that table steps are inferred from the log: a vehicle's boot clock goes on while the stamps leap, which gives
the step. What no boot clock explains, a day and more forwards (another flight in the same file, a clock that was never
set before) or half an hour back, is closed up to a second. A pause of hours stays: a reader may count from the log's
first message.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gcs.session.tables import read_table
from infra.files.segment import segments
from infra.session_format import CLOCK
from mavlink.tlog.clocks import sender_clocks
from mavlink.tlog.log import Tlog

Ints = NDArray[np.int64]

SEARCH_US = 1_000_000
"""Steps of a second and more are found in the stamps themselves, where record numbers are off because of damage."""
SEARCH_ROWS = 5000
NEAR_US = 5_000_000
MAX_STEPS = 1000
"""Most steps that are followed: each is searched for in all records."""
NOTICED_US = 2_000_000
"""Stamps that leap by less, either way, are no sign that the clock was set."""
FAR_BACK_US, FAR_AHEAD_US = 1_800_000_000, 86_400_000_000
"""Leaps beyond half an hour back and a day ahead are closed up."""
CLOSED_UP_US = 1_000_000
"""Rest of such a leap."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ClockSteps:
    """Times at which the clock was set, (k,) each."""

    record: Ints
    """Number of the first record stamped afterwards."""
    t_us: Ints
    """Unix µs by the new setting when it was noticed."""
    step_us: Ints
    """Steps of the clock, positive forwards."""
    skipped: int = 0
    """Rows of ``clock.csv`` that cannot be used."""

    @classmethod
    def none(cls) -> ClockSteps:
        """Steps of a clock that was not set: none."""
        empty = np.zeros(0, dtype=np.int64)
        return cls(record=empty, t_us=empty, step_us=empty)

    @classmethod
    def read(cls, path: Path) -> ClockSteps:
        """Read ``clock.csv``; there is none where the clock was not set.

        Raises:
            SessionError: the file is no such table.
        """
        if not segments(path):
            return cls.none()
        table = read_table(path, CLOCK, without=("offset_us",))
        columns = {name: column[:MAX_STEPS].astype(np.int64) for name, column in table.columns.items()}
        return cls(**columns, skipped=table.skipped + max(len(table) - MAX_STEPS, 0))

    def __len__(self) -> int:
        return len(self.record)

    def correct_records(self, stamped_us: Ints) -> Ints:
        """(n,) stamps of all records on one time line."""
        t_us = stamped_us.copy()
        for record, step_us in zip(self.record.tolist(), self.step_us.tolist(), strict=True):
            t_us[_first_after(stamped_us, record, step_us) :] -= step_us
        return t_us

    def correct_frames(self, stamped_us: Ints, start_us: int) -> Ints:
        """(n,) stamps of frames on the same time line."""
        t_us = stamped_us.copy()
        for new_us, step_us in zip(self.t_us.tolist(), self.step_us.tolist(), strict=True):
            old_us = new_us - step_us
            before, after = stamped_us[:-1], stamped_us[1:]
            near = (np.abs(before - old_us) < NEAR_US) & (np.abs(after - new_us) < NEAR_US)
            near &= np.abs(after - before - step_us) < abs(step_us) / 2
            if near.any():
                t_us[int(np.argmax(near)) + 1 :] -= step_us
            elif len(t_us) and (stamped_us[0] >= new_us - NEAR_US if step_us > 0 else stamped_us[0] < start_us):
                t_us -= step_us  # the first frame came after the step
        return t_us

    def correct_events(self, stamped_us: Ints, is_step: NDArray[np.bool_]) -> Ints:
        """(n,) stamps of events on the same time line.

        Args:
            stamped_us: in the order in which they were written.
            is_step: (n,) whether an event is that the clock was set.
        """
        t_us, first = stamped_us.copy(), 0
        for new_us, step_us in zip(self.t_us.tolist(), self.step_us.tolist(), strict=True):
            left = stamped_us[first:]
            if step_us > 0:
                after = left > new_us - step_us // 2
            else:
                after = left < np.maximum.accumulate(left) + step_us // 2
                after |= is_step[first:] & (np.abs(left - new_us) < NEAR_US)
            if after.any():
                first += int(np.argmax(after))
                t_us[first:] -= step_us
        return t_us


def infer_steps(log: Tlog) -> ClockSteps:
    """Times at which the clock that stamped a log was set, by the sender that noticed most."""
    t_us = log.index.t_us
    if len(t_us) < 2 or np.abs(np.diff(t_us)).max() < NOTICED_US:
        return ClockSteps.none()
    steps = max((clock.steps for clock in sender_clocks(log)), key=len, default=())
    return ClockSteps(
        record=np.array([step.row for step in steps], dtype=np.int64),
        t_us=np.array([t_us[step.row] for step in steps], dtype=np.int64),
        step_us=np.array([round(step.by_s * 1e6) for step in steps], dtype=np.int64),
    )


def close_leaps(t_us: Ints) -> tuple[Ints, int]:
    """(n,) times without leaps of half an hour back or a day ahead, and how many those were."""
    moved = np.diff(t_us, prepend=t_us[:1])
    far = (moved < -FAR_BACK_US) | (moved > FAR_AHEAD_US)
    return t_us - np.cumsum(np.where(far, moved - CLOSED_UP_US, 0)), int(np.count_nonzero(far))


def _first_after(stamped_us: Ints, record: int, step_us: int) -> int:
    """Row of the first record stamped after a step: its number, or the step in the stamps that is nearest to it."""
    if abs(step_us) < SEARCH_US:
        return record
    low = max(record - SEARCH_ROWS, 1)
    moved = np.diff(stamped_us[low - 1 : record + SEARCH_ROWS])
    rows = low + np.flatnonzero(np.abs(moved - step_us) < abs(step_us) / 2)
    return int(rows[np.argmin(np.abs(rows - record))]) if len(rows) else record
