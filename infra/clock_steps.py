"""Places where a clock begins again or was set, by the times that it gave in the order in which they were written.

A single time that is late or damaged is no such place: what comes after has to agree with it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Ints = NDArray[np.int64]

_NEXT = 8
"""Times on either side that have to agree about a restart."""
_MAX_STEPS = 1000
_DAMAGED = 2
"""Offsets that may be damaged among those of a level."""
_JITTER, _UNEVEN = 10_000, 10.0
"""Difference from the usual step, µs, within which a step is usual, and how many times the usual difference it may
be."""
_LEAD_IN, _AGREED = 3, 0.3
"""Usual steps on either side of one that goes back, and share to which all that follows does: else rows are late."""


def restarts(times: Ints, least: int, agree: int = _NEXT) -> list[int]:
    """Places from which times (n,) begin again, by ``least`` or more: all of the next are less than all of the last."""
    return [
        i
        for i in (np.flatnonzero(np.diff(times) <= -least) + 1).tolist()
        if times[max(0, i - agree) : i].min() > times[i : i + agree].max()
    ]


def level_steps(offsets: Ints, least: int, around: int, *, late: bool = False) -> list[tuple[int, int]]:
    """Places where the difference of two clocks (n,) moves by more than ``least`` and stays, and by how much.

    Args:
        offsets: one clock less the other.
        around: how many samples on either side make a level: lateness is over by then.
        late: offsets are of arrivals, which come late and never early.
    """
    steps: list[tuple[int, int]] = []
    level = _earliest if late else np.median
    start = 0
    jumps = np.abs(np.diff(offsets))
    at = np.flatnonzero(jumps > least)
    if len(at) > _MAX_STEPS:  # single samples that are late jump too: a clock that was set is among the largest
        at = np.sort(at[np.argpartition(jumps[at], -_MAX_STEPS)[-_MAX_STEPS:]])
    for i in (at + 1).tolist():
        before, after = offsets[max(start, i - around) : i], offsets[i : i + around]
        if min(len(before), len(after)) < min(_NEXT, around):
            continue
        by = int(level(after)) - int(level(before))
        if abs(by) > least and abs(int(offsets[i]) - int(level(after))) < least:
            steps.append((i, by))
            start = i
    return steps


def _earliest(offsets: Ints) -> int:
    """The least of offsets but two, which may be damaged."""
    return int(np.partition(offsets, _DAMAGED)[_DAMAGED])


def set_back(times: Ints) -> list[int]:
    """Rows from which times (n,) in the order of the file are earlier than before, and go on as they did."""
    usual, even = usual_steps(times)
    steps = np.diff(times)
    # of a clock that goes on as it did this is level on either side
    level, found = times - np.rint(usual * np.arange(len(times))).astype(np.int64), []
    for row in np.flatnonzero((steps < 0) & ~even).tolist():
        if not (even[max(0, row - _LEAD_IN) : row].all() and even[row + 1 : row + 1 + _LEAD_IN].all()):
            continue
        by = float(np.median(level[row + 1 : row + 1 + _NEXT]) - np.median(level[max(0, row + 1 - _NEXT) : row + 1]))
        if abs(by - (steps[row] - usual)) < _AGREED * abs(steps[row] - usual):
            found.append(row + 1)
    return found


def usual_steps(times: Ints) -> tuple[float, NDArray[np.bool_]]:
    """The usual step of times (n,), µs, 0 without any, and which steps (n − 1,) are like it."""
    steps = np.diff(times)
    usual = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
    off = np.abs(steps - usual)
    return usual, np.asarray(off <= max(_JITTER, _UNEVEN * float(np.median(off)) if len(steps) else 0.0))
