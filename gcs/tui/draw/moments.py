"""Moments that a time line marks, and keys jump between: alarms, the operator's marks, gaps, warnings, names. Pure."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, Literal

import numpy as np

from gcs.snapshot import Event
from gcs.station import Gap

Moment = Literal["identity", "warning", "gap", "mark", "alarm"]
KINDS: Final[tuple[Moment, ...]] = ("identity", "warning", "gap", "mark", "alarm")
"""The last one wins a cell in which there are several."""
SIGNS: Final[dict[Moment, str]] = {"identity": "│", "warning": "╹", "gap": "░", "mark": "▼", "alarm": "!"}

NOT_ANALYSED: Final = "┄"
"""Sign of a part of a recording of which nothing is known yet."""


def kind_of(event: Event) -> Moment | None:
    """Kind of mark for an event; None: it has none."""
    if event.level == "alarm":
        return "alarm"
    if event.kind == "mark":
        return "mark"
    if event.kind == "identity":
        return "identity"
    return "warning" if event.level == "warning" else None


def cells_of(
    events: Sequence[Event], gaps: Sequence[Gap], start_us: int, stop_us: int, length: int
) -> list[Moment | None]:
    """Moment that each cell of a time line marks: the worst of what happened in it.

    Args:
        events: in any order; those outside are passed over.
        gaps: parts without video or telemetry.
        start_us: of the line.
        stop_us: of the line.
        length: cells, above 0.
    """
    worst = np.full(length, -1)
    for gap in gaps:
        first, last = (cell_of(t_us, start_us, stop_us, length) for t_us in (gap.start_us, gap.stop_us))
        worst[first : last + 1] = KINDS.index("gap")
    marked = [(event.t_us, kind) for event in events if (kind := kind_of(event)) and start_us <= event.t_us <= stop_us]
    if marked:
        shares = (np.array([t_us for t_us, _ in marked]) - start_us) / max(1, stop_us - start_us)
        cells = np.rint(shares * (length - 1)).astype(int)
        np.maximum.at(worst, cells, [KINDS.index(kind) for _, kind in marked])
    return [KINDS[rank] if rank >= 0 else None for rank in worst.tolist()]


def cell_of(t_us: int, start_us: int, stop_us: int, length: int) -> int:
    """The cell of a time, the first or last one for times outside."""
    share = (t_us - start_us) / max(1, stop_us - start_us)
    return round(min(max(share, 0.0), 1.0) * (length - 1))


def times_of(kind: Moment, events: Sequence[Event], gaps: Sequence[Gap]) -> list[int]:
    """Times of what there was of a kind, Unix µs: of a gap its begin."""
    if kind == "gap":
        return [gap.start_us for gap in gaps]
    return [event.t_us for event in events if kind_of(event) == kind]
