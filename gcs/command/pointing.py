"""Whether the camera is seen to do what was ordered, by what its gimbal reports."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

__all__ = ["PointingMonitor", "Verdict"]

Verdict = Literal["not yet", "done", "not moved", "unknown"]

THERE_RAD = math.radians(15.0)
"""So near to its goal the camera has it in view: most see 30° to either side, and gimbals lag behind."""
PROGRESS_RAD = math.radians(2.0)
"""A gimbal that turns at all turns so far within the patience."""


@dataclass(slots=True)
class PointingMonitor:
    """Watches the angle between where the camera looks and where it should.

    Attributes:
        off_rad: the last angle known, NaN while none was.
    """

    patience_s: float
    """Without progress for so long it does not move."""
    since_s: float
    """When the order was given, then when there was progress last."""
    off_rad: float = math.nan
    _best_rad: float = math.inf

    def update(self, off_rad: float, now_s: float) -> Verdict:
        """What is known now.

        Args:
            off_rad: between the optical axis and the goal, NaN unknown.
            now_s: monotonic seconds.
        """
        if math.isfinite(off_rad):
            self.off_rad = off_rad
            if off_rad <= THERE_RAD:
                return "done"
            if off_rad < self._best_rad - PROGRESS_RAD:
                self._best_rad, self.since_s = off_rad, now_s
        if now_s - self.since_s < self.patience_s:
            return "not yet"
        return "unknown" if math.isnan(self.off_rad) else "not moved"
