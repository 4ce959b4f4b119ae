"""Framing: finds MAVLink 1 and 2 frames in bytes, and never loses a good one beside a bad one.

A frame is good when its message id is known, its payload is no longer than defined and its checksum is right (X.25 CRC,
seeded with the definition's CRC extra). A bad frame costs one byte: the search continues at the byte after its magic,
because a damaged length must not swallow what follows. A frame with an unknown id cannot be trusted; it is kept for the
record only when some CRC extra makes its checksum right (:mod:`mavlink.protocol.crc`), where it fits in: directly after
a good frame, at the start, or directly before a good frame, and only when no good frame begins inside it.

Format: https://mavlink.io/en/guide/serialization.html
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import Enum, IntEnum

from fastcrc import crc16

from mavlink.protocol.crc import extra_for
from mavlink.protocol.dialect import DEFINITIONS
from mavlink.protocol.packet import MAGIC_V2

SIGNATURE_LENGTH = 13
_MAGIC = re.compile(rb"[\xfd\xfe]")
_mcrf4xx = crc16.mcrf4xx
_EXTRA = tuple(bytes([extra]) for extra in range(256))


@dataclass(frozen=True, slots=True)
class FrameCounts:
    """Counts of what was found in some bytes."""

    good: int = 0
    """Frames of known messages with the right checksum."""
    bad: int = 0
    """Frames of known messages with a wrong checksum."""
    junk_bytes: int = 0
    """Bytes outside of every frame kept: text, noise, damaged frames."""
    unknown: int = 0
    """Frames of unknown messages, recorded and never used."""

    def __add__(self, other: FrameCounts) -> FrameCounts:
        """Counts of both."""
        return FrameCounts(
            self.good + other.good,
            self.bad + other.bad,
            self.junk_bytes + other.junk_bytes,
            self.unknown + other.unknown,
        )


_ONE_GOOD = FrameCounts(good=1)


class _FrameMatch(IntEnum):
    NOTHING = 0
    GOOD = 1
    BAD = 2
    UNKNOWN = 3
    MORE = 4


_NOTHING, _GOOD, _BAD, _UNKNOWN, _MORE = _FrameMatch


class _Wait(Enum):
    """The unfinished frames to wait for."""

    FOR_ALL = "all"
    FOR_LAST = "those that no good frame follows"
    FOR_NONE = "none"


def checksum(frame: bytes, extra: int) -> int:
    """X.25 CRC of an unsigned or signed frame's header and payload, with the definition's CRC extra at the end."""
    covered = (10 if frame[0] == MAGIC_V2 else 6) + frame[1]
    return int(_mcrf4xx(frame[1:covered] + _EXTRA[extra]))


def _match_frame(data: bytes, pos: int) -> tuple[_FrameMatch, int]:
    """Kind of what begins at a magic byte, and its length (0 for nothing)."""
    left = len(data) - pos
    v2 = data[pos] == MAGIC_V2
    header = 10 if v2 else 6
    if v2 and left > 2 and data[pos + 2] > 1:
        return _NOTHING, 0  # an unknown incompatibility flag
    if left < header:
        return _MORE, 0
    payload = data[pos + 1]
    if v2:
        length = payload + 12 + (SIGNATURE_LENGTH if data[pos + 2] else 0)
        definition = DEFINITIONS.get(data[pos + 7] | data[pos + 8] << 8 | data[pos + 9] << 16)
    else:
        length = payload + 8
        definition = DEFINITIONS.get(data[pos + 5])
    if definition is not None and payload > definition[0]:
        return _NOTHING, 0
    if left < length:
        return _MORE, 0
    end = pos + header + payload
    sent = data[end] | data[end + 1] << 8
    if definition is None:
        return (_UNKNOWN, length) if extra_for(_mcrf4xx(data[pos + 1 : end]), sent) >= 0 else (_NOTHING, 0)
    return (_GOOD if _mcrf4xx(data[pos + 1 : end] + _EXTRA[definition[1]]) == sent else _BAD), length


def _holds_good(data: bytes, start: int, stop: int) -> _FrameMatch:
    """Tell whether a good frame begins in [start, stop): GOOD, MORE (not known yet) or NOTHING."""
    found = _NOTHING
    for match in _MAGIC.finditer(data, start, stop):
        verdict, _ = _match_frame(data, match.start())
        if verdict is _GOOD:
            return _GOOD
        if verdict is _MORE:
            found = _MORE
    return found


def _hides(data: bytes, pos: int) -> bool:
    """Tell whether a good frame follows the magic byte of an unfinished one."""
    return _holds_good(data, pos + 1, len(data)) is _GOOD


def _cut_in_signature(data: bytes, pos: int, length: int) -> bool:
    """Tell whether a good frame begins in a signed frame's signature, which no checksum covers."""
    end = pos + length
    signed = data[pos] == MAGIC_V2 and data[pos + 2]
    return bool(signed) and _holds_good(data, end - SIGNATURE_LENGTH, end) is _GOOD


