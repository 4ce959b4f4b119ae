import random
import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink import mavutil

from mavlink.errors import TlogError
from mavlink.frame import checksum
from mavlink.pack import Speaker
from mavlink.packet import Packet
from mavlink.tlog import Tlog, TlogWriter
from mavlink.tlog_columns import message_dtype
from mavlink.tlog_index import build_index
from mavlink.tlog_info import info

T0 = 1_790_000_000_123_456
STEP_US = 10_000
SITL_LOGS = sorted((Path(__file__).parent.parent / "sitl_logs").glob("*/telemetry.tlog"))


def some_packets(count=300):
    speakers = [Speaker(1), Speaker(2, version=1), Speaker(3, key=b"k" * 32)]
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


@pytest.fixture
def log_path(tmp_path):
    path = tmp_path / "flight.tlog"
    with TlogWriter(path) as writer:
        for packet in PACKETS:
            writer.write(packet)
    return path


def pymavlink_reads(path):
    """(time in s, system, message type, fields) of every message that pymavlink finds."""
    connection = mavutil.mavlogfile(str(path))
    rows = []
    while (message := connection.recv_msg()) is not None:
        if message.get_type() != "BAD_DATA":
            rows.append((message._timestamp, message.get_srcSystem(), message.get_type(), message.to_dict()))
    connection.f.close()
    return rows


def same_as_pymavlink(path, sample=1):
    log = Tlog.open(path)
    theirs = pymavlink_reads(path)
    assert len(log.index) == len(theirs)
    assert log.index.t_us * 1e-6 == pytest.approx([row[0] for row in theirs], abs=1e-6)
    assert log.index.system_id.tolist() == [row[1] for row in theirs]
    for message_id, name in ((33, "GLOBAL_POSITION_INT"), (30, "ATTITUDE"), (0, "HEARTBEAT"), (24, "GPS_RAW_INT")):
        rows, values = log.columns(message_id)
        assert [theirs[row][2] for row in rows] == [name] * len(rows)
        assert len(rows) == sum(row[2] == name for row in theirs)
        for row, value in list(zip(rows, values, strict=True))[::sample]:
            for field in value.dtype.names:
                assert value[field] == pytest.approx(theirs[row][3][field], nan_ok=True), (name, field)


def test_same_messages_and_values_as_pymavlink(log_path):
    same_as_pymavlink(log_path)


@pytest.mark.parametrize("path", SITL_LOGS, ids=lambda path: path.parent.name)
def test_recorded_sessions_read_as_pymavlink_reads_them(path):
    same_as_pymavlink(path, sample=50)


def test_what_was_written_is_read(log_path):
    log = Tlog.open(log_path)
    assert list(log.packets()) == PACKETS
    assert log.packet(7) == PACKETS[7]
    assert log.index.damage == ()
    assert log.index.time_source == "big-endian"
    assert log.index.counts.damaged_bytes == 0
    assert log.index.signed.sum() == 100
    assert log.index.seq.tolist() == [packet.seq for packet in PACKETS]


def test_spans_and_selections(log_path):
    log = Tlog.open(log_path)
    assert list(log.packets(T0 + STEP_US, T0 + 3 * STEP_US)) == PACKETS[1:3]
    assert list(log.packets(message_ids=(0,), system_ids=(2,))) == [
        p for p in PACKETS if p.message_id == 0 and p.system_id == 2
    ]
    assert list(log.packets(stop_us=T0)) == []


def test_cut_writes_a_new_log_and_never_over_one(log_path, tmp_path):
    log = Tlog.open(log_path)
    out = tmp_path / "cut.tlog"
    assert log.cut(out, T0 + 10 * STEP_US, T0 + 100 * STEP_US, message_ids=(33,)) == 21
    kept = [p for p in PACKETS[10:100] if p.message_id == 33]
    assert list(Tlog.open(out).packets()) == kept
    before = out.read_bytes()
    with pytest.raises(TlogError, match="never overwritten"):
        log.cut(out)
    assert out.read_bytes() == before


def test_writer_never_overwrites(log_path):
    before = log_path.read_bytes()
    with pytest.raises(TlogError, match="exists already"):
        TlogWriter(log_path)
    assert log_path.read_bytes() == before
    with pytest.raises(TlogError, match="cannot be made"):
        TlogWriter(log_path.parent / "no such folder" / "a.tlog")


def test_writer_keeps_the_low_bits_of_the_time(tmp_path):
    path = tmp_path / "a.tlog"
    with TlogWriter(path) as writer:
        for i in range(4):
            writer.write(Packet(T0 + i, PACKETS[0].raw))
        writer.sync()
    assert Tlog.open(path).index.t_us.tolist() == [T0 + i for i in range(4)]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "no such file"),
        (b"", "empty file"),
        (b"hello, I am no log" * 50, "no MAVLink frame found in 900 bytes"),
        (bytes(5000), "no MAVLink frame"),
        (b"\xfd", "no MAVLink frame"),
    ],
)
def test_what_is_no_log_is_said_in_one_line(tmp_path, content, message):
    path = tmp_path / "x.tlog"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(TlogError, match=message) as caught:
        Tlog.open(path)
    assert str(path) in str(caught.value) and "\n" not in str(caught.value)


