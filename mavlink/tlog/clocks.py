"""The clocks in a log: senders that were restarted, a recorder's clock that was set, time that was compressed.

A sender's boot clock is independent of the recorder's; the stamps are compared with it, sender by sender.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega

from infra.clock_steps import level_steps, restarts
from mavlink.tlog.log import Tlog
from mavlink.tlog.scan import Ints

_STEP_US = 2_000_000
_AROUND = 200  # samples on either side of a step: late traffic is over by then
_PARTS, _TIMES = 8, 4.0
"""Parts of a log whose earliest arrivals are compared, and how many times their difference a step is."""
_BACK_MS = 1001
_WRAP_MS = 1 << 32
_UNIX_FROM_US = 1_000_000_000_000_000
"""Clocks that were never set begin in 1970."""
_CHUNKS = 40


@dataclass(frozen=True, slots=True, kw_only=True)
class ClockStep:
    """Step of the recorder's clock while a sender's went on."""

    row: int
    """First record with the new time."""
    offset: int
    """Offset of the step in the file."""
    by_s: float
    """Positive: forward."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SenderClock:
    """One sender's boot clock beside the stamps."""

    system_id: int
    component_id: int
    samples: int
    boots: int
    """Number of its starts, 1 for a flight without a restart."""
    speed: float
    """Seconds of its boot clock per second of stamps, NaN where the log is too short; 1 for a flight.

    Of the longest stretch between two starts.
    """
    gain: float
    """Seconds that the stamps gain on it per second, by the earliest arrivals, of its longest stretch; NaN unknown."""
    gained_s: float
    """Seconds that they gained in all of that."""
    steps: tuple[ClockStep, ...]


def sender_clocks(tlog: Tlog, least_us: int = _STEP_US) -> tuple[SenderClock, ...]:
    """Clocks of all senders that report their time since boot; empty for a log without stamps.

    Args:
        least_us: smaller steps of the stamps are lateness.
    """
    rows, boot_ms = _boot_times(tlog)
    index = tlog.index
    sender = index.system_id[rows].astype(np.int64) << 8 | index.component_id[rows]
    return tuple(
        _clock(tlog, int(key), rows[sender == key], boot_ms[sender == key], least_us)
        for key in np.unique(sender)
        if np.count_nonzero(sender == key) >= 2
    )


def dated_by_senders(tlog: Tlog) -> Ints:
    """(n,) Unix µs of each record by the clocks of those senders that tell the date by SYSTEM_TIME; empty by none.

    For logs without stamps. What carries no time has that of what was recorded around it.
    """
    index = tlog.index
    dated, wire = tlog.columns(ardupilotmega.MAVLINK_MSG_ID_SYSTEM_TIME)
    unix_us, since_us = wire["time_unix_usec"].astype(np.int64), wire["time_boot_ms"].astype(np.int64) * 1000
    rows, boot_ms = _boot_times(tlog)
    t_us = np.zeros(rows.size, dtype=np.int64)
    owner = index.system_id.astype(np.int64) << 8 | index.component_id
    for sender in np.unique(owner[dated]).tolist():
        usable = (owner[dated] == sender) & (unix_us >= _UNIX_FROM_US) & (since_us > 0)
        zero_us = (unix_us - since_us)[usable]
        # a sender that was restarted has several
        if zero_us.size and np.ptp(zero_us) < _STEP_US:
            its = owner[rows] == sender
            t_us[its] = int(np.median(zero_us)) + 1000 * boot_ms[its]
    rows, t_us = rows[t_us > 0], t_us[t_us > 0]
    if not rows.size:
        return np.empty(0, dtype=np.int64)
    between = np.interp(np.arange(len(index)), rows, (np.maximum.accumulate(t_us) - t_us[0]).astype(np.float64))
    found: Ints = np.rint(between).astype(np.int64) + int(t_us[0])
    found[rows] = t_us
    return found


def _boot_times(tlog: Tlog) -> tuple[Ints, Ints]:
    """(n,) rows of all messages that carry time_boot_ms, in order, and (n,) that time in ms."""
    index = tlog.index
    found: list[tuple[Ints, Ints]] = [(np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64))]
    for message_id in np.unique(index.message_id[index.known]).tolist():
        if "time_boot_ms" in ardupilotmega.mavlink_map[message_id].fieldnames:
            rows, values = tlog.columns(message_id)
            found.append((rows, values["time_boot_ms"].astype(np.int64)))
    rows, boot_ms = (np.concatenate(parts) for parts in zip(*found, strict=True))
    order = np.argsort(rows, kind="stable")
    # 0 means unknown
    order = order[boot_ms[order] > 0]
    return rows[order], boot_ms[order]


