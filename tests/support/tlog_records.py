"""Some packets of three senders, and logs made of them."""

import struct

import numpy as np

from mavlink.protocol.encoder import MavlinkEncoder
from mavlink.protocol.packet import Packet
from mavlink.tlog.index import build_index

T0 = 1_790_000_000_123_456
STEP_US = 10_000


def some_packets(count=300):
    speakers = [MavlinkEncoder(1), MavlinkEncoder(2, version=1), MavlinkEncoder(3, key=b"k" * 32)]
    packets = []
    for i in range(count):
        speaker, boot_ms = speakers[i % 3], 1000 + i * 10
        kind = i // 3 % 4
        if kind == 0:
            frame = speaker.heartbeat()
        elif kind == 1:
            frame = speaker.attitude(boot_ms, 0.1, -0.2, i * 0.01)
        elif kind == 2:
            frame = speaker.global_position_int(boot_ms, -35.36 + i * 1e-6, 149.16, 584.0, 0.3, (1, -2, 0), i * 0.001)
        else:
            frame = speaker.statustext(f"Reached waypoint #{i}")
        packets.append(Packet(T0 + i * STEP_US, frame))
    return packets


PACKETS = some_packets()


def record(packet, order=">"):
    return struct.pack(f"{order}Q", packet.t_us) + packet.raw


def index_of(data):
    return build_index(np.frombuffer(bytes(data), dtype=np.uint8))


def frames_of(data, index):
    ends = index.offset + index.length
    return [bytes(data[start:stop]) for start, stop in zip(index.offset.tolist(), ends.tolist(), strict=True)]
