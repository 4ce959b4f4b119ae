"""Damage costs the record that it is in, and is told to the byte."""

import random
import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega

from mavlink.protocol.encoder import MavlinkEncoder
from mavlink.protocol.framing import checksum
from mavlink.protocol.packet import Packet
from tests.support.tlog_records import PACKETS, T0, frames_of, index_of, record


@pytest.mark.parametrize("cut", [1, 2, 5, 8, 9, 12, 20])
def test_cut_off_record_costs_only_itself(cut):
    data = b"".join(map(record, PACKETS[:50]))[:-cut]
    index = index_of(data)
    assert frames_of(data, index) == [p.raw for p in PACKETS[:49]]
    (damage,) = index.damage
    assert damage.stop == len(data)
    assert damage.stop - damage.start == len(record(PACKETS[49])) - cut


@pytest.mark.parametrize(
    "insert", [b"\0" * 4096, b"\xfd", b"\xfd\xff\x00", b"Init Gyro", bytes(range(256)), b"\xfe" * 64]
)
def test_inserted_bytes_cost_nothing(insert):
    data = b"".join(insert * (i % 10 == 4) + record(p) for i, p in enumerate(PACKETS))
    index = index_of(data)
    assert frames_of(data, index) == [p.raw for p in PACKETS]
    assert index.t_us.tolist() == [p.t_us for p in PACKETS]
    assert len(index.damage) == 30
    assert sum(d.stop - d.start for d in index.damage) == 30 * len(insert)


@pytest.mark.parametrize("missing", [1, 5, 7, 8, 9, 12])
def test_record_cut_in_its_signature_does_not_swallow_the_next(missing):
    records = [record(p) for p in PACKETS]
    assert PACKETS[5].signed
    records[5] = records[5][:-missing]
    data = b"".join(records)
    index = index_of(data)
    got = frames_of(data, index)
    others = [p for i, p in enumerate(PACKETS) if i != 5]
    assert [f for f in got if f in {p.raw for p in others}] == [p.raw for p in others]
    # what is cut ends in the next record's time, which must not be lost with it
    assert got == [p.raw for p in others]
    assert index.t_us.tolist() == [p.t_us for p in others]
    (damage,) = index.damage
    assert damage.stop - damage.start == len(record(PACKETS[5])) - missing


def test_zero_tail_is_named():
    data = b"".join(map(record, PACKETS)) + bytes(4096)
    index = index_of(data)
    assert len(index) == len(PACKETS)
    assert [d.reason for d in index.damage] == ["zeros"]


@given(seed=st.integers(0, 10_000))
@settings(max_examples=40, deadline=None)
def test_flipped_bytes_cost_only_their_records(seed):
    rng = random.Random(seed)
    records = [bytearray(record(p)) for p in PACKETS]
    hurt = set(rng.sample(range(len(records)), 30))
    for i in hurt:
        records[i][rng.randrange(8, len(records[i]))] ^= rng.randrange(1, 256)
    data = b"".join(map(bytes, records))
    index = index_of(data)
    unhurt = [p for i, p in enumerate(PACKETS) if i not in hurt]
    good = index.known
    got = [f for f, ok in zip(frames_of(data, index), good, strict=True) if ok]
    # a flip in a signature is not seen by the checksum: such a frame counts as undamaged
    assert [f for f in got if f in {p.raw for p in unhurt}] == [p.raw for p in unhurt]
    assert all(len(f) in {len(p.raw) for p in PACKETS} for f in got)
    times = {p.raw: p.t_us for p in unhurt}
    for frame, t_us in zip(frames_of(data, index), index.t_us.tolist(), strict=True):
        assert t_us == times.get(frame, t_us)


@given(data=st.binary(max_size=400), seed=st.integers(0, 99))
@settings(max_examples=60, deadline=None)
def test_any_bytes_are_indexed_without_complaint(data, seed):
    rng = random.Random(seed)
    parts = [record(rng.choice(PACKETS)) for _ in range(3)]
    mixed = data[: len(data) // 2] + parts[0] + data[len(data) // 2 :] + parts[1] + parts[2]
    index = index_of(mixed)
    assert len(index) >= 3
    covered = int(index.length.sum())
    assert index.counts.damaged_bytes <= len(mixed) - covered
    index_of(data)


def unknown_frame(message_id=60_001, extra=77):
    frame = bytes([0xFD, 3, 0, 0, 9, 7, 1]) + message_id.to_bytes(3, "little") + b"abc"
    return frame + checksum(frame, extra).to_bytes(2, "little")


def test_unknown_messages_are_kept_and_marked():
    unknown = unknown_frame()
    data = b"".join(record(p) + record(Packet(p.t_us, unknown)) * (i % 7 == 0) for i, p in enumerate(PACKETS[:70]))
    index = index_of(data)
    assert index.counts.unknown == 10 == (~index.known).sum()
    assert index.damage == ()
    assert set(index.message_id[~index.known]) == {60_001}


def test_unknown_messages_of_one_id_share_their_crc_extra():
    odd = {33: unknown_frame(extra=78)}
    packets = [p if i % 10 else Packet(p.t_us, unknown_frame()) for i, p in enumerate(PACKETS)]
    packets = [Packet(p.t_us, odd.get(i, p.raw)) for i, p in enumerate(packets)]
    index = index_of(b"".join(map(record, packets)))
    assert index.counts.unknown == 30
    (damage,) = index.damage
    assert (damage.stop - damage.start, damage.reason) == (8 + 15, "header damaged")


def test_frame_that_carries_a_frame_counts_once():
    inner = PACKETS[1].raw
    tunnel = MavlinkEncoder(4).pack(
        ardupilotmega.MAVLink_tunnel_message(0, 0, 1, len(inner), list(inner.ljust(128, b"\0")))
    )
    packets = [PACKETS[0], Packet(T0 + 5, tunnel), PACKETS[2]]
    data = b"".join(map(record, packets))
    assert frames_of(data, index_of(data)) == [p.raw for p in packets]


@pytest.mark.parametrize("hurt", [8, 9, 10, 12, 13, 100])
def test_what_a_damaged_frame_carries_is_no_record(hurt):
    inner = PACKETS[1].raw
    tunnel = MavlinkEncoder(4).pack(
        ardupilotmega.MAVLink_tunnel_message(0, 0, 1, len(inner), list(inner.ljust(128, b"\1")))
    )
    packets = [*PACKETS[:10], Packet(PACKETS[9].t_us + 5, tunnel), *PACKETS[10:20]]
    records = [bytearray(record(p)) for p in packets]
    records[10][hurt] ^= 0x40
    data = b"".join(map(bytes, records))
    index = index_of(data)
    assert frames_of(data, index) == [p.raw for p in PACKETS[:20]]
    assert sum(d.stop - d.start for d in index.damage) == len(records[10])


def test_frames_that_a_careless_logger_swallowed_are_saved():
    swallowed = bytes([0xFD, 255, 0, 0, 0xFE, 0xFF, 0xB6, 1, 0xF7, 0xFF]) + bytes(6) + PACKETS[8].raw + b"rest"
    data = b"".join(map(record, PACKETS[:8])) + struct.pack(">Q", PACKETS[8].t_us) + swallowed
    data += b"".join(map(record, PACKETS[9:20]))
    index = index_of(data)
    assert frames_of(data, index) == [p.raw for p in PACKETS[:20]]
    assert np.flatnonzero(~index.time_ok).tolist() == [8]
