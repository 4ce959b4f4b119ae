import errno
import os
import random
import signal
import subprocess
import sys
import threading
import time

import pytest

from infra.files.append import AppendFile
from infra.files.record_state import RecordState, overall
from infra.files.segment import segments
from mavlink.protocol.packet import Auth
from mavlink.tlog.writer import TlogWriter
from tests.support.bundled import ROOT
from tests.support.faulty_disk import FaultyDisk, delete
from tests.support.frames import T0, packet, record, records
from tests.support.waiting import until


@pytest.fixture
def disk():
    return FaultyDisk()


@pytest.fixture
def path(tmp_path):
    return tmp_path / "session" / "telemetry.tlog"


@pytest.fixture
def writer(path, disk):
    path.parent.mkdir()
    writer = TlogWriter(path, disk=disk)
    yield writer
    writer.close()


def test_records_have_running_numbers_and_batches_are_one_write(writer, path):
    assert writer.write(packet(0)) == 0
    assert writer.write_records(records(10, 1), 9) == 1
    assert writer.write(packet(10)) == 10
    assert path.read_bytes() == records(11), "there before the writer is closed"
    assert writer.records == 11
    assert writer.state.failing_s == 0


def test_rows_are_synced_by_themselves(writer, disk):
    disk.may_sync.clear()
    writer.write(packet(0))
    assert writer.state.sync_age_s > 0
    disk.may_sync.set()
    assert until(lambda: writer.state.sync_age_s == 0)
    count = disk.syncs
    time.sleep(0.4)
    assert disk.syncs == count, "nothing new, nothing to sync"


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EDQUOT, errno.EROFS])
def test_a_full_disk_keeps_whole_records_and_goes_on_in_the_same_file(writer, path, disk, code):
    writer.write(packet(0))
    disk.room, disk.write_error = 20, code
    for k in range(1, 500):
        writer.write(packet(k))
    assert path.read_bytes() == records(1), "cut back to the last whole record"
    state = writer.state
    assert (state.reason, state.waiting, state.lost) == (os.strerror(code), 499, 0)
    assert state.failing_s > 0
    assert state.waiting_bytes == len(records(500, 1))
    disk.room, disk.write_error = None, 0
    assert until(lambda: writer.state.failing_s == 0)
    writer.write(packet(500))
    assert path.read_bytes() == records(501)
    assert segments(path) == [path]
    assert (writer.state.waiting, writer.state.lost) == (0, 0)


def test_io_errors_begin_a_new_segment_and_lose_nothing(writer, path, disk):
    for k in range(100):
        writer.write(packet(k))
    assert until(lambda: writer.state.sync_age_s == 0)
    disk.write_error = errno.EIO
    for k in range(100, 200):
        writer.write(packet(k))
    time.sleep(0.4)
    disk.write_error = 0
    assert until(lambda: writer.state.failing_s == 0)
    writer.write(packet(200))
    first, second = segments(path)
    assert (first.read_bytes(), second.read_bytes()) == (records(100), records(201, 100))
    assert second.name == "telemetry.1.tlog"


def test_short_writes_are_completed(writer, path, disk):
    disk.most = 7
    for k in range(20):
        writer.write(packet(k))
    assert path.read_bytes() == records(20)


def test_a_file_that_cannot_even_be_cut_is_cut_later(writer, path, disk):
    writer.write(packet(0))
    disk.room, disk.truncate_error = 20, errno.EIO
    writer.write(packet(1))
    assert path.read_bytes() == records(1) + record(1)[:20]
    disk.room, disk.truncate_error = None, 0
    assert until(lambda: writer.state.failing_s == 0)
    assert path.read_bytes() == records(2)


def test_a_failed_sync_writes_again_what_it_may_have_lost(writer, path, disk):
    for k in range(50):
        writer.write(packet(k))
    assert until(lambda: writer.state.sync_age_s == 0)
    disk.sync_error = errno.EIO
    disk.may_sync.clear()
    for k in range(50, 80):
        writer.write(packet(k))
    disk.may_sync.set()
    assert until(lambda: writer.state.failing_s > 0 or len(segments(path)) > 1)
    disk.sync_error = 0
    assert until(lambda: writer.state.failing_s == 0 and writer.state.sync_age_s == 0)
    writer.write(packet(80))
    contents = [segment.read_bytes() for segment in segments(path)]
    assert contents[0] == records(80), "left as it was"
    assert contents[-1].startswith(records(80, 50)), "the rows of the failed sync, again"
    assert contents[-1].endswith(records(81, 80))
    assert writer.state.lost == 0


