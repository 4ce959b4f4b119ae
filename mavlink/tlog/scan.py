"""Finds every MAVLink frame in a file's bytes at once: numpy over all places where a frame could begin.

Every byte that may be a magic is a candidate; headers are read for all candidates together, and the checksums of all
plausible ones are computed in groups of equal length, two bytes per step through a table of 65,536 entries:

    crc' = T[crc ⊕ w],   w the next two bytes, little-endian

So damage anywhere costs only the frame it is in: no frame is found by way of the one before it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from mavlink.protocol.crc import CRC_TABLE
from mavlink.protocol.dialect import DEFINITIONS
from mavlink.protocol.framing import SIGNATURE_LENGTH
from mavlink.protocol.packet import MAGIC_V1, MAGIC_V2

Bytes = NDArray[np.uint8]
Ints = NDArray[np.int64]

_WINDOW = 1 << 23  # bytes searched at a time: the candidates of one window stay in the cache
_ROWS = 1 << 14  # frames per checksum block, for the same reason
_ID_LIMIT = 1 << 16  # one more than the greatest id the tables hold; no dialect here goes beyond
LONGEST = 255 + 12 + SIGNATURE_LENGTH
"""Bytes of a frame, at the most."""
_UNKNOWN = -1
_V1_IDS, _V1_ID, _V2_FLAGS = 256, 5, 2  # MAVLink 1's ids, their place in its header, that of MAVLink 2's flags
_BATCH = 1 << 18  # candidates looked at at a time; a window of a log that is well holds as many
_DENSE = 64  # a window with more magics than one in this many bytes is full of them; noise has one in 256


@dataclass(frozen=True, slots=True)
class Frames:
    """Frames in a file, (N,) each, ordered by offset."""

    offset: Ints
    """Bytes from the start of the file to the magic byte."""
    length: Ints
    """Bytes from the magic to the end of the checksum or signature."""

    @property
    def end(self) -> Ints:
        """Offset of the first byte after each frame."""
        return self.offset + self.length

    def select(self, index: NDArray[np.int64] | NDArray[np.bool_]) -> Frames:
        """Return some of the frames."""
        return Frames(self.offset[index], self.length[index])


@cache
def _tables() -> tuple[NDArray[np.int16], NDArray[np.uint8], NDArray[np.uint16], NDArray[np.uint16]]:
    """Payload length by id (−1 unknown), CRC extra by id, CRC of one byte, CRC of two bytes."""
    longest = np.full(_ID_LIMIT, _UNKNOWN, dtype=np.int16)
    extra = np.zeros(_ID_LIMIT, dtype=np.uint8)
    for message_id, (length, crc_extra) in DEFINITIONS.items():
        longest[message_id] = length
        extra[message_id] = crc_extra
    one = np.array(CRC_TABLE, dtype=np.uint16)
    word = np.arange(_ID_LIMIT, dtype=np.uint16)
    half = one[word & 0xFF] ^ (word >> 8)
    return longest, extra, one, one[half & 0xFF] ^ (half >> 8)


@cache
def _byte_of() -> NDArray[np.int16]:
    """(65536,) the byte whose CRC is the row's number, −1 where there is none."""
    byte = np.full(1 << 16, -1, dtype=np.int16)
    byte[list(CRC_TABLE)] = np.arange(256)
    return byte


def gather(data: Bytes, at: Ints, width: int) -> Bytes:
    """(N, width) bytes of ``data`` from each place in ``at`` on; every place must have that many."""
    windows = np.ndarray((max(data.size - width + 1, 0),), dtype=f"V{width}", buffer=data, strides=(1,))
    return windows[at].view(np.uint8).reshape(-1, width)


def _headers(data: Bytes, at: Ints, magic: int) -> tuple[Ints, NDArray[np.int64], NDArray[np.int64], NDArray[np.uint8]]:
    """Places whose header is whole and has no foreign flag, with frame length, message id and payload length."""
    size = 12 if magic == MAGIC_V2 else 8
    at = at[at <= data.size - size]
    head = gather(data, at, size)
    if magic == MAGIC_V2:
        understood = head[:, 2] <= 1
        at, head = at[understood], head[understood]
        ids = head[:, 7].astype(np.int64) | head[:, 8].astype(np.int64) << 8 | head[:, 9].astype(np.int64) << 16
        length = head[:, 1].astype(np.int64) + 12 + SIGNATURE_LENGTH * head[:, 2]
    else:
        ids = head[:, 5].astype(np.int64)
        length = head[:, 1].astype(np.int64) + 8
    fits = at + length <= data.size
    return at[fits], length[fits], ids[fits], head[fits, 1]


