"""State of a recording, for a screen and for alarms."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordState:
    """State of a recording, for a screen and for alarms."""

    name: str
    """Name of the segment being written."""
    rows: int = 0
    """Number of rows accepted so far."""
    bytes: int = 0
    """Number of bytes written so far, over all segments."""
    failing_s: float = 0.0
    """Time for which writing has failed, s; 0: it is writing."""
    reason: str = ""
    """Reason why it fails or last failed, in the system's words."""
    faults: int = 0
    """Number of times that it began to fail, repaired since or not."""
    failed_ago_s: float = math.inf
    """Time since it last failed, s; inf where it never did."""
    waiting: int = 0
    """Number of rows in memory only, on their way to the disk."""
    waiting_bytes: int = 0
    lost: int = 0
    """Number of rows given up because too many waited."""
    sync_age_s: float = 0.0
    """Age of the oldest row that is perhaps not on the disk; 0: all are."""
    stalled_s: float = 0.0
    """Time for which the disk has not answered to a row that it was given, s; 0: none waits for its answer."""
    clock_step_s: float = 0.0
    """Sum of the steps by which the wall clock was set since the recording began."""

    @property
    def because(self) -> str:
        """The reason as the end of a sentence, empty where there is none."""
        return f": {self.reason}" if self.reason else ""


def overall(states: Iterable[RecordState]) -> RecordState:
    """Sum up the states of several files: the longest failure with its reason, the oldest unsynced row, totals of all
    else.

    Where none fails any more the reason is that of the file that failed last.

    Name and rows are those of the first.
    """
    first, *rest = states
    every = (first, *rest)
    worst = max(every, key=lambda state: state.failing_s)
    reported = worst if worst.failing_s else min(every, key=lambda state: state.failed_ago_s)
    reason = reported.reason if reported is first or not reported.reason else f"{reported.name}: {reported.reason}"
    return RecordState(
        name=first.name,
        rows=first.rows,
        bytes=sum(state.bytes for state in every),
        failing_s=worst.failing_s,
        reason=reason,
        faults=sum(state.faults for state in every),
        failed_ago_s=min(state.failed_ago_s for state in every),
        waiting=sum(state.waiting for state in every),
        waiting_bytes=sum(state.waiting_bytes for state in every),
        lost=sum(state.lost for state in every),
        sync_age_s=max(state.sync_age_s for state in every),
        stalled_s=max(state.stalled_s for state in every),
        clock_step_s=first.clock_step_s,
    )
