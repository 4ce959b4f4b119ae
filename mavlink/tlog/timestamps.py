"""Times of a log's records: their byte order, which of them are plausible, and what replaces the others."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from mavlink.tlog.scan import Bytes, Frames, Ints, gather

TIME_LENGTH = 8
TimeSource = Literal["big-endian", "little-endian", "none"]

_YEAR_US = 366 * 86_400_000_000
_SPIKE_US = 60_000_000
_EARLIEST_US, _LATEST_US = 946_684_800_000_000, 4_102_444_800_000_000  # years 2000 and 2100
_UNTIMED_STEP_US = 1000
_ANY_CLOCK_US = 1 << 53  # the year 2255
_FAR_US = 1 << 62
_NEIGHBOURS = 4
_SUPPORT = 2  # neighbours that must agree: a bit that flips in two stamps makes a pair, not a cluster
_CLUSTER, _CLUSTER_SHARE = 8, 0.01  # this many stamps, and this share of all, are some sender's clock, not damage


def _dated(t_us: Ints) -> NDArray[np.bool_]:
    return (t_us >= _EARLIEST_US) & (t_us < _LATEST_US)


def read_times(data: Bytes, frames: Frames) -> tuple[Ints, NDArray[np.bool_], TimeSource]:
    """Times as stamped, (N,) whether each is there at all, and their byte order."""
    before = np.concatenate([[0], frames.end[:-1]])
    there = frames.offset - before >= TIME_LENGTH
    stamps = np.zeros((frames.offset.size, TIME_LENGTH), dtype=np.uint8)
    stamps[there] = gather(data, frames.offset[there] - TIME_LENGTH, TIME_LENGTH)
    big = stamps.view(">u8").ravel().astype(np.int64)
    little = stamps.view("<u8").ravel().astype(np.int64)
    if _likelihood(little[there]) > _likelihood(big[there]):
        return little, there, "little-endian"
    return big, there, "big-endian"


def _likelihood(t_us: Ints) -> int:
    """Number of stamps of this century, and of those within a minute of the next: a clock that was never set."""
    going_on = (t_us[:-1] > 0) & (t_us[1:] > 0) & (np.abs(np.diff(t_us)) <= _SPIKE_US)
    return int(np.count_nonzero(_dated(t_us)) + np.count_nonzero(going_on))


def times_ok(t_us: Ints, there: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(N,) which stamps are plausible: within a year of the median or in a cluster, and supported by others.

    A cluster far away is a clock that was set in flight: without a battery it starts in 1970.

    A stamp a minute or more off is supported when it agrees with the next record or the last, with two of the four on
    either side, or with many anywhere (another writer's clock), or lies between those around it (a silence). An error
    of less than a minute cannot be distinguished from late traffic.
    """
    if not there.any():
        return there
    dated = t_us[there & _dated(t_us)]
    known = dated if dated.size else t_us[there]
    middle = int(np.partition(known, (known.size - 1) // 2)[(known.size - 1) // 2])
    if middle <= 0:
        return np.zeros_like(there)
    ok = there & (t_us > middle - _YEAR_US) & (t_us < middle + _YEAR_US)
    far = np.flatnonzero(there & ~ok & (t_us > 0))
    ok[far[_in_cluster(t_us[far], t_us.size)]] = True
    rows = np.flatnonzero(ok)
    t = t_us[rows]
    if t.size >= 3 and np.abs(np.diff(t)).max() > _SPIKE_US:
        ok[rows[~_supported(t)]] = False
    return ok


def stamped(data: Bytes, at: Ints, *, little: bool = False, near: Ints | None = None) -> NDArray[np.bool_]:
    """(n,) whether the eight bytes before each place are a time of this century.

    Args:
        data: (size,) the file.
        at: (n,) places.
        near: (n,) other places; where a time of this century precedes one, the two must be of the same year.
    """
    big, small = _before(data, at)
    looks = _dated(big)
    if near is not None:
        other, _ = _before(data, near)
        looks &= ~_dated(other) | (np.abs(big - other) < _YEAR_US)
    return looks | _dated(small) if little else looks


def could_be_time(data: Bytes, at: Ints) -> NDArray[np.bool_]:
    """(n,) whether the eight bytes before each place are a time of any clock, one that was never set included."""
    big, little = ((t_us > 0) & (t_us < _ANY_CLOCK_US) for t_us in _before(data, at))
    return big | little


def _before(data: Bytes, at: Ints) -> tuple[Ints, Ints]:
    """(n,) the eight bytes before each place as a big-endian and as a little-endian number, 0 where there are fewer."""
    room = np.flatnonzero(at >= TIME_LENGTH)
    stamps = np.zeros((at.size, TIME_LENGTH), dtype=np.uint8)
    stamps[room] = gather(data, at[room] - TIME_LENGTH, TIME_LENGTH)
    return stamps.view(">u8").ravel().astype(np.int64), stamps.view("<u8").ravel().astype(np.int64)


def _supported(t: Ints) -> NDArray[np.bool_]:
    """(n,) of stamps in file order, those that are supported by others."""
    next_to = np.abs(np.diff(t)) <= _SPIKE_US
    supported = (_agreeing_neighbours(t) >= _SUPPORT) | np.append(next_to, False) | np.append(False, next_to)
    if not supported.any():
        return ~_alone(t)
    supported |= _in_cluster(t, t.size)
    doubtful = np.flatnonzero(~supported)
    certain = np.flatnonzero(supported)
    place = np.searchsorted(certain, doubtful)
    before = np.where(place > 0, t[certain[np.maximum(place - 1, 0)]], -_FAR_US)
    after = np.where(place < certain.size, t[certain[np.minimum(place, certain.size - 1)]], _FAR_US)
    between = (t[doubtful] >= before) & (t[doubtful] <= after)
    near = np.minimum(np.abs(t[doubtful] - before), np.abs(after - t[doubtful])) <= _SPIKE_US
    supported[doubtful] = between | near
    return np.asarray(supported, dtype=np.bool_)


def _agreeing_neighbours(t: Ints) -> Ints:
    """(n,) how many of the records close by agree to a minute."""
    count = np.zeros(t.size, dtype=np.int64)
    for shift in range(1, min(_NEIGHBOURS, t.size - 1) + 1):
        agree = np.abs(t[shift:] - t[:-shift]) <= _SPIKE_US
        count[shift:] += agree
        count[:-shift] += agree
    return count


def _in_cluster(t: Ints, total: int) -> NDArray[np.bool_]:
    """(n,) whether a stamp belongs to a cluster without a gap of a minute, of some share of the ``total``."""
    order = np.argsort(t, kind="stable")
    cluster = np.concatenate([[0], np.cumsum(np.diff(t[order]) > _SPIKE_US)])
    large = np.bincount(cluster) >= max(_CLUSTER, _CLUSTER_SHARE * total)
    member = np.empty(t.size, dtype=np.bool_)
    member[order] = large[cluster]
    return member


def _alone(t: Ints) -> NDArray[np.bool_]:
    """(n,) whether both neighbours agree with each other and not with it."""
    alone = np.zeros(t.size, dtype=np.bool_)
    alone[1:-1] = (np.abs(t[1:-1] - t[:-2]) > _SPIKE_US) & (np.abs(t[2:] - t[1:-1]) > _SPIKE_US)
    alone[1:-1] &= np.abs(t[2:] - t[:-2]) <= _SPIKE_US
    return alone


def fill(t_us: Ints, ok: NDArray[np.bool_]) -> Ints:
    """Bad times become the good one before them; those before the first good one become that one."""
    if not ok.any():
        return np.arange(t_us.size, dtype=np.int64) * _UNTIMED_STEP_US
    source = np.maximum.accumulate(np.where(ok, np.arange(t_us.size), -1))
    return t_us[np.where(source < 0, int(np.argmax(ok)), source)]
