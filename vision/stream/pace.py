"""Time that a stream may be without a frame before it has stalled."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

STALL_S: Final = 1.0
"""Time without a frame after which a stream has stalled, s."""
STALL_INTERVALS: Final = 2.5
"""Number of its usual intervals after which a slow stream has stalled: one frame may be late, or missing."""
MAX_STALL_S: Final = 5.0
PACE_FRAMES: Final = 6
"""Number of frames that tell the pace; one gap among them does not change it."""


def stall_after_s(times_us: Sequence[int] | NDArray[np.int64], least_s: float = STALL_S) -> float:
    """Return the time without a frame after which a stream has stalled.

    Example:
        >>> stall_after_s([0, 40_000, 80_000]), stall_after_s([0, 1_000_000, 2_000_000])
        (1.0, 2.5)
    """
    if len(times_us) < 3:
        return least_s
    usual_s = float(np.median(np.diff(times_us))) * 1e-6
    return max(least_s, min(STALL_INTERVALS * usual_s, MAX_STALL_S))
