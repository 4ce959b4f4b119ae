"""Job of an export, which it gets besides snapshots: where to write, and what the recording is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from gcs.snapshot import Snapshot


def _tell_nobody(text: str) -> None:
    pass


def _no_times() -> NDArray[np.int64]:
    return np.zeros(0, dtype=np.int64)


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportJob:
    """One export of one recording."""

    path: Path
    """File or folder to write; it does not exist yet."""
    name: str = ""
    """Name of the recording; plain text."""
    video: Path | None = None
    """Video of the recording; None without one."""
    truth: Path | None = None
    """File ``truth.csv`` of the recording; None unknown."""
    times_us: NDArray[np.int64] = field(default_factory=_no_times)
    """(n,) when each of its frames was taken, Unix µs."""
    min_confidence: float = 0.0
    """Minimum confidence of training labels: frames with less certain boxes are left out."""
    note: Callable[[str], None] = _tell_nobody
    """Takes a line about what was left out."""


class Export(Protocol):
    """An export while it is written."""

    def __init__(self, job: ExportJob) -> None:
        """Open what does not exist yet.

        Raises:
            SessionError: it exists, or cannot be written.
        """

    def write(self, snapshot: Snapshot) -> bool | None:
        """Append one frame; False: it is left out."""

    def close(self) -> None:
        """Finish it."""
