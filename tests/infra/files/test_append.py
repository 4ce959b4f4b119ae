"""Whatever the disk does, in whatever order: every row accepted is in the files, in order, once the disk is well."""

import errno
import shutil
import tempfile
import threading
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from infra.files import append
from infra.files.append import AppendFile, _Mode
from infra.files.segment import segment_path, segments
from infra.files.write_buffer import WriteBuffer
from tests.support.faulty_disk import FaultyDisk
from tests.support.waiting import until

CODES = (errno.ENOSPC, errno.EIO, errno.EROFS, errno.EDQUOT, errno.EFBIG)
STEPS = st.one_of(
    st.tuples(st.just("write"), st.integers(1, 30)),
    st.tuples(st.just("tend"), st.just(0)),
    st.tuples(st.just("room"), st.one_of(st.none(), st.integers(0, 200))),
    st.tuples(st.just("most"), st.one_of(st.none(), st.integers(1, 20))),
    st.tuples(st.sampled_from(["write_error", "sync_error", "open_error"]), st.sampled_from((0, *CODES))),
    st.tuples(st.just("truncate_error"), st.sampled_from((0, errno.EIO))),
    st.tuples(st.just("delete"), st.sampled_from(["file", "folder"])),
)


def rows_of(path, header):
    """Rows in all segments, as each says itself; every segment is whole lines but for what could not be cut."""
    return [
        [int(line) for line in part.read_bytes().split(b"\n") if line.isdigit() and len(line) == 8]
        for part in segments(path)
        if part.read_bytes().startswith(header)
    ]


def merged(parts):
    """What a reader makes of segments: a row that stands in a later one too counts there."""
    whole = []
    for k, part in enumerate(parts):
        later = set().union(*parts[k + 1 :])
        whole += [row for row in part if row not in later]
    return whole


@pytest.mark.slow
@settings(max_examples=60, deadline=None)
@given(st.lists(STEPS, max_size=40), st.booleans())
def test_nothing_accepted_is_ever_lost_or_out_of_order(steps, with_header):
    header = b"number\n" if with_header else b""
    folder = Path(tempfile.mkdtemp())
    path, disk = folder / "session" / "a.csv", FaultyDisk()
    path.parent.mkdir()
    retry_s, append.RETRY_S = append.RETRY_S, 0.0
    try:
        file = AppendFile(path, header=header, disk=disk)
        count = 0
        for what, value in steps:
            if what == "write":
                for _ in range(value):
                    assert file.write(b"%08d\n" % count) == count
                    count += 1
            elif what == "tend":
                file.maintain()
            elif what == "delete":
                if value == "folder":
                    shutil.rmtree(path.parent, ignore_errors=True)
                else:
                    segments(path)[-1:] and segments(path)[-1].unlink()
                for _ in range(3):  # as soon as the disk allows
                    disk.room = disk.most = None
                    disk.write_error = disk.sync_error = disk.open_error = disk.truncate_error = 0
                    file.maintain()
            else:
                setattr(disk, what, value)
            state = file.state
            assert state.rows == count
            assert state.lost == 0
        disk.room = disk.most = None
        disk.write_error = disk.sync_error = disk.open_error = disk.truncate_error = 0
        for _ in range(3):
            file.maintain()
        state = file.state
        assert (state.failing_s, state.waiting, state.lost) == (0, 0, 0)
        file.close()
        if not any(what == "delete" for what, _ in steps):
            assert merged(rows_of(path, header)) == list(range(count))
        else:  # earlier segments may have been deleted: what is there is in order, and the newest is complete
            rows = merged(rows_of(path, header))
            assert rows == sorted(set(rows))
            assert not count or rows[-1] == count - 1
    finally:
        append.RETRY_S = retry_s
        shutil.rmtree(folder)


def test_names_of_segments(tmp_path):
    path = tmp_path / "telemetry.tlog"
    for name in ("telemetry.tlog", "telemetry.10.tlog", "telemetry.2.tlog", "telemetry.x.tlog", "telemetry.3.csv"):
        (tmp_path / name).touch()
    assert [part.name for part in segments(path)] == ["telemetry.tlog", "telemetry.2.tlog", "telemetry.10.tlog"]
    assert segment_path(path, 0) == path
    assert segment_path(path, 2).name == "telemetry.2.tlog"
    assert segments(tmp_path / "absent.csv") == []


def test_a_backlog_is_bounded_and_keeps_the_newest():
    rows = WriteBuffer(300_000)
    for k in range(100_000):
        rows.append(b"%09d\n" % k, 1)
    assert rows.bytes <= 300_000
    assert rows.rows + rows.dropped == 100_000
    older = WriteBuffer(300_000)
    older.append(b"older\n", 1)
    rows.put_before(older)
    assert rows.pop().data.startswith((b"older", b"%09d" % rows.dropped))
    held = b"".join(bytes(rows.pop().data) for _ in iter(lambda: bool(rows), False))
    assert held.endswith(b"000099999\n")
    assert (rows.bytes, rows.rows) == (0, 0)


def test_a_disk_that_hangs_hangs_nobody_who_asks_or_closes(tmp_path, monkeypatch):
    monkeypatch.setattr(append, "HANG_S", 0.05)
    disk, go_on = FaultyDisk(), threading.Event()
    file = AppendFile(tmp_path / "a.csv", disk=disk)
    monkeypatch.setattr(disk, "write", lambda fd, data: go_on.wait(120) and len(data))
    monkeypatch.setattr(disk, "fsync", lambda fd: go_on.wait(120))
    threads = [threading.Thread(target=file.write, args=(b"1\n",)), threading.Thread(target=file.maintain)]
    for thread in threads:
        thread.start()
    assert until(lambda: file.state.rows == 1)
    assert file.state.sync_age_s > 0
    go_on.set()
    for thread in threads:
        thread.join()
    file.write(b"2\n")
    go_on.clear()
    syncing = threading.Thread(target=file.maintain)
    syncing.start()
    assert until(file._maintaining.locked)
    assert file.close().lost == 0
    go_on.set()
    syncing.join()


def test_closing_twice_and_writing_afterwards_counts_as_lost(tmp_path):
    file = AppendFile(tmp_path / "a.csv")
    file.write(b"1\n")
    file.close()
    assert file.close().lost == 0
    file.write(b"2\n")
    file.maintain()
    assert file.state.lost == 1
    assert file.state.failing_s == 0
    assert (tmp_path / "a.csv").read_bytes() == b"1\n"
    assert segments(tmp_path / "a.csv") == [tmp_path / "a.csv"]


class Watched(AppendFile):
    """Its state is asked for after every change of it, as another thread may."""

    def __init__(self, path):
        self.seen = None
        super().__init__(path)
        self.seen = []

    def __setattr__(self, name, value):
        super().__setattr__(name, value)
        if self.__dict__.get("seen") is not None:
            self.seen.append(self.state)


@pytest.mark.parametrize("error", [OSError(errno.ENOSPC, "full"), OSError()])
def test_nobody_ever_sees_a_failure_without_its_reason(tmp_path, error):
    file = Watched(tmp_path / "a.csv")
    for failure in (error, OSError(errno.EIO, "bad")):
        file._fail(failure)
        file._mode = _Mode.WRITING  # repaired
    failed = [state for state in file.seen if state.faults or state.failing_s]
    assert max(state.faults for state in failed) == 2
    assert all(state.reason for state in failed)
    assert all(state.reason == "bad" for state in failed if state.faults == 2)
    file.close()
