"""Summary of a telemetry log, in numbers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mavlink.protocol.dialect import message_name
from mavlink.tlog.index import Damage, TlogCounts
from mavlink.tlog.log import Tlog
from mavlink.tlog.timestamps import TimeSource


@dataclass(frozen=True, slots=True, kw_only=True)
class MessageInfo:
    """One kind of message from one component."""

    system_id: int
    component_id: int
    message_id: int
    name: str
    count: int
    rate_hz: float
    """Rate over the span from its first to its last, Hz; 0 for a single one or a file without times."""
    known: bool
    """False: not in the dialect, so neither its contents nor its sender are to be trusted."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SystemInfo:
    """One sender, from known messages only."""

    system_id: int
    count: int
    first_us: int
    last_us: int
    lost: int
    """Packets missing by sequence number. A log that was filtered, or recorded from several links, shows more."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TlogInfo:
    """A log at a glance."""

    first_us: int
    """Unix µs of the earliest record."""
    last_us: int
    time_source: TimeSource
    counts: TlogCounts
    systems: tuple[SystemInfo, ...]
    messages: tuple[MessageInfo, ...]
    """Counts by system, component and message id."""
    damage: tuple[Damage, ...]

    @property
    def span_s(self) -> float:
        """Duration from the earliest to the latest record, s; 0 in a file without times."""
        return 0.0 if self.time_source == "none" else (self.last_us - self.first_us) * 1e-6


def info(tlog: Tlog) -> TlogInfo:
    """Count a log's records by sender and message."""
    index = tlog.index
    return TlogInfo(
        first_us=int(index.t_us.min()),
        last_us=int(index.t_us.max()),
        time_source=index.time_source,
        counts=index.counts,
        systems=tuple(_system(tlog, int(system_id)) for system_id in np.unique(index.system_id[index.known])),
        messages=_messages(tlog),
        damage=index.damage,
    )


def _messages(tlog: Tlog) -> tuple[MessageInfo, ...]:
    index = tlog.index
    key = index.system_id.astype(np.int64) << 40 | index.component_id.astype(np.int64) << 32 | index.message_id
    key = key << 1 | index.known
    order = np.argsort(key, kind="stable")
    starts = np.flatnonzero(np.diff(key[order], prepend=-1))
    counts = np.diff(starts, append=order.size)
    t_us = index.t_us[order]
    first, last = np.minimum.reduceat(t_us, starts), np.maximum.reduceat(t_us, starts)
    timed = index.time_source != "none"
    return tuple(
        MessageInfo(
            system_id=int(k) >> 41,
            component_id=int(k) >> 33 & 0xFF,
            message_id=int(k) >> 1 & 0xFFFFFF,
            name=message_name(int(k) >> 1 & 0xFFFFFF),
            count=int(count),
            rate_hz=float((count - 1) * 1e6 / span_us) if timed and span_us > 0 else 0.0,
            known=bool(k & 1),
        )
        for k, count, span_us in zip(key[order][starts], counts, last - first, strict=True)
    )


def _system(tlog: Tlog, system_id: int) -> SystemInfo:
    index = tlog.index
    rows = np.flatnonzero((index.system_id == system_id) & index.known)
    lost = 0
    for component in np.unique(index.component_id[rows]):
        seq = index.seq[rows[index.component_id[rows] == component]].astype(np.int64)
        steps = np.diff(seq) % 256
        # half the circle or more back is a packet that was overtaken, not two hundred that were lost
        lost += int(np.sum(steps[(steps > 1) & (steps < 128)] - 1))
    return SystemInfo(
        system_id=system_id,
        count=rows.size,
        first_us=int(index.t_us[rows].min()),
        last_us=int(index.t_us[rows].max()),
        lost=lost,
    )
