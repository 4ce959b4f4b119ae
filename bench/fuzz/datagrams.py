"""Hostile datagrams through the whole live path: split, decode, the fleet's state.

Half of them carry frames with right checksums and wild contents, so that what lies behind the checksum is tried too.
"""

from __future__ import annotations

import random
import time
from collections import Counter, deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega

from bench.fuzz.frames import FuzzScore, frame_pool
from mavlink.fleet.fleet import Fleet
from mavlink.protocol.decode import decode
from mavlink.protocol.dialect import DEFINITIONS
from mavlink.protocol.framing import Framer, checksum, split
from mavlink.protocol.packet import Packet

BLOCK = 10_000
"""Datagrams to one fleet."""
_T0_US = 1_790_000_000_000_000
_UAV, _UGVS = 1, (2, 3, 4, 5, 6)
_UNDERSTOOD = (0, 2, 24, 30, 31, 33, 109, 111, 148, 158, 166, 253, 259, 260, 265, 269, 271, 285)
_WORDS = (
    *(b"\0\0\0\0", b"\xff\xff\xff\xff", b"\xff\xff\xff\x7f", b"\0\0\0\x80"),
    *(b"\0\0\xc0\x7f", b"\0\0\x80\x7f", b"[/]\x1b"),
)


@dataclass(slots=True, kw_only=True)
class DatagramScore(FuzzScore):
    """Sums over datagrams."""

    datagrams: int = 0
    frames: int = 0
    notices: int = 0
    slowest_ms: float = 0.0


