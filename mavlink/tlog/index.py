"""Index of a telemetry log: which records it holds, when, and which bytes are damaged.

A record is 8 bytes of time (big-endian Unix µs) and a frame. Old files carry little-endian times, ``.raw`` files none.

Frames embedded in others, in a tunnel or a file transfer, are found where the outer frame is damaged, and left out.
"""

from __future__ import annotations

import string
from bisect import bisect
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from mavlink.protocol.dialect import DEFINITIONS, message_name
from mavlink.protocol.framing import SIGNATURE_LENGTH
from mavlink.protocol.packet import MAGIC_V1, MAGIC_V2
from mavlink.tlog.scan import Bytes, Frames, Ints, find_frames, find_unknown, gather
from mavlink.tlog.timestamps import TIME_LENGTH, TimeSource, could_be_time, fill, read_times, stamped, times_ok

_HEADER, _LONGEST = 10, 280
_TEXT = frozenset(string.printable.encode())
_SAMPLE = 4095  # bytes of a gap that are looked at to name it; whole stamps with a byte each


@dataclass(frozen=True, slots=True)
class Damage:
    """A range of bytes that holds no record, or no usable time."""

    start: int
    """Offset of the first byte."""
    stop: int
    """Offset after the last byte."""
    reason: str


def _frame_reason(head: bytes, room: int) -> str:
    """Fault with what looks like a frame; empty when it does not look like one."""
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
    """Offsets at which a record that holds the frame at ``offset`` may begin; the first place needs no stamp."""
    places = np.arange(max(first, offset - _LONGEST), offset - _HEADER + 1, dtype=np.int64)
    if not places.size:
        return []
    likely = stamped(data, places, little=True) | (places == first)
    return places[likely].tolist()  # type: ignore[no-any-return]


def _reach(data: Bytes, at: int, stop: int) -> int:
    """End of the frame that should begin here: by its length, or before the next record if that is possible."""
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