def _crc(data: Bytes, at: Ints, covered: int) -> tuple[NDArray[np.uint16], NDArray[np.uint16]]:
    """(N,) CRC over ``covered`` bytes after the magic, without the extra, and (N,) the checksum that was sent."""
    _, _, one, two = _tables()
    states, sent = np.empty(at.size, dtype=np.uint16), np.empty(at.size, dtype=np.uint16)
    for block in range(0, at.size, _ROWS):
        part = slice(block, block + _ROWS)
        rows = gather(data, at[part] + 1, covered + 2)
        crc = np.full(len(rows), 0xFFFF, dtype=np.uint16)
        if covered % 2:
            crc = one[(crc ^ rows[:, 0]) & 0xFF] ^ (crc >> 8)
        words = np.ascontiguousarray(rows[:, covered % 2 :]).view("<u2").T
        for word in words[:-1]:
            crc = two[crc ^ word]
        states[part], sent[part] = crc, words[-1]
    return states, sent


def _crcs(
    data: Bytes, at: Ints, payload: NDArray[np.uint8], magic: int
) -> tuple[NDArray[np.uint16], NDArray[np.uint16]]:
    """Return the checksums of frames of any length, worked on in groups of equal length."""
    covered = payload.astype(np.uint16) + np.uint16(9 if magic == MAGIC_V2 else 5)
    order = np.argsort(covered, kind="stable")
    states, sent = np.empty(at.size, dtype=np.uint16), np.empty(at.size, dtype=np.uint16)
    bounds = np.flatnonzero(np.diff(covered[order])) + 1
    for group in np.split(order, bounds):
        if group.size:
            states[group], sent[group] = _crc(data, at[group], int(covered[group[0]]))
    return states, sent


def _good_frames(data: Bytes, at: Ints, magic: int) -> Frames:
    """Return the candidate places where a good frame begins."""
    longest, extras, one, _ = _tables()
    at, length, ids, payload = _headers(data, at, magic)
    plausible = payload <= longest[np.minimum(ids, _ID_LIMIT - 1)]
    at, length, ids, payload = at[plausible], length[plausible], ids[plausible], payload[plausible]
    states, sent = _crcs(data, at, payload, magic)
    right = one[(states ^ extras[ids]) & 0xFF] ^ (states >> 8) == sent
    return Frames(at[right], length[right])


def find_frames(data: Bytes) -> Frames:
    """Every place where a good frame begins; frames may overlap where one carries another, or by chance.

    Args:
        data: (size,) the file.

    Returns:
        Frames of known messages with the right checksum, by offset.
    """
    longest = _tables()[0]
    known_v1 = longest[:_V1_IDS]
    found: list[Frames] = []
    windows = [start for start in range(0, data.size, _WINDOW) if _has_magic(data, start)]
    for magic in (MAGIC_V2, MAGIC_V1):
        places = (_candidates(data, start, magic, lambda length, ids: length <= known_v1[ids]) for start in windows)
        found += [_good_frames(data, at, magic) for at in _batches(places)]
    offset = np.concatenate([frames.offset for frames in found]) if found else np.empty(0, dtype=np.int64)
    length = np.concatenate([frames.length for frames in found]) if found else np.empty(0, dtype=np.int64)
    order = np.argsort(offset, kind="stable")
    return Frames(offset[order], length[order])


