"""The newest timestamp of every signed stream, and whether a frame was made now.

A stream is (system, component, link id); the table is common to all links, or a frame of one could be replayed over
another. Times are ticks of 10 µs since 2015-01-01 UTC (https://mavlink.io/en/guide/message_signing.html).

A timestamp newer than the last of its stream proves that a frame was made after that one, not that it was made now: an
autopilot's counter may stop for hours while it drives. So a frame is accepted when it is newer, and when
something that its signature covers, or that was received before, proves that it is no older than :data:`BEHIND`:

- its timestamp, where the sender keeps to the time of day;
- the stream was received that recently;
- the time of day in its SYSTEM_TIME;
- its time since boot, compared with that of an earlier frame.

Without any of these it is held: not used, until a later frame is proven or an operator accepts the stream.
"""

from __future__ import annotations

import struct
from collections.abc import Collection, Iterator
from typing import NamedTuple, Protocol

from pymavlink.dialects.v20.ardupilotmega import MAVLINK_MSG_ID_SYSTEM_TIME

from mavlink.protocol.packet import BOOT_MS_AT, Auth

EPOCH_US = 1_420_070_400_000_000
"""2015-01-01 UTC, Unix µs."""
SECOND = 100_000
"""Ticks."""
AHEAD = 605 * SECOND
"""A timestamp further ahead of this computer's clock is rejected. ArduPilot adds a minute at every start (59.95 s
measured): ten starts in a row; five seconds more are for a computer's clock that is slow. A vehicle whose clock was
wrong by less than this is accepted again after as long at most."""
BEHIND = 60 * SECOND
"""A frame older than this is not accepted: what the specification allows for a new stream."""
MAX_STREAMS = 16_384
"""Streams remembered, of all systems: 64 for each."""
_MAX_HELD = 1024
"""Streams remembered that are held."""
_MILLISECOND = 100
"""Ticks."""
_UINT32, _UINT64 = struct.Struct("<I"), struct.Struct("<Q")
_WRAP_MS = 1 << 32
"""Milliseconds after which a time since boot wraps."""


def ticks_of(t_us: int) -> int:
    """Unix µs as ticks."""
    return (t_us - EPOCH_US) // 10


class StreamRow(NamedTuple):
    """One stream."""

    system_id: int
    component_id: int
    link_id: int
    timestamp: int
    """Timestamp of its newest frame."""
    received: int
    """Time at which that came; 0 unknown."""
    booted: int = 0
    """Start of its sender, by this computer's clock; 0 unknown."""


class StreamRecorder(Protocol):
    """Keeps every change of the table at once."""

    @property
    def newest(self) -> memoryview:
        """(:data:`MAX_STREAMS`,) uint64: the newest timestamp at each place, written with every frame."""

    def put(self, place: int, stream: int, timestamp: int, received: int, booted: int) -> None:
        """Replace what is at a place, 0 .. :data:`MAX_STREAMS` − 1: for a new stream, and once a second.

        Args:
            place: where.
            stream: system id << 16 | component id << 8 | link id.
            timestamp: as in :class:`StreamRow`, as the next two.
        """


class _StreamState:
    """Newest packet of one stream."""

    __slots__ = ("booted", "learned", "not_before", "noted", "place", "received", "timestamp")

    def __init__(self, place: int) -> None:
        self.place = place
        self.timestamp = self.received = self.booted = 0
        self.not_before = 0
        self.learned = self.noted = 0
        """Times at which its start was learnt, and its row was written to the journal."""


