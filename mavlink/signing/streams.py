"""What is remembered of every signed stream, and whether a frame of it was made now.

A stream is (system, component, link id); the table is common to all links, or a frame of one could be replayed on
another. Times are ticks of 10 µs since 2015-01-01 UTC (https://mavlink.io/en/guide/message_signing.html).

A timestamp newer than the last of its stream says that a frame was made after that one, not that it was made now: an
autopilot's counter may stand still for hours while it drives. So a frame is believed when it is newer, and when
something that its signature covers, or that was heard before, proves that it is no older than :data:`BEHIND`:

- its timestamp, where the sender keeps to the time of day;
- the stream was heard so lately;
- the time of day in its SYSTEM_TIME;
- its time since boot, beside that of a frame heard before.

Without any of these it is held: not believed, until the stream proves itself or an operator accepts it.
"""

from __future__ import annotations

import struct
from collections.abc import Collection, Iterator
from typing import NamedTuple, Protocol

from mavlink.protocol.packet import Auth

__all__ = ["AHEAD", "BEHIND", "EPOCH_US", "MOST_STREAMS", "SECOND", "Journal", "Row", "Streams", "ticks_of", "times_in"]

EPOCH_US = 1_420_070_400_000_000
"""2015-01-01 UTC, Unix µs."""
SECOND = 100_000
"""Ticks."""
AHEAD = 605 * SECOND
"""A timestamp further ahead of this computer's clock is refused. ArduPilot adds a minute at every start (59.95 s
measured): ten starts in a row; five seconds more are for a computer's clock that is slow. A vehicle whose clock was
wrong by less than this is heard again after as long at most."""
BEHIND = 60 * SECOND
"""A frame older than this is not believed: as much as specified for a stream never heard before."""
MOST_STREAMS = 16_384
_MOST_HELD = 1024
_MILLISECOND = 100
_BOOT_AT = {2: 8, 30: 0, 31: 0, 32: 0, 33: 0}
"""Where messages that vehicles send all the time carry their time since boot (uint32, ms), by message id."""
_SYSTEM_TIME = 2
_UINT32, _UINT64 = struct.Struct("<I"), struct.Struct("<Q")
_ROUND = 1 << 32
"""Milliseconds after which a time since boot begins anew."""


def ticks_of(t_us: int) -> int:
    """Unix µs as ticks."""
    return (t_us - EPOCH_US) // 10


class Row(NamedTuple):
    """One stream."""

    system_id: int
    component_id: int
    link_id: int
    timestamp: int
    """Of its newest frame."""
    heard: int
    """When that came; 0: nobody knows."""
    booted: int = 0
    """When its sender started by this computer's clock; 0 unknown."""


class Journal(Protocol):
    """Is told of every change of the table at once."""

    @property
    def newest(self) -> memoryview:
        """(:data:`MOST_STREAMS`,) uint64: the newest timestamp at each place, written to with every frame."""

    def put(self, place: int, stream: int, timestamp: int, heard: int, booted: int) -> None:
        """Replace what is at a place, 0 .. :data:`MOST_STREAMS` − 1: for a new stream, and once a second.

        Args:
            place: where.
            stream: system id << 16 | component id << 8 | link id.
            timestamp: as in :class:`Row`, as the next two.
            heard: likewise.
            booted: likewise.
        """


class _Stream:
    """The newest of one stream."""

    __slots__ = ("booted", "heard", "learned", "not_before", "noted", "place", "timestamp")

    def __init__(self, place: int) -> None:
        self.place = place
        self.timestamp = self.heard = self.booted = 0
        self.not_before = 0
        self.learned = self.noted = 0
        """When the time of its start was learnt, and when it was put into the journal."""


