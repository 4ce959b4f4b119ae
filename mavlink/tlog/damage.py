"""Which bytes of a telemetry log are damaged, and how."""

from __future__ import annotations

import string
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mavlink.protocol.dialect import DEFINITIONS, message_name
from mavlink.protocol.packet import MAGIC_V1, MAGIC_V2
from mavlink.tlog.scan import Bytes, Frames

__all__ = ["Damage", "describe_gaps", "describe_times"]

_TEXT = frozenset(string.printable.encode())
_SAMPLE = 4095  # bytes of a gap that are looked at to name it; whole stamps with a byte each


@dataclass(frozen=True, slots=True)
class Damage:
    """A range of bytes that holds no record, or no usable time."""

    start: int
    """First byte."""
    stop: int
    """One after the last byte."""
    reason: str


def _frame_reason(head: bytes, room: int) -> str:
    """What is wrong with what looks like a frame; empty when it does not look like one."""
    v2 = head[:1] == bytes([MAGIC_V2])
    if len(head) < 10 or (not v2 and head[0] != MAGIC_V1):
        return ""
    message_id = int.from_bytes(head[7:10], "little") if v2 else head[5]
    definition = DEFINITIONS.get(message_id)
    if (v2 and head[2] > 1) or definition is None:
        return "header damaged"
    if head[1] > definition[0]:
        return f"length of {message_name(message_id)} damaged"
    length = head[1] + (12 + 13 * head[2] if v2 else 8)
    return f"{message_name(message_id)} {'cut off' if length > room else 'with a wrong checksum'}"


def _reason(gap: bytes, room: int, step: int, last: bool) -> str:
    """One line on the bytes of a gap that is ``room`` bytes long, from its start on."""
    if not any(gap):
        return "zeros"
    reason = _frame_reason(gap[step : step + 10], room - step)
    if reason:
        return reason
    if last and room < step + 10:
        return "record cut off"
    if step and len(gap) % (step + 1) == 0 and all(byte in _TEXT for byte in gap[step :: step + 1]):
        return "text, each byte with a time stamp"
    if all(byte in _TEXT for byte in gap):
        return "text"
    return "no MAVLink frame"


def describe_gaps(data: Bytes, frames: Frames, there: NDArray[np.bool_], step: int) -> list[Damage]:
    """The byte ranges between records.

    Args:
        data: (size,) the file.
        frames: (N,) its frames, not overlapping.
        there: (N,) whether the eight bytes before a frame are its own time.
        step: bytes of time before each frame, 8 or 0.

    Returns:
        One entry per range, in order.
    """
    start = np.concatenate([[0], frames.end])
    stop = np.concatenate([frames.offset - step * there, [data.size]])
    damage = []
    for i in np.flatnonzero(stop > start):
        a, b = int(start[i]), int(stop[i])
        if i < there.size and step and not there[i]:
            reason = "time torn"
        else:
            reason = _reason(data[a : min(b, a + _SAMPLE)].tobytes(), b - a, step, last=i == there.size)
        damage.append(Damage(a, b, reason))
    return damage


def describe_times(frames: Frames, bad: NDArray[np.bool_], width: int) -> list[Damage]:
    """Stamps, ``width`` bytes before their frame, whose time cannot be right."""
    return [Damage(offset - width, offset, "impossible time") for offset in frames.offset[bad].tolist()]
