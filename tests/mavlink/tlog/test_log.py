import errno
import os
from pathlib import Path

import numpy as np
import pytest
from pymavlink import mavutil

from mavlink.errors import TlogError
from mavlink.protocol.packet import Packet
from mavlink.tlog.log import Tlog, message_dtype
from mavlink.tlog.summary import info
from mavlink.tlog.writer import TlogWriter
from tests.support.bundled import ROOT
from tests.support.tlog_records import PACKETS, STEP_US, T0, index_of, record

SITL_LOGS = sorted((ROOT / "sitl_logs").glob("*/telemetry.tlog"))


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


@pytest.mark.slow_but_first
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


def test_a_copy_that_a_full_disk_broke_off_is_not_left(log_path, tmp_path, monkeypatch):
    def full(log, rows):
        yield from PACKETS[:5]
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    before = log_path.read_bytes()
    monkeypatch.setattr(Tlog, "_packets", full)
    with pytest.raises(TlogError, match=r"out\.tlog: cannot be written: No space left on device"):
        Tlog.open(log_path).cut(tmp_path / "out.tlog")
    assert not (tmp_path / "out.tlog").exists()
    assert log_path.read_bytes() == before


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
    with pytest.raises(TlogError, match="is a folder; name a log in it"):
        Tlog.open(tmp_path)


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