class Streams:
    """The table of streams. Only who has a key gets in; who fills it up throws out streams of its own.

    Args:
        accept: systems that are believed without a proof that their frames are made now.
    """

    def __init__(self, accept: Collection[int] = ()) -> None:
        self._of: list[dict[int, _Stream]] = [{} for _ in range(256)]  # by system, then component << 8 | link id
        self._held: dict[tuple[int, int], int] = {}  # the same as one key: timestamp of the newest frame held
        self._count = 0
        self.accept = frozenset(accept)
        self.journal: Journal | None = None
        """Told of every change, until it is taken away."""
        self._newest = memoryview(b"")
        self.births = 0
        """Streams ever added."""
        self.proven = 0
        """It was later than this when the newest accepted frame came: its timestamp less what senders may be ahead."""

    def __len__(self) -> int:
        return self._count

    def newest(self, system_id: int, component_id: int, link_id: int) -> int | None:
        """The last timestamp of a stream, None for one never heard."""
        known = self._of[system_id].get(component_id << 8 | link_id)
        return known.timestamp if known else None

    def admit(
        self, system_id: int, component_id: int, link_id: int, timestamp: int, now: int, frame: bytes = b""
    ) -> Auth:
        """Whether a verified frame is believed; if so, its timestamp is kept.

        Args:
            system_id: of its stream, as the next two.
            component_id: likewise.
            link_id: likewise.
            timestamp: of its signature.
            now: when it came.
            frame: the frame itself, for the times in it.

        Returns:
            ``GOOD``; ``REPLAYED``: not newer than the last of its stream; ``HELD``: nothing proves that it is made now.
        """
        streams, stream = self._of[system_id], component_id << 8 | link_id
        known = streams.get(stream)
        if known is not None and timestamp <= known.timestamp:
            return Auth.REPLAYED
        if known is None or not -BEHIND <= now - known.heard <= BEHIND:
            if not (system_id in self.accept or _made_now(known, timestamp, now, frame)):
                self._hold(system_id, stream, timestamp)
                return Auth.HELD
            if known is None:
                known = self._add(system_id, stream)
            known.not_before = 0
        if self._held:
            self._held.pop((system_id, stream), None)
        known.timestamp, known.heard = timestamp, now
        if now - known.learned >= SECOND and frame and frame[7] in _BOOT_AT and (boot := times_in(frame)[1]) >= 0:
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
        """An operator vouches for what is held of a system: what comes after it is believed.

        Returns:
            How many streams that were.
        """
        found = [(key, timestamp) for key, timestamp in self._held.items() if key[0] == system_id]
        for key, timestamp in found:
            del self._held[key]
            known = self._of[system_id].get(key[1]) or self._add(*key)
            known.timestamp, known.heard, known.not_before = max(timestamp, known.timestamp), now, 0
            self._keep(*key, known)
        return len(found)

    def restore(self, row: Row, *, not_before: int = 0) -> None:
        """Puts back what was remembered of a stream.

        Args:
            row: the stream.
            not_before: frames made before this may have been heard after the row was kept.
        """
        stream = row.component_id << 8 | row.link_id
        known = self._of[row.system_id].get(stream) or self._add(row.system_id, stream)
        known.timestamp, known.booted, known.not_before = row.timestamp, row.booted, not_before
        known.heard = 0 if not_before else row.heard
        self._keep(row.system_id, stream, known)

    def rows(self) -> Iterator[Row]:
        """Every stream; another thread may go on adding."""
        for system_id, streams in enumerate(self._of):
            for stream, known in streams.copy().items():  # copied in one step
                yield Row(system_id, stream >> 8, stream & 0xFF, known.timestamp, known.heard, known.booted)

    def write_to(self, journal: Journal) -> None:
        """Gives a journal all streams, and from now on every change."""
        self.journal, self._newest = journal, journal.newest
        for system_id, streams in enumerate(self._of):
            for stream, known in streams.items():
                self._keep(system_id, stream, known)

    def _keep(self, system_id: int, stream: int, known: _Stream) -> None:
        if self.journal is not None:
            known.noted = known.heard
            self.journal.put(known.place, system_id << 16 | stream, known.timestamp, known.heard, known.booted)

    def _hold(self, system_id: int, stream: int, timestamp: int) -> None:
        key = system_id, stream
        if key not in self._held and len(self._held) >= _MOST_HELD:
            del self._held[next(iter(self._held))]
        self._held[key] = max(timestamp, self._held.get(key, 0))

    def _add(self, system_id: int, stream: int) -> _Stream:
        """One more, for which room is made."""
        if self._count >= MOST_STREAMS:
            crowd = max(self._of, key=len)
            place = crowd.pop(next(iter(crowd))).place
            if self.journal is not None:
                self._newest[place] = 0
        else:
            place, self._count = self._count, self._count + 1
        self.births += 1
        known = self._of[system_id][stream] = _Stream(place)
        return known


def times_in(frame: bytes) -> tuple[int, int]:
    """When a MAVLink 2 frame was made: ticks of the time of day, 0 unknown, and since boot, −1 unknown."""
    message_id = int.from_bytes(frame[7:10], "little")
    at = _BOOT_AT.get(message_id)
    if at is None:
        return 0, -1
    payload = frame[10 : 10 + frame[1]].ljust(12, b"\0")
    unix_us = _UINT64.unpack_from(payload)[0] if message_id == _SYSTEM_TIME else 0
    return max(ticks_of(unix_us), 0), _UINT32.unpack_from(payload, at)[0] * _MILLISECOND


def _made_now(known: _Stream | None, timestamp: int, now: int, frame: bytes) -> bool:
    """Whether one of a frame's own times proves that it was made in the last minute, and not before it could be."""
    unix, boot = times_in(frame) if frame else (0, -1)
    since = max(now - BEHIND, known.not_before) if known else now - BEHIND
    if timestamp >= since or since <= unix <= now + BEHIND:
        return True
    if known is None or not known.booted or boot < 0:
        return False
    # since then its clock has gone on by as much as ours, but for what it loses or gains
    ran = now - known.booted
    made = now - (ran - boot) % (_ROUND * _MILLISECOND)
    return made >= since or (boot - ran) % (_ROUND * _MILLISECOND) <= BEHIND
