"""One thing that was looked at before a flight, what was found, and what to do about it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

__all__ = ["Check", "Verdict"]

Verdict = Literal["ok", "short", "bad"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Check:
    """One thing that was looked at."""

    name: str
    verdict: Verdict
    """``short``: a flight is possible and suffers; ``bad``: something will not work."""
    found: str
    advice: str = ""
