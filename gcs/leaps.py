"""One time line for a log of which nobody wrote down that its clock was set.

A vehicle's boot clock that goes on while the stamps leap tells by how much they do. What no boot clock explains, other
flights in the same file or a pause of hours, is closed up to a second: nobody waits for it in a replay.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gcs.clocksteps import Steps
from mavlink.tlog import Tlog
from mavlink.tlog_clocks import sender_clocks

__all__ = ["close_leaps", "steps_of"]

Ints = NDArray[np.int64]

_STEP_US = 2_000_000
_LEAP_US = 1_800_000_000
_CLOSED_US = 1_000_000


def steps_of(log: Tlog) -> Steps:
    """When the clock that stamped a log was set, by the sender that noticed most."""
    t_us = log.index.t_us
    if len(t_us) < 2 or np.abs(np.diff(t_us)).max() < _STEP_US:
        return Steps.none()
    steps = max((clock.steps for clock in sender_clocks(log)), key=len, default=())
    return Steps(
        record=np.array([step.row for step in steps], dtype=np.int64),
        t_us=np.array([t_us[step.row] for step in steps], dtype=np.int64),
        step_us=np.array([round(step.by_s * 1e6) for step in steps], dtype=np.int64),
    )


def close_leaps(t_us: Ints) -> tuple[Ints, int]:
    """(n,) times without leaps of half an hour and more, forwards or backwards, and how many those were."""
    moved = np.diff(t_us, prepend=t_us[:1])
    far = np.abs(moved) > _LEAP_US
    return t_us - np.cumsum(np.where(far, moved - _CLOSED_US, 0)), int(np.count_nonzero(far))
