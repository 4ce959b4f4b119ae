"""A disk that does not answer: nobody takes that for a death, nothing is lost, and what is counted is in the log."""

import os
import signal
import struct
import threading

import pytest

from infra.files.journal import Journal, make_journal
from infra.files.segment import segments
from mavlink.protocol.encoder import MavlinkEncoder
from mavlink.protocol.packet import Auth, Packet
from mavlink.tlog.writer import TlogWriter
from tests.support.faulty_disk import FaultyDisk, HangingDisk
from tests.support.frames import heartbeats
from tests.support.receiving import HOST, bearable, carry, read_to, recorded, steady, wait_for
from tests.support.waiting import until

pytestmark = pytest.mark.skipif(os.name != "posix", reason="sockets are lent to another process")

T0 = 1_790_000_000_000_000
STUCK = """
import os, time
from infra.files import journal_writer
from infra.files.disk import Disk
journal_writer.HANG_S = 0.3
write, flag = Disk.write, os.environ["STUCK_DISK"]
def stuck(self, fd, data):
    done = 0
    if os.path.exists(flag):
        with open(flag) as file:
            torn = file.read()
        done = write(self, fd, data[: len(data) * 2 // 3]) if torn else 0
    while os.path.exists(flag):
        time.sleep(0.01)
    return done or write(self, fd, data)
Disk.write = stuck
"""


@pytest.fixture
def stuck(tmp_path, monkeypatch):
    """While this file exists, no write of a receiving process returns; with a word in it each is torn before."""
    (tmp_path / "python").mkdir()
    (tmp_path / "python" / "sitecustomize.py").write_text(STUCK)
    flag = tmp_path / "stuck"
    monkeypatch.setenv("PYTHONPATH", str(tmp_path / "python"))
    monkeypatch.setenv("STUCK_DISK", str(flag))
    return flag


def test_a_disk_that_hangs_is_waited_for_and_costs_nothing(started, sender, stuck, tmp_path):
    ingest, port = started()
    assert until(lambda: ingest.supervisor.spare is not None)
    frames = heartbeats(800)
    packets = carry(ingest, sender, port, frames[:100])
    assert until(lambda: ingest.health().packets == 100)
    stuck.touch()
    packets += carry(ingest, sender, port, frames[100:])
    assert [packet.raw for packet in packets] == frames, "the flight goes on meanwhile"
    assert until(lambda: ingest.health().record.waiting == 700)
    assert until(lambda: ingest.health().record.stalled_s > 1.0)
    health = ingest.health()
    assert health.packets == health.record.rows == 100, "only what is written is called recorded"
    assert len(recorded(tmp_path)) == 100
    stuck.unlink()
    assert until(lambda: ingest.health().packets == 800)
    assert until(lambda: ingest.health().record.stalled_s == 0.0)
    ingest.stop()
    assert recorded(tmp_path) == frames and len(segments(tmp_path / "telemetry.tlog")) == 1
    health = ingest.health()
    assert (health.restarts, health.record.lost, health.record.waiting) == (0, 0, 0)
    assert [notice.text for notice in ingest.notices() if "life" in notice.text] == []


@pytest.mark.slow_but_first
@pytest.mark.parametrize("torn", ["", "torn"])
def test_who_dies_while_the_disk_hangs_leaves_nothing_behind_unwritten(started, sender, stuck, tmp_path, torn):
    ingest, port = started()
    assert until(lambda: ingest.supervisor.spare is not None)
    frames = heartbeats(600)
    stuck.write_text(torn)
    packets = carry(ingest, sender, port, frames[:300])
    os.kill(ingest.pid, signal.SIGKILL)
    assert until(lambda: ingest.health().restarts == 1)
    packets += carry(ingest, sender, port, frames[300:])
    stuck.unlink()
    assert until(lambda: ingest.health().packets == 600)
    ingest.stop()
    assert [packet.raw for packet in packets] == frames
    assert recorded(tmp_path) == frames, "each once, in order"
    assert len(segments(tmp_path / "telemetry.tlog")) == 2
    assert ingest.health().record.lost == 0


def test_an_end_while_the_disk_hangs_says_what_is_lost(started, sender, stuck, tmp_path):
    ingest, port = started()
    frames = heartbeats(50)
    carry(ingest, sender, port, frames[:20])
    assert until(lambda: ingest.health().packets == 20)
    stuck.touch()
    carry(ingest, sender, port, frames[20:])
    stopping = threading.Thread(target=ingest.stop, daemon=True)
    stopping.start()
    stopping.join(120.0)
    assert not stopping.is_alive(), "it does not wait for the disk"
    health = ingest.health()
    assert (health.packets, health.record.lost, health.record.waiting) == (20, 30, 0)
    assert recorded(tmp_path) == frames[:20]


def test_what_is_killed_in_between_is_told(started, sender, tmp_path):
    ingest, port = started()
    assert until(lambda: ingest.supervisor.spare is not None)
    rate = bearable(ingest, 2000)
    frames = heartbeats(int(1.5 * rate))
    thread = threading.Thread(target=steady, args=(sender, port, frames[:-1], rate))
    thread.start()
    wait_for(ingest, int(0.5 * rate))
    os.kill(ingest.pid, signal.SIGKILL)
    thread.join()
    assert until(lambda: ingest.health().restarts == 1)
    sender.sendto(frames[-1], (HOST, port))
    read_to(ingest, frames[-1])
    told = [notice.text for notice in ingest.notices() if "another process took over" in notice.text]
    ingest.stop()
    log = recorded(tmp_path)
    assert ingest.health().packets == len(log)
    assert len(told) == 1
    assert log == frames or "at most 256 are lost" in told[0]


