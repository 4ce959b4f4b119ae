"""Frames embedded in others, in a tunnel or a file transfer, which are found because the outer frame is damaged."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mavlink.protocol.dialect import DEFINITIONS
from mavlink.protocol.framing import SIGNATURE_LENGTH
from mavlink.protocol.packet import MAGIC_V1
from mavlink.tlog.scan import Bytes, Frames
from mavlink.tlog.timestamps import stamped

__all__ = ["embedded"]

_HEADER, _LONGEST = 10, 280


def embedded(data: Bytes, frames: Frames, time_ok: NDArray[np.bool_], step: int) -> NDArray[np.bool_]:
    """(N,) which frames lie in a damaged record and are no records of their own.

    Such a frame has no time of its own, and before it, in the gap that it follows, another record begins that is long
    enough to hold it: where the last record ends, or where a stamp begins.
    """
    inner = np.zeros(time_ok.size, dtype=np.bool_)
    if step == 0 or time_ok.all():
        return inner
    gap = frames.offset - np.concatenate([[0], frames.end[:-1]])
    last, ends, timed = -1, frames.end, np.flatnonzero(time_ok)
    rows = np.flatnonzero(~time_ok & ((gap >= step + _HEADER) | np.append(False, ~time_ok[:-1])))
    for row in rows[~stamped(data, frames.offset[rows], little=True)].tolist():
        if not (row and inner[row - 1]):
            last = row - 1
        first, offset = (int(ends[last]) if last >= 0 else 0) + step, int(frames.offset[row])
        following = int(np.searchsorted(timed, row))
        stop = int(frames.offset[timed[following]]) - step if following < timed.size else data.size
        inner[row] = any(_reach(data, start, stop) >= ends[row] for start in _starts(data, first, offset))
    return inner


def _starts(data: Bytes, first: int, offset: int) -> list[int]:
    """Where a record that holds the frame at ``offset`` may begin; the first place needs no stamp."""
    places = np.arange(max(first, offset - _LONGEST), offset - _HEADER + 1, dtype=np.int64)
    if not places.size:
        return []
    likely = stamped(data, places, little=True) | (places == first)
    return places[likely].tolist()  # type: ignore[no-any-return]


def _reach(data: Bytes, at: int, stop: int) -> int:
    """Where the frame that should begin here ends: by its length, or before the next record if that is possible."""
    head = data[at : at + 10].tobytes()
    if len(head) < 10:
        return 0
    v1 = head[0] == MAGIC_V1  # anything else is read as MAVLink 2: its magic may be what is damaged
    definition = DEFINITIONS.get(head[5] if v1 else int.from_bytes(head[7:10], "little"))
    if definition is None:
        return 0
    around = 8 if v1 else 12
    longest = at + definition[0] + around + SIGNATURE_LENGTH
    claimed = at + head[1] + around if head[1] <= definition[0] else 0
    return stop if stop <= longest else claimed