class Streams:
    """The table of streams. Only verified frames get in; a system that fills it pushes out streams of its own.

    Args:
        accept: systems whose frames are accepted without a proof that they are made now.
    """

    def __init__(self, accept: Collection[int] = ()) -> None:
        self._of: list[dict[int, _StreamState]] = [{} for _ in range(256)]  # by system, then component << 8 | link id
        self._held: dict[tuple[int, int], int] = {}  # the same as one key: timestamp of the newest frame held
        self._count = 0
        self.accept = frozenset(accept)
        self.journal: StreamRecorder | None = None
        """Gets every change, None for none."""
        self._newest = memoryview(b"")
        self.births = 0
        """Streams ever added, to notice a new one."""
        self.proven = 0
        """A time that has certainly passed: the newest accepted timestamp less what senders may be ahead."""

    def __len__(self) -> int:
        return self._count

    def newest(self, system_id: int, component_id: int, link_id: int) -> int | None:
        """The last timestamp of a stream, None for a new one."""
        known = self._of[system_id].get(component_id << 8 | link_id)
        return known.timestamp if known else None

    def admit(
        self, system_id: int, component_id: int, link_id: int, timestamp: int, now: int, frame: bytes = b""
    ) -> Auth:
        """Tell whether a verified frame is accepted; if so, its timestamp is kept.

        Args:
            now: ticks when it came.
            frame: the frame itself, for the times in it.

        Returns:
            ``GOOD``; ``REPLAYED``: not newer than the last of its stream; ``HELD``: nothing proves that it is made now.
        """
        streams, stream = self._of[system_id], component_id << 8 | link_id
        known = streams.get(stream)
        if known is not None and timestamp <= known.timestamp:
            return Auth.REPLAYED
        if known is None or not -BEHIND <= now - known.received <= BEHIND:
            if not (system_id in self.accept or _made_now(known, timestamp, now, frame)):
                self._hold(system_id, stream, timestamp)
                return Auth.HELD
            if known is None:
                known = self._add(system_id, stream)
            known.not_before = 0
        if self._held:
            self._held.pop((system_id, stream), None)
        known.timestamp, known.received = timestamp, now
        if now - known.learned >= SECOND and frame and frame[7] in BOOT_MS_AT and (boot := times_in(frame)[1]) >= 0:
            known.booted, known.learned = now - boot, now
        if self.journal is not None:
            if now - known.noted < SECOND:
                self._newest[known.place] = timestamp
            else:
                self._keep(system_id, stream, known)
        if timestamp > self.proven + AHEAD:
            self.proven = timestamp - AHEAD
        return Auth.GOOD

    def accept_held(self, system_id: int, now: int) -> int:
        """Accept the held streams of a system, on an operator's order: newer frames of them are used from now on.

        Returns:
            How many streams that were.
        """
        found = [(key, timestamp) for key, timestamp in self._held.items() if key[0] == system_id]
        for key, timestamp in found:
            del self._held[key]
            known = self._of[system_id].get(key[1]) or self._add(*key)
            known.timestamp, known.received, known.not_before = max(timestamp, known.timestamp), now, 0
            self._keep(*key, known)
        return len(found)

    def restore(self, row: StreamRow, *, not_before: int = 0) -> None:
        """Restore the row of a stream.

        Args:
            not_before: frames made before this may have been received after the row was saved.
        """
        stream = row.component_id << 8 | row.link_id
        known = self._of[row.system_id].get(stream) or self._add(row.system_id, stream)
        known.timestamp, known.booted, known.not_before = row.timestamp, row.booted, not_before
        known.received = 0 if not_before else row.received
        self._keep(row.system_id, stream, known)

    def rows(self) -> Iterator[StreamRow]:
        """Every stream; another thread may add streams meanwhile."""
        for system_id, streams in enumerate(self._of):
            for stream, known in streams.copy().items():  # copied in one step
                yield StreamRow(system_id, stream >> 8, stream & 0xFF, known.timestamp, known.received, known.booted)

    def write_to(self, journal: StreamRecorder) -> None:
        """Write all streams to a journal, and from now on every change."""
        self.journal, self._newest = journal, journal.newest
        for system_id, streams in enumerate(self._of):
            for stream, known in streams.items():
                self._keep(system_id, stream, known)

    def _keep(self, system_id: int, stream: int, known: _StreamState) -> None:
        if self.journal is not None:
            known.noted = known.received
            self.journal.put(known.place, system_id << 16 | stream, known.timestamp, known.received, known.booted)

    def _hold(self, system_id: int, stream: int, timestamp: int) -> None:
        key = system_id, stream
        if key not in self._held and len(self._held) >= _MAX_HELD:
            del self._held[next(iter(self._held))]
        self._held[key] = max(timestamp, self._held.get(key, 0))

    def _add(self, system_id: int, stream: int) -> _StreamState:
        """Add a stream, in place of one of the largest system where the table is full."""
        if self._count >= MAX_STREAMS:
            largest = max(self._of, key=len)
            place = largest.pop(next(iter(largest))).place
            if self.journal is not None:
                self._newest[place] = 0
        else:
            place, self._count = self._count, self._count + 1
        self.births += 1
        known = self._of[system_id][stream] = _StreamState(place)
        return known


def times_in(frame: bytes) -> tuple[int, int]:
    """Times in a MAVLink 2 frame: ticks of the time of day, 0 unknown, and since boot, −1 unknown."""
    message_id = int.from_bytes(frame[7:10], "little")
    at = BOOT_MS_AT.get(message_id)
    if at is None:
        return 0, -1
    payload = frame[10 : 10 + frame[1]].ljust(12, b"\0")
    unix_us = _UINT64.unpack_from(payload)[0] if message_id == MAVLINK_MSG_ID_SYSTEM_TIME else 0
    return max(ticks_of(unix_us), 0), _UINT32.unpack_from(payload, at)[0] * _MILLISECOND


def _made_now(known: _StreamState | None, timestamp: int, now: int, frame: bytes) -> bool:
    """Tell whether one of a frame's own times proves that it was made in the last minute, not before it could be."""
    unix, boot = times_in(frame) if frame else (0, -1)
    since = max(now - BEHIND, known.not_before) if known else now - BEHIND
    if timestamp >= since or since <= unix <= now + BEHIND:
        return True
    if known is None or not known.booted or boot < 0:
        return False
    # since then its clock has advanced by as much as ours, but for its drift
    ran = now - known.booted
    made = now - (ran - boot) % (_WRAP_MS * _MILLISECOND)
    return made >= since or (boot - ran) % (_WRAP_MS * _MILLISECOND) <= BEHIND
