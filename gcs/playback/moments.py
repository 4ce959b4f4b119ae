"""The moments of a recording at which its state is worked out although no frame came."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

TICK_US: Final = 200_000
"""Interval at which a flight shows the fleet while no frame comes."""
QUIET_US: Final = 60_000_000
"""Silence after which every alarm of silence has come, and only ages grow."""
QUIET_SHARE: Final = 0.02
"""Share of a silence after which the next moment comes: ages stay right to 2 %, and years take few moments."""


def moments_between(start_us: int, stop_us: int, received_us: NDArray[np.int64]) -> Iterator[int]:
    """Times after a start and before a stop, five a second, fewer where nothing was received for long.

    Args:
        start_us: A frame came then, or the recording begins.
        stop_us: The next frame came then, or the recording ends.
        received_us: (k,) when anything was received or happened, in order.
    """
    t_us = start_us + TICK_US
    while t_us < stop_us:
        yield t_us
        before = int(np.searchsorted(received_us, t_us, side="right"))
        quiet_us = t_us - int(received_us[before - 1]) if before else 0
        step_us = TICK_US if quiet_us < QUIET_US else max(round(QUIET_SHARE * quiet_us), TICK_US)
        next_us = int(received_us[before]) if before < len(received_us) else stop_us
        t_us = min(t_us + step_us, max(next_us, t_us + TICK_US))


def telemetry_times(t_us: NDArray[np.int64]) -> NDArray[np.int64]:
    """Moments at which to show a log that has no frames: five a second, in pauses for a minute only."""
    t_us = np.unique(t_us)
    ends = np.flatnonzero(np.diff(t_us, append=t_us[-1] + QUIET_US + 1) > QUIET_US)
    starts = np.concatenate([[0], ends[:-1] + 1])
    last_us = np.minimum(t_us[ends] + QUIET_US, t_us[-1])
    return np.concatenate(
        [np.arange(a, b + 1, TICK_US, dtype=np.int64) for a, b in zip(t_us[starts], last_us, strict=True)]
    )
