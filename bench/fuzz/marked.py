"""Bytes that remember where they came from, so that after any damage it is known what is still whole."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mavlink.protocol.framing import SIGNATURE_LENGTH
from mavlink.protocol.packet import MAGIC_V2

_FOREIGN = -1


@dataclass(slots=True)
class Marked:
    """A log's bytes (size,) and, for each, the record it is of, its place in it, and whether it was changed."""

    data: NDArray[np.uint8]
    record: NDArray[np.int32]
    """−1: a byte of no record."""
    place: NDArray[np.int32]
    changed: NDArray[np.bool_]
    width: int
    """Bytes of a stamp."""

    @property
    def size(self) -> int:
        return self.data.size

    def part(self, start: int, stop: int) -> Marked:
        span = slice(start, stop)
        return Marked(self.data[span], self.record[span], self.place[span], self.changed[span], self.width)

    def without(self, start: int, stop: int) -> Marked:
        return joined([self.part(0, start), self.part(stop, self.size)])

    def with_bytes(self, at: int, data: bytes) -> Marked:
        return joined([self.part(0, at), foreign(data, self.width), self.part(at, self.size)])

    def overwritten(self, at: int, data: bytes) -> Marked:
        new = np.frombuffer(data, dtype=np.uint8)[: self.size - at]
        out = Marked(self.data.copy(), self.record, self.place, self.changed.copy(), self.width)
        out.changed[at : at + new.size] |= out.data[at : at + new.size] != new
        out.data[at : at + new.size] = new
        return out


def foreign(data: bytes, width: int) -> Marked:
    """Bytes that are of no record."""
    none = np.full(len(data), _FOREIGN, dtype=np.int32)
    return Marked(np.frombuffer(data, dtype=np.uint8), none, none, np.ones(len(data), dtype=np.bool_), width)


def joined(parts: Sequence[Marked]) -> Marked:
    """One after the other."""
    return Marked(
        np.concatenate([p.data for p in parts]),
        np.concatenate([p.record for p in parts]),
        np.concatenate([p.place for p in parts]),
        np.concatenate([p.changed for p in parts]),
        parts[0].width,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class MarkedTruth:
    """What was written: stamps (count,) of eight bytes or none, and frames."""

    frames: tuple[bytes, ...]
    t_us: NDArray[np.int64]
    order: str
    """``>`` or ``<``, empty without times."""

    @property
    def width(self) -> int:
        """Bytes of a stamp."""
        return 8 if self.order else 0

    def stamp(self, record: int) -> bytes:
        return int(self.t_us[record]).to_bytes(8, "big" if self.order == ">" else "little") if self.order else b""

    def standing(self, log: Marked) -> tuple[list[tuple[int, int]], list[tuple[int, int]]]:
        """(offset of the frame, record) of the records that are whole, and of frames that are whole but their stamp or
        signature."""
        whole: list[tuple[int, int]] = []
        partly: list[tuple[int, int]] = []
        raw = log.data.tobytes()
        end, last = 0, (0, 0)
        first, fourth = ((log.place == self.width + k) & (log.record != _FOREIGN) for k in (0, 3))
        places = {(k, int(log.record[k])) for k in np.flatnonzero(first).tolist()}
        # a cut after the first bytes of two frames that begin alike makes one of them
        places |= {(k - 3, int(log.record[k])) for k in np.flatnonzero(fourth).tolist() if k >= 3}
        for offset, record in sorted(places):
            frame = self.frames[record]
            checked = len(frame) - (SIGNATURE_LENGTH if frame[0] == MAGIC_V2 and frame[2] & 1 else 0)
            if raw[offset : offset + checked] != frame[:checked]:
                continue
            signature = raw[offset + checked : offset + len(frame)] == frame[checked:]
            stamped = offset >= self.width and raw[offset - self.width : offset] == self.stamp(record)
            # a byte lost from one record may be the same in the next, but it is of one of them only
            shared = stamped and offset - self.width < end
            if shared and whole and whole[-1] == last:
                partly.append(whole.pop())
            last = (offset, record)
            (whole if signature and stamped and not shared else partly).append(last)
            end = offset + len(frame)
        return whole, partly


def marked_log(truth: MarkedTruth, records: Sequence[int]) -> Marked:
    """These records, one after the other."""
    parts = [truth.stamp(i) + truth.frames[i] for i in records]
    sizes = [len(part) for part in parts]
    data = np.frombuffer(b"".join(parts), dtype=np.uint8)
    record = np.repeat(np.asarray(records, dtype=np.int32), sizes)
    place = np.concatenate([np.arange(size, dtype=np.int32) for size in sizes])
    return Marked(data, record, place, np.zeros(data.size, dtype=np.bool_), truth.width)
