"""Index of a telemetry log: which records it holds, when, and which bytes are damaged.

A record is 8 bytes of time (big-endian Unix µs) and a frame. Old files carry little-endian times, ``.raw`` files none.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from mavlink.frame import SIGNATURE_LENGTH
from mavlink.packet import MAGIC_V2
from mavlink.tlog_damage import Damage, describe_gaps, describe_times
from mavlink.tlog_scan import Bytes, Frames, Ints, find_frames, gather, measure_unknown

__all__ = ["TIME_LENGTH", "Damage", "TimeSource", "TlogCounts", "TlogIndex", "build_index"]

TIME_LENGTH = 8
TimeSource = Literal["big-endian", "little-endian", "none"]

_YEAR_US = 366 * 86_400_000_000
_SPIKE_US = 60_000_000
_EARLIEST_US, _LATEST_US = 946_684_800_000_000, 4_102_444_800_000_000  # years 2000 and 2100
_UNTIMED_STEP_US = 1000


@dataclass(frozen=True, slots=True, kw_only=True)
class TlogCounts:
    """What a log holds, in numbers."""

    records: int
    """Frames, good and unknown."""
    unknown: int
    """Frames of unknown messages: kept, not checked."""
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
    """Of the frame: its time is in the eight bytes before."""
    length: Ints
    system_id: NDArray[np.uint8]
    component_id: NDArray[np.uint8]
    message_id: NDArray[np.int32]
    seq: NDArray[np.uint8]
    signed: NDArray[np.bool_]
    known: NDArray[np.bool_]
    """The message is known and its checksum is right; others were kept unchecked and are not to be trusted."""
    time_ok: NDArray[np.bool_]
    time_source: TimeSource
    """``none``: the file has no times, and t_us only keeps the order, a millisecond apart from 0 on."""
    damage: tuple[Damage, ...]
    counts: TlogCounts

    def __len__(self) -> int:
        return self.offset.size


def _whole(data: Bytes, frames: Frames) -> Frames:
    """Drops signed frames in whose signature another frame begins: they were cut there, which no checksum sees."""
    signed = (data[frames.offset] == MAGIC_V2) & (data[frames.offset + 2] == 1)
    if not signed.any():
        return frames
    starts = np.append(frames.offset, data.size)
    following = starts[np.searchsorted(frames.offset, frames.end - SIGNATURE_LENGTH)]
    return frames.take(~(signed & (following < frames.end)))


def _untangle(frames: Frames, step: int) -> Frames:
    """Drops frames that overlap others: the one that follows on from its neighbours stays, else the earlier."""
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
        kept: list[int] = []
        for i in cluster[np.lexsort((start[cluster], -links[cluster]))]:
            if all(end[i] <= start[k] or start[i] >= end[k] for k in kept):
                kept.append(int(i))
        keep[cluster] = False
        keep[kept] = True
    return frames.take(keep)


def _unknown_frames(data: Bytes, frames: Frames, step: int) -> Frames:
    """Frames of unknown messages that directly follow a good frame, the file's start or one another."""
    place = np.concatenate([[0], frames.end])
    limit = np.concatenate([frames.offset - step, [data.size]])
    offsets: list[Ints] = []
    lengths: list[Ints] = []
    while True:
        roomy = limit - place > step + 8
        place, limit = place[roomy] + step, limit[roomy]
        length = measure_unknown(data, place)
        fits = (length > 0) & (place + length <= limit)
        if not fits.any():
            break
        offsets.append(place[fits])
        lengths.append(length[fits])
        place, limit = place[fits] + length[fits], limit[fits]
    empty = [np.empty(0, dtype=np.int64)]
    return Frames(np.concatenate(offsets or empty), np.concatenate(lengths or empty))


def _step(frames: Frames) -> int:
    """Bytes between one frame and the next: 8 of time, or 0 in a file without times."""
    gaps = frames.offset[1:] - frames.end[:-1]
    return 0 if np.count_nonzero(gaps == 0) > np.count_nonzero(gaps == TIME_LENGTH) else TIME_LENGTH


def _dated(t_us: Ints) -> int:
    return int(np.count_nonzero((t_us >= _EARLIEST_US) & (t_us < _LATEST_US)))


def _read_times(data: Bytes, frames: Frames) -> tuple[Ints, NDArray[np.bool_], TimeSource]:
    """Times as stamped, whether each is there at all, and which way round the bytes are."""
    before = np.concatenate([[0], frames.end[:-1]])
    there = frames.offset - before >= TIME_LENGTH
    stamps = np.zeros((frames.offset.size, TIME_LENGTH), dtype=np.uint8)
    stamps[there] = gather(data, frames.offset[there] - TIME_LENGTH, TIME_LENGTH)
    big = stamps.view(">u8").ravel().astype(np.int64)
    little = stamps.view("<u8").ravel().astype(np.int64)
    if _dated(little) > _dated(big):
        return little, there, "little-endian"
    return big, there, "big-endian"


def _times_ok(t_us: Ints, there: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Which stamps can be right: within a year of the middle one, and not one alone a minute off its neighbours."""
    if not there.any():
        return there
    middle = int(np.median(t_us[there]))
    ok = there & (t_us > middle - _YEAR_US) & (t_us < middle + _YEAR_US)
    rows = np.flatnonzero(ok)
    t = t_us[rows]
    if t.size >= 3:
        alone = (np.abs(t[1:-1] - t[:-2]) > _SPIKE_US) & (np.abs(t[2:] - t[1:-1]) > _SPIKE_US)
        alone &= np.abs(t[2:] - t[:-2]) <= _SPIKE_US
        ok[rows[1:-1][alone]] = False
    return ok


def _fill(t_us: Ints, ok: NDArray[np.bool_]) -> Ints:
    """Bad times become the good one before them; those before the first good one become that one."""
    if not ok.any():
        return np.arange(t_us.size, dtype=np.int64) * _UNTIMED_STEP_US
    source = np.maximum.accumulate(np.where(ok, np.arange(t_us.size), -1))
    return t_us[np.where(source < 0, int(np.argmax(ok)), source)]


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
    step = _step(found)
    good = _untangle(found, step)
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
        t_us, there, source = _read_times(data, frames)
        time_ok = _times_ok(t_us, there)
        # what nothing checks must at least have a time that fits; noise does not
        keep = known | time_ok
        frames, known, t_us, there, time_ok = frames.take(keep), known[keep], t_us[keep], there[keep], time_ok[keep]
    damage = describe_gaps(data, frames, there, step)
    if step:
        damage += describe_times(frames, there & ~time_ok, TIME_LENGTH)
    t_us = _fill(t_us, time_ok)
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