def _fits(data: bytes, pos: int, length: int, in_step: bool, final: bool) -> _FrameMatch:
    """Tell whether an unknown frame is to be kept: UNKNOWN (keep), MORE (wait) or NOTHING."""
    inside = _holds_good(data, pos + 1, pos + length)
    if inside is _GOOD:
        return _NOTHING
    if inside is _MORE and not final:
        return _MORE
    if in_step:
        return _UNKNOWN
    end = pos + length
    after = _match_frame(data, end)[0] if _MAGIC.match(data, end) else _NOTHING
    return _UNKNOWN if after is _GOOD else _NOTHING


def _scan(data: bytes, wait: _Wait, in_step: bool) -> tuple[list[bytes], int, FrameCounts, bool]:
    """Frames, the position up to which the data is used up, counts, and whether the last byte used ended a frame."""
    frames: list[bytes] = []
    good = bad = junk = unknown = pos = bad_until = 0
    size = len(data)
    while pos < size:
        match = _MAGIC.search(data, pos)
        start = match.start() if match else size
        if start > pos:
            junk, pos, in_step = junk + start - pos, start, False
            continue
        verdict, length = _match_frame(data, pos)
        if verdict is _GOOD and _cut_in_signature(data, pos, length):
            verdict = _BAD
        elif verdict is _UNKNOWN:
            verdict = _fits(data, pos, length, in_step, wait is not _Wait.FOR_ALL)
        if verdict is _GOOD or verdict is _UNKNOWN:
            frames.append(data[pos : pos + length])
            good, unknown = (good + 1, unknown) if verdict is _GOOD else (good, unknown + 1)
            pos, in_step = pos + length, True
            continue
        if verdict is _MORE and (wait is _Wait.FOR_ALL or (wait is _Wait.FOR_LAST and not _hides(data, pos))):
            break
        if verdict is _BAD and pos >= bad_until:
            bad, bad_until = bad + 1, pos + length
        junk, pos, in_step = junk + 1, pos + 1, False
    return frames, pos, FrameCounts(good, bad, junk, unknown), in_step


def split(data: bytes) -> tuple[list[bytes], FrameCounts]:
    """Frames of one datagram. Nothing is kept: a frame cut off at the end is junk.

    Args:
        data: one datagram, with any number of frames and anything around them.

    Returns:
        The frames in order, good ones and those of unknown messages, and the counts.
    """
    magic = _MAGIC.search(data)
    if magic is None:
        return [], FrameCounts(junk_bytes=len(data))
    if magic.start() == 0:  # nearly always; most hold exactly one good frame, and a flood of bad ones must be cheap too
        verdict, length = _match_frame(data, 0)
        if verdict is _GOOD and length == len(data):
            return [data], _ONE_GOOD
        if verdict is not _GOOD and verdict is not _UNKNOWN and _MAGIC.search(data, 1) is None:
            return [], FrameCounts(bad=verdict is _BAD, junk_bytes=len(data))
    frames, _, counts, _ = _scan(data, _Wait.FOR_NONE, in_step=True)
    return frames, counts


class Framer:
    """Frames of one byte stream (a TCP connection, a serial port), fed in pieces of any size."""

    def __init__(self) -> None:
        self.counts = FrameCounts()
        self._rest = b""
        self._in_step = True

    @property
    def waiting(self) -> int:
        """Bytes that wait for the rest of the frame that they seem to begin."""
        return len(self._rest)

    def receive_bytes(self, data: bytes) -> list[bytes]:
        """Add the next bytes and return the frames that they complete, in order."""
        return self._scan(self._rest + data, _Wait.FOR_ALL)

    def skip_unfinished(self) -> list[bytes]:
        """Give up an unfinished frame and return the good ones that follow it: three bytes of noise may claim 280.

        As long as no good frame follows, it may still be finished.
        """
        return self._scan(self._rest, _Wait.FOR_LAST)

    def finish(self) -> list[bytes]:
        """End the stream and return the frames behind an unfinished one."""
        return self._scan(self._rest, _Wait.FOR_NONE)

    def _scan(self, data: bytes, wait: _Wait) -> list[bytes]:
        frames, used, counts, self._in_step = _scan(data, wait, self._in_step)
        self._rest = data[used:]
        self.counts = self.counts + counts
        return frames