def _wild_payload(size: int, rng: random.Random) -> bytes:
    if rng.random() < 0.5:
        return rng.randbytes(size)
    return b"".join(rng.choice(_WORDS) for _ in range(size // 4 + 1))[:size]


def wild_frame(rng: random.Random) -> bytes:
    """A frame that every checksum lets through, with any contents."""
    message_id = rng.choice(_UNDERSTOOD) if rng.random() < 0.8 else rng.choice(tuple(DEFINITIONS))
    longest, extra = DEFINITIONS[message_id]
    payload = _wild_payload(rng.choice((longest, longest, rng.randrange(longest + 1))), rng)
    sender = bytes([rng.randrange(256), rng.choice((_UAV, *_UGVS, rng.randrange(256))), rng.choice((0, 1, 100, 154))])
    if message_id < 256 and rng.random() < 0.3:
        frame = bytes([0xFE, len(payload)]) + sender + bytes([message_id]) + payload
        return frame + checksum(frame, extra).to_bytes(2, "little")
    signed = rng.random() < 0.1
    frame = (
        bytes([0xFD, len(payload), signed, rng.randrange(256)]) + sender + message_id.to_bytes(3, "little") + payload
    )
    return frame + checksum(frame, extra).to_bytes(2, "little") + (rng.randbytes(13) if signed else b"")


def draw_datagram(rng: random.Random) -> bytes:
    """One or several frames, damaged or not, or noise."""
    kind = rng.randrange(8)
    if kind == 0:
        return rng.randbytes(rng.randrange(1, 300))
    source = frame_pool()
    frames = [rng.choice(source) if rng.random() < 0.3 else wild_frame(rng) for _ in range(rng.choice((1, 1, 1, 2, 8)))]
    data = bytearray(b"".join(frames))
    if kind < 4:
        for _ in range(rng.randrange(1, 4)):
            data[rng.randrange(len(data))] ^= rng.randrange(1, 256)
    elif kind == 4:
        data = data[: rng.randrange(len(data)) + 1]
    elif kind == 5:
        at = rng.randrange(len(data))
        data[at:at] = rng.choice((rng.randbytes(rng.randrange(1, 30)), b"\xfd\xff\x00", b"\xfe" * 20, b"\xfd\x00" * 10))
    return bytes(data)


class Listener:
    """The live path from a datagram to the fleet's state."""

    def __init__(self) -> None:
        self.fleet = Fleet(_UAV, _UGVS)
        self.t_us = _T0_US
        self.taken = 0

    def receive(self, data: bytes, step_us: int = 500) -> tuple[int, int]:
        """Receive a datagram ``step_us`` after the last one; counts of its frames and of the notices they cause."""
        self.t_us += step_us
        self.taken += 1
        frames, _ = split(data)
        notices = 0
        for raw in frames:
            packet = Packet(self.t_us, raw)
            if packet.message_id in DEFINITIONS:
                decode(packet)
            notices += len(self.fleet.add_packet(packet))
        if self.taken % 50 == 0:
            self.fleet.at(self.t_us)
        return len(frames), notices


def fuzz_datagrams(seed: int, count: int = BLOCK) -> DatagramScore:
    """One block of datagrams to one fleet; the same for the same seed."""
    rng = random.Random(seed)
    listener, score = Listener(), DatagramScore()
    recent: deque[bytes] = deque(maxlen=3)
    for i in range(count):
        data = draw_datagram(rng)
        recent.append(data)
        step_us = rng.choice((500, 500, 500, 0, 2_000_000, -3_000_000)) if i % 20 == 0 else 500
        start = time.process_time()
        try:
            frames, notices = listener.receive(data, step_us)
        except Exception as error:  # noqa: BLE001  (that there is none is what is being measured)
            score.failures.append(f"{seed}/{i}: {error!r}: {data.hex()}")
            frames = notices = 0
        score.slowest_ms = max(score.slowest_ms, (time.process_time() - start) * 1e3)
        score.datagrams += 1
        score.frames += frames
        score.notices += notices
    return score


HEADER = ("magic", "length", "incompat", "compat", "seq", "system", "component", "id low", "id mid", "id high")
_SHARE = 10  # one frame in ten is hit
_CHUNK = 333

Part = tuple[bytes, bool]
"""Bytes, and whether they are an undamaged frame."""


Damage = Callable[[bytes, random.Random], list[Part]]
"""Parts of a stream that stand there instead of a frame, by the frame and a source of chance."""


def _hit(damage: Damage, share: int = _SHARE, first: int = 3) -> Callable[[Sequence[bytes], random.Random], list[Part]]:
    """One frame in so many is hit, from the first on; the others are whole."""

    def parts(frames: Sequence[bytes], rng: random.Random) -> list[Part]:
        return [
            part
            for i, frame in enumerate(frames)
            for part in (damage(frame, rng) if i % share == first else [(frame, True)])
        ]

    return parts


def _flipped(at: int) -> Damage:
    def flip(frame: bytes, rng: random.Random) -> list[Part]:
        hurt = bytearray(frame)
        hurt[at] ^= rng.randrange(1, 256)
        return [(bytes(hurt), False)]

    return flip


def _between(make: Callable[[random.Random], bytes]) -> Damage:
    return lambda frame, rng: [(make(rng), False), (frame, True)]


def _half(frame: bytes, rng: random.Random) -> list[Part]:
    return [(frame[: rng.randrange(1, len(frame))], False)]


_DAMAGES: dict[str, Damage] = {
    **{f"flipped {name}": _flipped(at) for at, name in enumerate(HEADER)},
    "flipped payload": _flipped(11),
    "flipped checksum": _flipped(-1),
    **{f"{n} B of noise between": _between(lambda rng, n=n: rng.randbytes(n)) for n in (1, 7, 64, 300)},  # type: ignore[misc]
    "FD FF 00 between": _between(lambda rng: b"\xfd\xff\x00"),
    "FD FF 01 between": _between(lambda rng: b"\xfd\xff\x01"),
    "FE FF between": _between(lambda rng: b"\xfe\xff"),
}
INPUTS = {name: _hit(damage) for name, damage in _DAMAGES.items()} | {
    "half a frame, then others": _hit(_half, 40, 0),
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
    """Numbers of undamaged frames that a parser loses, and of frames it finds that were never sent."""
    sent = Counter(data for data, whole in parts if whole)
    got = Counter(read(b"".join(data for data, _ in parts)))
    return (sent - got).total(), (got - sent).total()
