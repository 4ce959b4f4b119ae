"""The certainty of a name, in the one wording that screens, overlays, events and tables share.

The number is the confidence that decides about the name: the identifier's probability, after all doubts.
"""

from __future__ import annotations

import math
from typing import Final

CONFIRMED: Final = 0.9
"""Confidence from which a name counts as confirmed; below, it is tentative."""
_MAX_PERCENT: Final = 99
"""Highest percentage that is shown: no evidence is ever certain."""
_ROUNDING: Final = 1e-9
"""0.29 in binary is a little less than 29 hundredths."""


def certainty(confidence: float) -> str:
    """A probability 0..1 as ``97%``: rounded down, at most 99 %; empty for NaN.

    Example:
        >>> certainty(0.9), certainty(0.8999), certainty(1.0)
        ('90%', '89%', '99%')
    """
    if not math.isfinite(confidence):
        return ""
    return f"{min(math.floor(100 * confidence + _ROUNDING), _MAX_PERCENT)}%"


def named(standing: str, confidence: float, *, stated: bool = False) -> str:
    """The state and certainty of a name: ``confirmed 97%``; ``stated`` where the operator stated it.

    Example:
        >>> named("tentative", 0.61), named("out of view", float("nan")), named("confirmed", 0.99, stated=True)
        ('tentative 61%', 'out of view', 'stated')
    """
    if stated and standing in ("confirmed", "tentative"):
        return "stated"
    return f"{standing} {certainty(confidence)}".rstrip()
