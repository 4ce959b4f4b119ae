"""How a recording is doing, for a screen and for alarms."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["RecordState"]


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordState:
    """How a recording is doing."""

    name: str
    """Of the segment being written."""
    rows: int = 0
    """Accepted so far."""
    bytes: int = 0
    """Written so far, over all segments."""
    failing_s: float = 0.0
    """For how long writing has failed; 0: it is writing."""
    reason: str = ""
    """Why it fails or last failed, in the system's words."""
    faults: int = 0
    """How often it began to fail, repaired since or not."""
    waiting: int = 0
    """Rows in memory that wait for the disk."""
    waiting_bytes: int = 0
    lost: int = 0
    """Rows given up because too many waited."""
    sync_age_s: float = 0.0
    """Age of the oldest row that is perhaps not on the disk; 0: all are."""
