"""One time line for a log of which nobody wrote down that its clock was set.

A vehicle's boot clock that goes on while the stamps leap tells by how much they do. What no boot clock explains, a day
and more forwards (another flight in the same file, a clock that was never set before) or half an hour back, is closed
up to a second. A pause of hours stays: somebody may count from the log's first message.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gcs.session.clock_steps import Steps
from mavlink.tlog.clocks import sender_clocks
from mavlink.tlog.log import Tlog

__all__ = ["close_leaps", "steps_of"]

Ints = NDArray[np.int64]

_STEP_US = 2_000_000
_BACK_US, _AHEAD_US = 1_800_000_000, 86_400_000_000
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
    """(n,) times without leaps of half an hour back or a day ahead, and how many those were."""
    moved = np.diff(t_us, prepend=t_us[:1])
    far = (moved < -_BACK_US) | (moved > _AHEAD_US)
    return t_us - np.cumsum(np.where(far, moved - _CLOSED_US, 0)), int(np.count_nonzero(far))