def _clock(tlog: Tlog, key: int, rows: Ints, boot_ms: Ints, least_us: int) -> SenderClock:
    starts = [0, *_restarts(boot_ms), rows.size]
    timed = tlog.index.time_source != "none"
    t_us = tlog.index.t_us[rows]
    speeds: list[float] = []
    steps: list[ClockStep] = []
    longest = (0, float("nan"), 0.0)
    for start, stop in pairwise(starts):
        if timed:
            speed = _speed(t_us[start:stop], boot_ms[start:stop])
            speeds.append(speed)
            if 0.8 < speed < 1.25:
                epoch_us = t_us[start:stop] - 1000 * boot_ms[start:stop]
                found = level_steps(epoch_us, _least_us(epoch_us, least_us), _AROUND, late=True)
                steps += [
                    ClockStep(
                        row=int(rows[start + i]), offset=int(tlog.index.offset[rows[start + i]]), by_s=by_us * 1e-6
                    )
                    for i, by_us in found
                ]
                for first, last in pairwise([0, *(i for i, _ in found), stop - start]):
                    gained = _gained(epoch_us[first:last], boot_ms[start + first : start + last])
                    longest = max(longest, (last - first, *gained), key=lambda each: each[0])
    known = [(samples, speed) for samples, speed in zip(np.diff(starts), speeds, strict=False) if speed == speed]
    return SenderClock(
        system_id=key >> 8,
        component_id=key & 0xFF,
        samples=rows.size,
        boots=len(starts) - 1,
        speed=max(known)[1] if known else float("nan"),
        gain=longest[1],
        gained_s=longest[2],
        steps=tuple(steps),
    )


def _restarts(boot_ms: Ints) -> list[int]:
    """Indices at which the boot clock restarts; a wrap is no restart."""
    return [
        i
        for i in restarts(boot_ms, _BACK_MS)
        if boot_ms[max(0, i - 8) : i].min() <= _WRAP_MS - 60_000 or boot_ms[i : i + 8].max() >= 60_000
    ]


def _speed(t_us: Ints, boot_ms: Ints) -> float:
    """The speed that holds for most of the time by the sender's clock, so that steps of either clock do not count.

    Messages of a burst come within a millisecond: a part within one says nothing, and counts for next to nothing. NaN
    below a second by both clocks, and where the stamps do not change.
    """
    if t_us.size < 4 or max(np.ptp(t_us), 1000 * np.ptp(boot_ms)) < 1_000_000:
        return float("nan")
    at = np.unique(np.linspace(0, t_us.size - 1, min(_CHUNKS, t_us.size // 2) + 1).astype(np.int64))
    wall, own = np.diff(t_us[at]), 1000 * np.diff(boot_ms[at])
    moving = wall > 0
    if not moving.any():
        return float("nan")
    speed, own = own[moving] / wall[moving], np.maximum(own[moving], 0)
    order = np.argsort(speed)
    share = np.cumsum(own[order])
    # a sender whose clock stands still has no time of its own to weigh by
    middle = int(np.searchsorted(share, 0.5 * share[-1])) if share[-1] else len(order) // 2
    return float(speed[order[middle]])


def _earliest(epoch_us: Ints) -> Ints:
    """Earliest arrivals of parts of a log, in order: the other ones are late."""
    return np.asarray(np.minimum.reduceat(epoch_us, np.arange(0, len(epoch_us), _part(len(epoch_us)))), np.int64)


def _part(count: int) -> int:
    return int(np.clip(count // _PARTS, 1, _AROUND))


def _least_us(epoch_us: Ints, least_us: int) -> int:
    """Least step of the time of boot, by the stamps: more than the earliest arrivals differ."""
    differ = np.abs(np.diff(_earliest(epoch_us)))
    return max(least_us, round(_TIMES * float(np.median(differ)))) if len(differ) else least_us


def _gained(epoch_us: Ints, boot_ms: Ints) -> tuple[float, float]:
    """Seconds that stamps gain on a sender's clock per second, NaN where the log is too short, and in all."""
    earliest = _earliest(epoch_us) - epoch_us[0]
    third = len(earliest) // 3
    middle_ms = boot_ms[_part(len(boot_ms)) // 2 :: _part(len(boot_ms))][: len(earliest)]
    span_s = float(np.median(middle_ms[-third:]) - np.median(middle_ms[:third])) * 1e-3 if third else 0.0
    if span_s <= 1.0:
        return float("nan"), 0.0
    gain = float(np.median(earliest[-third:]) - np.median(earliest[:third])) * 1e-6 / span_s
    return gain, gain * float(np.ptp(boot_ms)) * 1e-3