def test_a_stalled_sync_never_holds_up_a_write(writer, path, disk):
    disk.may_sync.clear()
    writer.write(packet(0))
    assert until(lambda: disk.syncs == 1)
    for k in range(1, 2000):
        writer.write(packet(k))
    assert disk.syncs == 1, "all written while one sync hung"
    assert path.read_bytes() == records(2000)
    disk.may_sync.set()


def test_a_deleted_folder_is_made_anew_with_all_that_was_in_it(writer, path):
    for k in range(300):
        writer.write(packet(k))
    delete(path.parent)
    for k in range(300, 400):
        writer.write(packet(k))
    assert until(path.exists)
    assert until(lambda: writer.state.failing_s == 0)
    writer.write(packet(400))
    assert path.read_bytes() == records(401)
    assert writer.state.lost == 0


def test_a_deleted_file_never_takes_the_place_of_another(writer, path):
    writer.write(packet(0))
    path.unlink()
    path.write_bytes(b"somebody else's")
    assert until(lambda: len(segments(path)) == 2 and writer.state.failing_s == 0)
    writer.write(packet(1))
    assert path.read_bytes() == b"somebody else's"
    assert segments(path)[1].read_bytes() == records(2)


@pytest.mark.parametrize("left", [0, 30])
def test_a_log_that_another_program_cuts_short_is_told_and_goes_on_in_a_new_segment(writer, path, left):
    for k in range(3):
        writer.write(packet(k))
    assert until(lambda: path.read_bytes() == records(3))
    os.truncate(path, left)
    assert until(lambda: len(segments(path)) == 2 and writer.state.failing_s == 0)
    assert writer.state.reason == f"cut short by another program, {len(records(3)) - left} bytes are gone"
    writer.write(packet(3))
    assert path.read_bytes() == records(3)[:left]
    assert segments(path)[1].read_bytes() == records(4)[len(records(3)) :]
    assert (writer.state.faults, writer.state.lost) == (1, 0)


def test_a_minute_of_full_rate_waits_in_memory(tmp_path, disk):
    writer = TlogWriter(tmp_path / "telemetry.tlog", disk=disk)
    disk.room = 0
    batch = records(1000)
    for _ in range(300):
        writer.write_records(batch, 1000)
    state = writer.state
    assert (state.waiting, state.lost) == (300_000, 0)
    disk.room = None
    writer.close()
    assert writer.state.lost == 0
    assert writer.path.read_bytes() == batch * 300


def test_past_the_bound_the_oldest_go_and_are_counted(tmp_path, disk):
    writer = TlogWriter(tmp_path / "telemetry.tlog", disk=disk, ram_bytes=200_000)
    disk.room = 0
    for k in range(10_000):
        writer.write(packet(k))
    state = writer.state
    assert state.waiting_bytes <= 200_000
    assert state.lost > 0
    assert state.waiting + state.lost == 10_000
    disk.room = None
    writer.close()
    assert writer.path.read_bytes() == records(10_000, state.lost), "the newest, in order"


def test_what_still_waits_at_the_end_is_said_to_be_lost(tmp_path, disk):
    writer = TlogWriter(tmp_path / "telemetry.tlog", disk=disk)
    writer.write(packet(0))
    disk.room = 0
    writer.write(packet(1))
    writer.close()
    writer.close()
    assert writer.state.lost == 1
    assert writer.path.read_bytes() == records(1)


def test_a_real_size_limit(tmp_path):
    """The kernel itself refuses at 100 kB a file, in a process of its own."""
    script = """
import resource, sys, time
sys.dont_write_bytecode = True
sys.path[:0] = sys.argv[2:]
from mavlink.tlog.writer import TlogWriter
from tests.support.frames import packet
from tests.support.waiting import until
resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, resource.RLIM_INFINITY))
with TlogWriter(sys.argv[1]) as writer:
    for k in range(8000):
        writer.write(packet(k))
    assert until(lambda: writer.state.failing_s == 0 or writer.state.waiting > 0)
    resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
    assert until(lambda: writer.state.failing_s == 0)
    writer.write(packet(8000))
assert writer.state.lost == 0
"""
    path = tmp_path / "telemetry.tlog"
    subprocess.run([sys.executable, "-c", script, path, ROOT], check=True, timeout=300)
    parts = [part.read_bytes() for part in segments(path)]
    assert len(parts[0]) <= 100_000
    assert joined(parts) == records(8001)