BEAT = MavlinkEncoder(1).heartbeat()


def record(k):
    return struct.pack(">Q", T0 + k) + BEAT


@pytest.fixture
def journal():
    fd = make_journal(1_000_000)
    yield Journal(fd)
    os.close(fd)


def test_past_the_bound_new_records_are_lost_and_counted_and_numbers_have_no_gaps(tmp_path, journal):
    disk = HangingDisk()
    writer = TlogWriter(tmp_path / "telemetry.tlog", disk=disk, journal=journal)
    disk.may_write.clear()
    numbers = [writer.write(Packet(T0 + k, BEAT, auth=Auth.BAD)) for k in range(12_000)]
    taken = [number for number in numbers if number is not None]
    assert taken == list(range(len(taken))) and 5000 < len(taken) < 12_000
    assert until(lambda: writer.state.stalled_s > 0.0)
    state = writer.state
    assert (state.rows, state.waiting) == (0, len(taken))
    assert state.lost >= 12_000 - len(taken)
    disk.may_write.set()
    assert until(lambda: writer.state.waiting == 0)
    writer.write(Packet(T0 + 12_000, BEAT, auth=Auth.BAD))
    writer.close()
    kept = [k for k, number in enumerate(numbers) if number is not None]
    assert (tmp_path / "telemetry.tlog").read_bytes() == b"".join(map(record, [*kept, 12_000]))
    rows = (tmp_path / "refused.csv").read_text().splitlines()[1:]
    assert rows[0] == f"0,{T0},0,0,3" and rows[-1] == f"{len(taken)},{T0 + 12_000},0,0,3"
    assert writer.state.rows == len(taken) + 1


def test_a_full_disk_keeps_its_records_where_they_outlive_the_process(tmp_path, journal):
    disk = FaultyDisk()
    writer = TlogWriter(tmp_path / "telemetry.tlog", disk=disk, journal=journal)
    disk.room = 50
    for k in range(100):
        writer.write(Packet(T0 + k, BEAT))
    assert until(lambda: writer.state.failing_s > 0.0)
    assert (writer.state.rows, writer.state.waiting, writer.state.lost) == (0, 100, 0)
    assert journal.waiting_bytes > 100 * len(record(0))
    disk.room = None
    assert until(lambda: writer.state.waiting == 0)
    writer.close()
    assert (tmp_path / "telemetry.tlog").read_bytes() == b"".join(map(record, range(100)))
    assert (writer.state.rows, writer.state.lost) == (100, 0)


@pytest.mark.parametrize("written", [0, 1, 7, 8, 28, 29, 30, 58, 100, 145, 290])
def test_the_next_process_completes_what_the_one_before_had_begun(tmp_path, journal, written):
    path = tmp_path / "telemetry.tlog"
    before = b"".join(map(record, range(100)))
    rows = b"".join(map(record, range(100, 110)))
    size = len(record(0))
    path.write_bytes(before + rows[:written])
    for k in range(100, 110):
        assert journal.put(0, record(k), 1) == k - 100
    journal.put(1, f"3,{T0},0,0,3\n".encode(), 1)
    (tmp_path / "refused.csv").write_text(f"record,t_us,link,peer,auth\n3,{T0},0,0,3\n")
    writer = TlogWriter(path, resume_after=100, journal=journal)
    assert writer.write(Packet(T0 + 110, BEAT)) == 10
    assert until(lambda: writer.state.waiting == 0)
    writer.close()
    whole = written // size
    again = b"".join(map(record, range(100 + whole, 111)))
    assert path.read_bytes() == before + rows[:written], "left as it was"
    assert segments(path)[-1].read_bytes() == again
    assert len(segments(tmp_path / "refused.csv")) == 1, "it was there"


def test_a_process_that_died_between_two_words_leaves_the_journal_readable(journal):
    for k in range(5):
        journal.put(0, record(k), 1)
    journal.put(1, b"note\n", 1)
    journal.remove(journal.oldest())
    assert (journal.rows, journal.written, journal.waiting_bytes) == (5, 5, 0)
    journal._words[1] = 777  # between the two words that are set back
    assert not journal.recover() and journal.waiting_bytes == 0
    journal.put(0, record(5), 1)
    journal._words[2] = 5  # died before the row was counted
    assert journal.recover() and (journal.rows, journal.written) == (6, 5)
    assert journal.oldest().data == {0: record(5)}


def test_rows_come_out_as_they_went_in_for_many_rounds(journal):
    expected, got, number = bytearray(), bytearray(), 0
    for k in range(3000):
        data = record(k) * (1 + k % 40)
        assert journal.put(0, data, 1 + k % 40) == number
        number += 1 + k % 40
        expected += data
        if k % 7 == 6:
            piece = journal.oldest()
            got += piece.data[0]
            journal.remove(piece)
    while (piece := journal.oldest()) is not None:
        got += piece.data[0]
        journal.remove(piece)
    assert got == expected and journal.lost == 0
    assert journal.written == journal.rows == number
