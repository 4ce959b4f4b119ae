"""Places where a clock begins again or was set, by the times that it gave in the order in which they were written.

A single time that is late or damaged is no such place: what comes after has to agree with it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Ints = NDArray[np.int64]

_NEXT = 8
"""Times on either side that have to agree about a restart."""
_MOST_STEPS = 1000


def restarts(times: Ints, least: int, agree: int = _NEXT) -> list[int]:
    """Places from which times (n,) begin again, by ``least`` or more: all of the next are less than all of the last.

    Args:
        times: in the order in which they were written.
        agree: how many times on either side have to.
    """
    return [
        i
        for i in (np.flatnonzero(np.diff(times) <= -least) + 1).tolist()
        if times[max(0, i - agree) : i].min() > times[i : i + agree].max()
    ]


def level_steps(offsets: Ints, least: int, around: int) -> list[tuple[int, int]]:
    """Places where the difference of two clocks (n,) moves by more than ``least`` and stays, and by how much.

    Args:
        offsets: one clock less the other.
        around: how many samples on either side make a level: lateness is over by then.
    """
    steps: list[tuple[int, int]] = []
    start = 0
    for i in (np.flatnonzero(np.abs(np.diff(offsets)) > least) + 1)[:_MOST_STEPS].tolist():
        before, after = offsets[max(start, i - around) : i], offsets[i : i + around]
        if min(len(before), len(after)) < min(_NEXT, around):
            continue
        by = int(np.median(after)) - int(np.median(before))
        if abs(by) > least and abs(int(offsets[i]) - int(np.median(after))) < least:
            steps.append((i, by))
            start = i
    return steps