def joined(parts):
    """Segments as one, without what was written twice."""
    whole = b""
    for part in parts:
        again = whole.rfind(part[:100]) if part else -1
        whole = (whole if again < 0 else whole[:again]) + part
    return whole


KILLED = """
import os, sys
sys.path[:0] = sys.argv[2:]
from mavlink.tlog.writer import TlogWriter
from tests.support.frames import packet, records
writer = TlogWriter(sys.argv[1])
k = 0
while True:
    if k % 5:
        writer.write(packet(k))
        k += 1
    else:
        writer.write_records(records(k + 6, k), 6)
        k += 6
    os.write(1, k.to_bytes(8, "big"))
"""


@pytest.mark.slow_but_first
@pytest.mark.parametrize("seed", range(5))
def test_a_kill_loses_nothing_that_was_accepted(tmp_path, seed):
    path = tmp_path / "telemetry.tlog"
    command = [sys.executable, "-c", KILLED, path, ROOT]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as child:
        head = child.stdout.read(8)
        killer = threading.Timer(random.Random(seed).uniform(0.0, 0.5), child.send_signal, (signal.SIGKILL,))
        killer.start()
        acknowledged = head + child.stdout.read()
    acknowledged = acknowledged[: len(acknowledged) // 8 * 8]
    accepted = int.from_bytes(acknowledged[-8:], "big")
    data = path.read_bytes()
    assert accepted > 0
    assert data.startswith(records(accepted))
    assert records(accepted + 20).startswith(data), "nothing but whole or torn records of ours behind them"


def test_refused_records_are_kept_and_noted(writer, path):
    writer.write(packet(0))
    assert not path.with_name("refused.csv").exists()
    writer.write(packet(1, link=2, peer=7, auth=Auth.BAD))
    writer.write(packet(2, auth=Auth.GOOD))
    writer.write(packet(3, auth=Auth.REPLAYED))
    assert path.read_bytes() == records(4)
    assert path.with_name("refused.csv").read_text() == (
        f"record,t_us,link,peer,auth\n1,{T0 + 1},2,7,3\n3,{T0 + 3},0,0,4\n"
    )


def test_a_process_goes_on_where_one_before_it_died(writer, path):
    for k in range(10):
        writer.write(packet(k))
    with TlogWriter(path, resume_after=10) as second:
        assert second.write(packet(10, auth=Auth.BAD)) == 10
    with TlogWriter(path, resume_after=11) as third:
        assert third.write(packet(11, auth=Auth.BAD)) == 11
        assert third.records == 12
    assert [part.read_bytes() for part in segments(path)] == [records(10), records(11, 10), records(12, 11)]
    refused = [part.read_text().splitlines()[1:] for part in segments(path.with_name("refused.csv"))]
    assert refused == [[f"{k},{T0 + k},0,0,3"] for k in (10, 11)]


def test_states_of_several_files_are_told_as_one():
    log = RecordState(name="telemetry.tlog", rows=7, waiting=1, clock_step_s=2.0, reason="old")
    table = RecordState(name="a.csv", rows=3, failing_s=2.0, reason="full", waiting=5, lost=4, sync_age_s=1.5)
    both = overall((log, table))
    assert (both.name, both.rows, both.failing_s, both.reason) == ("telemetry.tlog", 7, 2.0, "a.csv: full")
    assert (both.waiting, both.lost, both.sync_age_s, both.clock_step_s) == (6, 4, 1.5, 2.0)
    assert overall((log,)) == log


def test_tables_keep_their_header_in_every_segment(tmp_path, disk):
    file = AppendFile(tmp_path / "identity.csv", header=b"a,b\n", disk=disk)
    file.write(b"1,2\n")
    disk.sync_error = errno.EIO
    file.maintain()
    disk.sync_error = 0
    file.maintain()
    file.write(b"3,4\n")
    file.close()
    parts = [part.read_text() for part in segments(tmp_path / "identity.csv")]
    assert parts == ["a,b\n1,2\n", "a,b\n1,2\n3,4\n"]