@dataclass(frozen=True, slots=True, kw_only=True)
class TlogCounts:
    """Counts of what a log holds."""

    records: int
    """Frames, good and unknown."""
    unknown: int
    """Frames of unknown messages: recorded, not checked."""
    size_bytes: int
    damaged_bytes: int
    """Bytes in no record."""
    bad_times: int
    """Records whose time was missing or impossible and was taken from the record before."""
    backward_steps: int
    """Times that are earlier than the one before."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TlogIndex:
    """One row per record, (N,) each, in file order."""

    t_us: Ints
    """Unix µs; of a record with a bad time, the time of the nearest good one before it. Not always increasing."""
    offset: Ints
    """Offset of the frame: its time is in the eight bytes before."""
    length: Ints
    system_id: NDArray[np.uint8]
    component_id: NDArray[np.uint8]
    message_id: NDArray[np.int32]
    seq: NDArray[np.uint8]
    signed: NDArray[np.bool_]
    known: NDArray[np.bool_]
    """The message is known and its checksum is right; others are listed unchecked and are not to be used."""
    time_ok: NDArray[np.bool_]
    time_source: TimeSource
    """``none``: the file has no times, and t_us only keeps the order, a millisecond apart from 0 on."""
    damage: tuple[Damage, ...]
    counts: TlogCounts

    def __len__(self) -> int:
        return self.offset.size


def _whole(data: Bytes, frames: Frames) -> Frames:
    """Drop signed frames that were cut in their signature, which no checksum covers: another record begins in it."""
    signed = (data[frames.offset] == MAGIC_V2) & (data[frames.offset + 2] == 1)
    if not signed.any():
        return frames
    starts = np.append(frames.offset, 2 * data.size)
    following = starts[np.searchsorted(frames.offset, frames.end - SIGNATURE_LENGTH)]
    cut = signed & (following < frames.end)
    # so close that the frame behind has no room for its time, unless that began in the signature
    near = np.flatnonzero(signed & (following >= frames.end) & (following < frames.end + TIME_LENGTH))
    cut[near] = stamped(data, following[near], near=frames.offset[near])
    return frames.select(~cut)


def _without_overlaps(frames: Frames, step: int) -> Frames:
    """Drop frames that overlap others: the one that joins its neighbours stays, else the earlier."""
    start, end = frames.offset, frames.end
    if start.size < 2:
        return frames
    inside = np.concatenate([[False], start[1:] < np.maximum.accumulate(end)[:-1]])
    if not inside.any():
        return frames
    links = np.isin(start - step, end).astype(np.int64) + np.isin(end + step, start)
    keep = np.ones(start.size, dtype=np.bool_)
    edges = np.flatnonzero(np.diff(np.concatenate([inside, [False]]).astype(np.int8)))
    for first, last in edges.reshape(-1, 2):
        cluster = np.arange(first, last + 1)
        kept: list[tuple[int, int, int]] = []  # start, end and row of those that stay, in order
        order = cluster[np.lexsort((start[cluster], -links[cluster]))]
        for row in zip(start[order].tolist(), end[order].tolist(), order.tolist(), strict=True):
            place = bisect(kept, row)
            if (place == 0 or kept[place - 1][1] <= row[0]) and (place == len(kept) or row[1] <= kept[place][0]):
                kept.insert(place, row)
        keep[cluster] = False
        keep[[row for _, _, row in kept]] = True
    return frames.select(keep)


def _unknown_frames(data: Bytes, good: Frames, step: int) -> Frames:
    """Frames of unknown messages in the gaps between good ones; in a file without times, those that touch others."""
    start = np.concatenate([[0], good.end])
    stop = np.append(good.offset, data.size)
    roomy = stop - start > step + 8
    start, stop = start[roomy], stop[roomy]
    # room for the next record's time, if it has one
    stop = np.where(stamped(data, stop) & (stop < data.size), stop - step, stop)
    if not start.size:
        return Frames(start, start)
    found = find_unknown(data, start + step, stop, partial(_can_begin, data, step))
    gap = np.searchsorted(start, found.offset, side="right") - 1
    found = found.select(found.end <= stop[gap])
    if step == 0:
        ends, starts = np.concatenate([[0], good.end, found.end]), np.concatenate([good.offset, found.offset])
        found = found.select(np.isin(found.offset, ends) | np.isin(found.end, starts))
    return _without_overlaps(found, step)


def _can_begin(data: Bytes, step: int, at: Ints) -> NDArray[np.bool_]:
    """(n,) whether a frame of an unknown message can begin here: in a log with times only behind one."""
    return could_be_time(data, at) if step else np.ones(at.size, dtype=np.bool_)


def _step(data: Bytes, frames: Frames) -> int:
    """Bytes between one frame and the next: 8 of time, or 0 in a file without times."""
    gaps = frames.offset[1:] - frames.end[:-1]
    touching, spaced = np.count_nonzero(gaps == 0), np.count_nonzero(gaps == TIME_LENGTH)
    if touching == spaced:
        spaced += int(stamped(data, frames.offset, little=True).any())
    return TIME_LENGTH if spaced > touching else 0


def _columns(data: Bytes, frames: Frames) -> dict[str, NDArray[np.generic]]:
    """Header columns of all frames."""
    head = np.zeros((frames.offset.size, 10), dtype=np.uint8)
    tail = frames.offset > data.size - 10  # a MAVLink 1 frame may be shorter than a MAVLink 2 header
    head[~tail] = gather(data, frames.offset[~tail], 10)
    head[tail, :8] = gather(data, frames.offset[tail], 8) if data.size >= 8 else 0
    v2 = head[:, 0] == MAGIC_V2
    wide = head[:, 7].astype(np.int32) | head[:, 8].astype(np.int32) << 8 | head[:, 9].astype(np.int32) << 16
    return {
        "seq": np.where(v2, head[:, 4], head[:, 2]),
        "system_id": np.where(v2, head[:, 5], head[:, 3]),
        "component_id": np.where(v2, head[:, 6], head[:, 4]),
        "message_id": np.where(v2, wide, head[:, 5].astype(np.int32)),
        "signed": v2 & (head[:, 2] == 1),
    }


def build_index(data: Bytes) -> TlogIndex:
    """Indexes a log's bytes; damage never raises, it is listed.

    Args:
        data: (size,) the file.

    Returns:
        The index; empty when no good frame is in the data.
    """
    found = _whole(data, find_frames(data))
    step = _step(data, found)
    good = _without_overlaps(found, step)
    unknown = _unknown_frames(data, good, step) if good.offset.size else good
    order = np.argsort(np.concatenate([good.offset, unknown.offset]), kind="stable")
    frames = Frames(
        np.concatenate([good.offset, unknown.offset])[order], np.concatenate([good.length, unknown.length])[order]
    )
    known = order < good.offset.size
    source: TimeSource = "none"
    t_us, there = np.zeros(order.size, dtype=np.int64), np.zeros(order.size, dtype=np.bool_)
    time_ok = there
    if step:
        t_us, there, source = read_times(data, frames)
        time_ok = times_ok(t_us, there)
        # frames without a checksum to verify must at least have a time; noise has none
        timed = time_ok | stamped(data, frames.offset, little=source == "little-endian")
        keep = (known | timed) & ~embedded(data, frames, time_ok, step)
        if not keep.all():
            frames, known = frames.select(keep), known[keep]
            t_us, there, source = read_times(data, frames)
            time_ok = times_ok(t_us, there)
    damage = describe_gaps(data, frames, there, step)
    if step:
        damage += describe_times(frames, there & ~time_ok, TIME_LENGTH)
    t_us = fill(t_us, time_ok)
    counts = TlogCounts(
        records=known.size,
        unknown=int(np.count_nonzero(~known)),
        size_bytes=data.size,
        damaged_bytes=int(data.size - frames.length.sum() - TIME_LENGTH * np.count_nonzero(there)),
        bad_times=int(np.count_nonzero(~time_ok)),
        backward_steps=int(np.count_nonzero(np.diff(t_us) < 0)),
    )
    return TlogIndex(
        t_us=t_us,
        offset=frames.offset,
        length=frames.length,
        known=known,
        time_ok=time_ok,
        time_source=source,
        damage=tuple(sorted(damage, key=lambda d: d.start)),
        counts=counts,
        **_columns(data, frames),  # type: ignore[arg-type]
    )
