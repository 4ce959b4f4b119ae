"""Byte streams (TCP, serial) with damage: how many undamaged frames a parser loses."""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega

from mavlink.protocol.framing import Framer

HEADER = ("magic", "length", "incompat", "compat", "seq", "system", "component", "id low", "id mid", "id high")
_SHARE = 10  # one frame in ten is hit
_CHUNK = 333

Part = tuple[bytes, bool]
"""Bytes, and whether they are an undamaged frame."""


def _flipped(at: int) -> Callable[[Sequence[bytes], random.Random], list[Part]]:
    def parts(frames: Sequence[bytes], rng: random.Random) -> list[Part]:
        made: list[Part] = []
        for i, frame in enumerate(frames):
            if i % _SHARE == 3:
                hurt = bytearray(frame)
                hurt[at if at >= 0 else len(frame) + at] ^= rng.randrange(1, 256)
                made.append((bytes(hurt), False))
            else:
                made.append((frame, True))
        return made

    return parts


def _between(make: Callable[[random.Random], bytes]) -> Callable[[Sequence[bytes], random.Random], list[Part]]:
    def parts(frames: Sequence[bytes], rng: random.Random) -> list[Part]:
        made: list[Part] = []
        for i, frame in enumerate(frames):
            if i % _SHARE == 3:
                made.append((make(rng), False))
            made.append((frame, True))
        return made

    return parts


def _half(frames: Sequence[bytes], rng: random.Random) -> list[Part]:
    return [
        (frame, True) if i % 40 else (frame[: rng.randrange(1, len(frame))], False) for i, frame in enumerate(frames)
    ]


INPUTS: dict[str, Callable[[Sequence[bytes], random.Random], list[Part]]] = {
    **{f"flipped {name}": _flipped(at) for at, name in enumerate(HEADER)},
    "flipped payload": _flipped(11),
    "flipped checksum": _flipped(-1),
    **{f"{n} B of noise between": _between(lambda rng, n=n: rng.randbytes(n)) for n in (1, 7, 64, 300)},  # type: ignore[misc]
    "FD FF 00 between": _between(lambda rng: b"\xfd\xff\x00"),
    "FD FF 01 between": _between(lambda rng: b"\xfd\xff\x01"),
    "FE FF between": _between(lambda rng: b"\xfe\xff"),
    "half a frame, then others": _half,
}


def _chunks(stream: bytes) -> Iterable[bytes]:
    return (stream[i : i + _CHUNK] for i in range(0, len(stream), _CHUNK))


def read_with_ours(stream: bytes) -> list[bytes]:
    """Frames that our parser finds."""
    framer = Framer()
    return [frame for chunk in _chunks(stream) for frame in framer.receive_bytes(chunk)] + framer.finish()


def read_with_pymavlink(stream: bytes) -> list[bytes]:
    """Frames that pymavlink's robust parser finds and names."""
    parser: Any = ardupilotmega.MAVLink(None)
    parser.robust_parsing = True
    messages = [m for chunk in _chunks(stream) for m in parser.parse_buffer(chunk) or []]
    named = [m for m in messages if m.get_type() != "BAD_DATA" and not m.get_type().startswith("UNKNOWN")]
    return [bytes(m.get_msgbuf()) for m in named]


def lost(parts: Sequence[Part], read: Callable[[bytes], list[bytes]]) -> tuple[int, int]:
    """How many undamaged frames a parser loses, and how many it finds that were never sent."""
    sent = Counter(data for data, whole in parts if whole)
    got = Counter(read(b"".join(data for data, _ in parts)))
    return (sent - got).total(), (got - sent).total()
