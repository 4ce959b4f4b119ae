"""The one rule for numbers in tables and texts from other programs: ASCII digits with a point and an exponent.

Python's ``float`` also takes ``1_0``, ``٣``, ``nan`` and ``infinity``, which in a file are words or damage.
"""

from __future__ import annotations

import math

_LONGEST, _MAX_SHOWN = 40, 60


def number(text: str) -> float:
    """A finite number as tables have it, spaces around it left out.

    Example:
        >>> number(" -1.5e3")
        -1500.0

    Raises:
        ValueError: it is none.
    """
    value = number_or_nan(text)
    if math.isnan(value):
        raise ValueError(f"{text[:_MAX_SHOWN]!r} is no number")
    return value


def number_or_nan(text: str) -> float:
    """A finite number as tables have it, NaN where it is none."""
    # of ASCII ``float`` takes digits, words for what is not finite, and underscores
    if len(text) >= _LONGEST or not text.isascii() or "_" in text:
        return math.nan
    try:
        value = float(text)
    except ValueError:
        return math.nan
    return value if math.isfinite(value) else math.nan
