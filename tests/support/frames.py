"""Frames, packets and records of logs that are ready made."""

import struct

from pymavlink.dialects.v20 import ardupilotmega as dialect

from mavlink.protocol.encoder import MavlinkEncoder
from mavlink.protocol.packet import Auth, Packet

T0 = 1_790_000_000_000_000
"""Unix µs of packet 0."""
FRAMES = [MavlinkEncoder(1 + k % 7).attitude(k, 0.1, 0.2, 0.01 * k) for k in range(50)]


def packet(k, **more):
    """Packet number k, a microsecond after the one before."""
    return Packet(T0 + k, FRAMES[k % len(FRAMES)], **more)


def record(k):
    """Packet number k as a log has it."""
    return struct.pack(">Q", T0 + k) + FRAMES[k % len(FRAMES)]


def records(stop, start=0):
    """A log of the packets of these numbers."""
    return b"".join(map(record, range(start, stop)))


def some_frames(count=200, *, version=2, key=None, system_id=7):
    """Four kinds of messages of one vehicle."""
    speaker = MavlinkEncoder(system_id, version=version, key=key)
    frames = []
    for i in range(count):
        kind = i % 4
        if kind == 0:
            frames.append(speaker.heartbeat())
        elif kind == 1:
            frames.append(speaker.attitude(i * 100, 0.1, -0.2, i * 0.01))
        elif kind == 2:
            frames.append(speaker.global_position_int(i * 100, -35.36, 149.16 + i * 1e-5, 584.0, 0.2, (1, 2, 0), 1.5))
        else:
            frames.append(speaker.statustext(f"Mission: {i} WP"))
    return frames


def heartbeats(count):
    """Of twenty vehicles in turn, each frame another."""
    speakers = [MavlinkEncoder(k + 1) for k in range(20)]
    return [speakers[k % 20].heartbeat(custom_mode=k) for k in range(count)]


EVERY_VERSION = some_frames(40) + some_frames(40, version=1) + some_frames(40, key=b"k" * 32)
"""MAVLink 2, MAVLink 1, signed."""

UAV, UGV = MavlinkEncoder(1), MavlinkEncoder(7)
PARSER = dialect.MAVLink(None)


def message(raw):
    """A frame as pymavlink reads it."""
    (parsed,) = PARSER.parse_buffer(raw)
    return parsed


def packet_of(raw, *, link=0, t_us=1_000_000, auth=Auth.OPEN, peer=1):
    """A frame as it was received."""
    return Packet(t_us, raw, link, peer, auth)
