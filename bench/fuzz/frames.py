"""Frames to damage: MAVLink 1 and 2, signed, of unknown messages, and some that carry others."""

from __future__ import annotations

import random
from dataclasses import dataclass, field, fields
from functools import cache
from typing import Self

from pymavlink.dialects.v20 import ardupilotmega

from mavlink.protocol.encoder import COPTER, MavlinkEncoder
from mavlink.protocol.framing import checksum

UNKNOWN_ID, UNKNOWN_EXTRA = 60_001, 77
"""A message of a dialect that is not installed."""
TUNNEL_ID = ardupilotmega.MAVLINK_MSG_ID_TUNNEL


@dataclass(slots=True, kw_only=True)
class FuzzScore:
    """Sums over cases; of what is slowest or takes most the greatest."""

    failures: list[str] = field(default_factory=list)

    def add(self, other: Self) -> None:
        """Take in the sums of others."""
        for f in fields(self):
            mine, theirs = getattr(self, f.name), getattr(other, f.name)
            setattr(self, f.name, max(mine, theirs) if f.name in ("slowest_ms", "most_bytes") else mine + theirs)


def unknown_frame(seq: int, payload: bytes, message_id: int = UNKNOWN_ID, extra: int = UNKNOWN_EXTRA) -> bytes:
    """A whole frame of a message that the dialect lacks, right by a CRC extra that is unknown here."""
    frame = bytes([0xFD, len(payload), 0, 0, seq, 9, 1]) + message_id.to_bytes(3, "little") + payload
    return frame + checksum(frame, extra).to_bytes(2, "little")


def is_signed(frame: bytes) -> bool:
    """True if a signature is at its end."""
    return frame[0] == 0xFD and bool(frame[2] & 1)


def _known(speaker: MavlinkEncoder, i: int, rng: random.Random) -> bytes:
    boot_ms = 1000 + 20 * i
    kind = rng.randrange(8)
    if kind == 0:
        return speaker.heartbeat(COPTER)
    if kind == 1:
        return speaker.system_time(boot_ms, 1_790_000_000_000_000 + 1000 * boot_ms)
    if kind == 2:
        return speaker.statustext(f"Reached waypoint #{i}")
    if kind == 3:
        return speaker.gps_raw_int(boot_ms * 1000, -35.36, 149.16 + i * 1e-6, 584.0)
    if kind < 6:
        return speaker.attitude(boot_ms, rng.uniform(-1, 1), rng.uniform(-1, 1), rng.uniform(-3, 3))
    place = (-35.36 + i * 1e-6, 149.16, 584.0, 40.0)
    return speaker.global_position_int(boot_ms, *place, (rng.uniform(-9, 9), 2.0, 0.0), rng.uniform(0, 6.2))


@cache
def frame_pool(count: int = 4000, *, carried: bool = True) -> tuple[bytes, ...]:
    """Frames of six senders, one of them signing, one of MAVLink 1; always the same."""
    rng = random.Random(count)
    senders = [MavlinkEncoder(i) for i in range(1, 5)] + [
        MavlinkEncoder(5, version=1),
        MavlinkEncoder(6, key=b"k" * 32),
    ]
    tunnel = MavlinkEncoder(7)
    frames: list[bytes] = []
    for i in range(count):
        draw = rng.random()
        if draw < 0.02:
            frames.append(unknown_frame(i % 256, rng.randbytes(rng.randrange(1, 60))))
        elif draw < 0.025 and carried and frames and len(frames[-1]) <= 128:
            inner = frames[-1]
            message = ardupilotmega.MAVLink_tunnel_message(0, 0, 1, len(inner), list(inner.ljust(128, b"\0")))
            frames.append(tunnel.pack(message))
        else:
            frames.append(_known(rng.choice(senders), i, rng))
    return tuple(frames)