def find_unknown(data: Bytes, start: Ints, stop: Ints, likely: Callable[[Ints], NDArray[np.bool_]]) -> Frames:
    """Frames of unknown messages that begin in some places: those that some CRC extra makes right.

    All frames of one message share their extra: where they disagree, the most frequent one counts.

    Args:
        data: (size,) the file.
        start: (n,) first bytes of ranges, in order and not overlapping.
        stop: (n,) one after their last.
        likely: whether a frame can begin at each of some places, by what precedes it; spares the checksums.
    """
    unknown_v1 = _tables()[0][:_V1_IDS] == _UNKNOWN
    found = [np.empty((0, 3), dtype=np.int64)]
    # windows without a gap are most of a log that is well
    windows = [
        window
        for window in range(0, data.size, _WINDOW)
        if np.searchsorted(stop, window, side="right") < np.searchsorted(start, window + _WINDOW)
        and _has_magic(data, window)
    ]

    def within(at: Ints) -> Ints:
        gap = np.searchsorted(start, at, side="right") - 1
        at = at[(gap >= 0) & (at < stop[gap])]
        return at[likely(at)]

    for magic in (MAGIC_V2, MAGIC_V1):
        places = (within(_candidates(data, window, magic, lambda length, ids: unknown_v1[ids])) for window in windows)
        found += [_unknown_at(data, at, magic) for at in _batches(places)]
    rows = np.concatenate(found)
    rows = rows[np.argsort(rows[:, 0], kind="stable")]
    rows = rows[_most_frequent(rows[:, 2])]
    return Frames(rows[:, 0], rows[:, 1])


def _unknown_at(data: Bytes, at: Ints, magic: int) -> Ints:
    """(m, 3) place, length, and id with CRC extra, of frames of unknown messages among the candidate places."""
    longest = _tables()[0]
    places, length, ids, payload = _headers(data, at, magic)
    new = np.flatnonzero(longest[np.minimum(ids, _ID_LIMIT - 1)] == _UNKNOWN)
    states, sent = _crcs(data, places[new], payload[new], magic)
    byte = _byte_of()[sent ^ (states >> 8)]
    fits = byte >= 0
    key = ids[new] << 8 | (byte ^ (states & 0xFF).astype(np.int16))
    rows: Ints = np.stack([places[new], length[new], key], axis=1)[fits]
    return rows


def _has_magic(data: Bytes, start: int) -> bool:
    """Tell whether a window has a byte as large as the smaller magic; a disk that was full leaves gigabytes without."""
    return bool(data[start : start + _WINDOW].max() >= MAGIC_V2)


def _candidates(data: Bytes, start: int, magic: int, wanted_v1: Callable[[Bytes, Bytes], NDArray[np.bool_]]) -> Ints:
    """Places in a window where a frame can begin.

    A header is looked at for each of them, which takes forty times its bytes: where a window is full of magics, those
    that cannot begin one are left out first.

    Args:
        data: (size,) the file.
        wanted_v1: of payload lengths and message ids, (n,) each, which MAVLink 1 frames are looked for.
    """
    window = data[start : start + _WINDOW]
    begins = window == magic
    count = np.count_nonzero(begins)
    if not count:
        return np.empty(0, dtype=np.int64)
    if count == window.size:
        begins[:-LONGEST] = False  # a frame of magics alone is none: its length, or its flags, cannot be
    elif count > window.size // _DENSE:
        header = data[start : start + _WINDOW + _V1_ID]
        if magic == MAGIC_V2:
            flags = header[_V2_FLAGS : _V2_FLAGS + window.size]
            begins[: flags.size] &= flags <= 1
        else:
            ids = header[_V1_ID:]
            begins[: ids.size] &= wanted_v1(header[1 : 1 + ids.size], ids)
    return np.flatnonzero(begins) + start


def _batches(places: Iterable[Ints]) -> Iterator[Ints]:
    """The places of windows that hold few of them put together: work on a hundred takes as long as on a thousand."""
    held: list[Ints] = []
    count = 0
    for at in places:
        held += [at] if at.size else []
        count += at.size
        if count >= _BATCH:
            yield np.concatenate(held)
            held, count = [], 0
    if count:
        yield np.concatenate(held)


def _most_frequent(key: Ints) -> NDArray[np.bool_]:
    """(N,) whether no other key with the same id (all but the low eight bits) is more frequent."""
    keys, inverse, counts = np.unique(key, return_inverse=True, return_counts=True)
    most: dict[int, int] = {}
    for message_id, count in zip((keys >> 8).tolist(), counts.tolist(), strict=True):
        most[message_id] = max(count, most.get(message_id, 0))
    best = counts == np.array([most[message_id] for message_id in (keys >> 8).tolist()], dtype=np.int64)
    return np.asarray(best[inverse], dtype=np.bool_)