def test_a_folder_is_no_log(tmp_path):
    with pytest.raises(TlogError, match="cannot be read"):
        Tlog.open(tmp_path)


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
    from pymavlink.dialects.v20 import ardupilotmega

    inner = PACKETS[1].raw
    tunnel = Speaker(4).pack(ardupilotmega.MAVLink_tunnel_message(0, 0, 1, len(inner), list(inner.ljust(128, b"\0"))))
    packets = [PACKETS[0], Packet(T0 + 5, tunnel), PACKETS[2]]
    data = b"".join(map(record, packets))
    assert frames_of(data, index_of(data)) == [p.raw for p in packets]


@pytest.mark.parametrize("hurt", [8, 9, 10, 12, 13, 100])
def test_what_a_damaged_frame_carries_is_no_record(hurt):
    from pymavlink.dialects.v20 import ardupilotmega

    inner = PACKETS[1].raw
    tunnel = Speaker(4).pack(ardupilotmega.MAVLink_tunnel_message(0, 0, 1, len(inner), list(inner.ljust(128, b"\1"))))
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


def test_impossible_times_take_the_one_before():
    packets = list(PACKETS)
    packets[0] = Packet(0, packets[0].raw)
    packets[5] = Packet(2**62, packets[5].raw)
    packets[50] = Packet(packets[50].t_us + 3_600_000_000, packets[50].raw)
    index = index_of(b"".join(map(record, packets)))
    assert np.flatnonzero(~index.time_ok).tolist() == [0, 5, 50]
    assert index.t_us[[0, 5, 50]].tolist() == [PACKETS[1].t_us, PACKETS[4].t_us, PACKETS[49].t_us]
    assert index.counts.bad_times == 3
    assert [d.reason for d in index.damage] == ["impossible time"] * 3
    assert all(d.stop - d.start == 8 for d in index.damage)


def test_a_second_writers_clock_is_believed_too():
    hour = 3_600_000_000
    packets = [Packet(p.t_us + hour * (i % 2), p.raw) for i, p in enumerate(PACKETS)]
    index = index_of(b"".join(map(record, packets)))
    assert index.t_us.tolist() == [p.t_us for p in packets]
    assert index.time_ok.all()


def test_a_message_after_a_silence_is_believed():
    minute = 60_000_000
    packets = [Packet(T0 + [0, 1, 2, 300, 600, 601, 602][i] * minute // 100 * 100, PACKETS[i].raw) for i in range(7)]
    index = index_of(b"".join(map(record, packets)))
    assert index.t_us.tolist() == [p.t_us for p in packets]
    assert index.time_ok.all()


def test_two_stamps_with_the_same_flipped_bit_do_not_vouch_for_each_other():
    packets = list(PACKETS)
    for i in (60, 200):
        packets[i] = Packet(packets[i].t_us ^ (1 << 33), packets[i].raw)
    index = index_of(b"".join(map(record, packets)))
    assert np.flatnonzero(~index.time_ok).tolist() == [60, 200]


def test_a_step_of_the_clock_keeps_the_order():
    packets = [Packet(p.t_us - (3_600_000_000 if i >= 150 else 0), p.raw) for i, p in enumerate(PACKETS)]
    index = index_of(b"".join(map(record, packets)))
    assert index.t_us.tolist() == [p.t_us for p in packets]
    assert index.counts.backward_steps == 1
    assert index.time_ok.all()


def test_little_endian_times_are_recognised():
    index = index_of(b"".join(record(p, "<") for p in PACKETS))
    assert index.time_source == "little-endian"
    assert index.t_us.tolist() == [p.t_us for p in PACKETS]


def test_file_without_times_keeps_its_order_and_says_so():
    data = b"".join(p.raw for p in PACKETS)
    index = index_of(data)
    assert index.time_source == "none"
    assert frames_of(data, index) == [p.raw for p in PACKETS]
    assert (np.diff(index.t_us) > 0).all()
    assert not index.time_ok.any()
    assert index.damage == ()


def test_info_counts_and_rates(log_path):
    summary = info(Tlog.open(log_path))
    assert summary.span_s == pytest.approx(299 * STEP_US * 1e-6)
    assert [(s.system_id, s.count, s.lost) for s in summary.systems] == [(1, 100, 0), (2, 100, 0), (3, 100, 0)]
    assert sum(m.count for m in summary.messages) == 300
    beat = next(m for m in summary.messages if m.system_id == 1 and m.name == "HEARTBEAT")
    assert (beat.count, beat.known) == (25, True)
    assert beat.rate_hz == pytest.approx(1 / (12 * STEP_US * 1e-6))


def test_info_sees_lost_packets():
    data = b"".join(record(p) for i, p in enumerate(PACKETS) if i % 30 not in (3, 6))
    log = Tlog(Path("made"), np.frombuffer(data, dtype=np.uint8), index_of(data))
    assert info(log).systems[0].lost == 20


def test_columns_of_an_unknown_message(log_path):
    with pytest.raises(TlogError, match="not in the ardupilotmega dialect"):
        Tlog.open(log_path).columns(60_001)
    rows, values = Tlog.open(log_path).columns(285)
    assert rows.size == values.size == 0
    assert values.dtype == message_dtype(285)


def test_columns_of_one_system(log_path):
    log = Tlog.open(log_path)
    rows, values = log.columns(33, system_id=2)
    assert set(log.index.system_id[rows].tolist()) == {2}
    assert np.all(np.diff(values["time_boot_ms"].astype(int)) > 0)
