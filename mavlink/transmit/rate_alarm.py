"""When a low message rate is told, and when it is told again."""

from __future__ import annotations

import math

__all__ = ["Trouble"]

LASTS_S = 5.0
"""A rate is low for so long before it is told: a pause of the link is not yet out of what was measured after three."""
CALM_S = 30.0
"""And better for so long before it may be told again: one about the limit is one line, not one every ten seconds."""


class Trouble:
    """What was told of one rate: 1 that it is low, 2 that the message has ceased, 0 nothing."""

    def __init__(self) -> None:
        self._told = 0
        self._low_s = self._better_s = math.inf  # since when it is low, and better than what was told

    def news(self, worse: int, now_s: float) -> bool:
        """Takes how it is now; True when that is to be told."""
        self._low_s = min(self._low_s, now_s) if worse else math.inf
        self._better_s = min(self._better_s, now_s) if worse < self._told else math.inf
        if now_s - self._better_s >= CALM_S:
            self._told = worse
        if worse <= self._told or now_s - self._low_s < LASTS_S:
            return False
        self._told = worse
        return True
