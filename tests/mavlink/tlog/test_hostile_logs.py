"""Logs whose end is gigabytes of nothing: memory that the file's windows take, and the records all the same."""

import tracemalloc
from functools import partial

import numpy as np
import pytest

from mavlink.tlog import check as tlog_check
from mavlink.tlog import file_type as tlog_hint
from mavlink.tlog import scan as tlog_scan
from mavlink.tlog.check import check
from mavlink.tlog.file_type import sent_as_text
from mavlink.tlog.index import _without_overlaps, build_index
from mavlink.tlog.log import Tlog
from mavlink.tlog.scan import Frames, find_frames
from mavlink.tlog.summary import info
from tests.support.bundled import ROOT
from tests.support.waiting import instructions_of

SWARM = ROOT / "sitl_logs" / "ardupilot-swarm" / "telemetry.tlog"
SWARM_INDEX = build_index(np.frombuffer(SWARM.read_bytes(), dtype=np.uint8))
LOG = SWARM.read_bytes()[: SWARM_INDEX.offset[4000] - 8]
TAIL = 96 << 20
WINDOW_BYTES = 48 << 20
"""What is looked at at a time, with the numbers made of it; half of the file, which would be 500 MB if all were."""
TAILS = {
    "zeros": b"\0",
    "0xFF": b"\xff",
    "0xFD": b"\xfd",
    "0xFE": b"\xfe",
    "line ends": b"\r\n",
    "0xFD 0x01": b"\xfd\x01",
}


@pytest.fixture(scope="module")
def whole():
    """What the log holds without a tail."""
    return build_index(np.frombuffer(LOG, dtype=np.uint8))


def with_tail(path, tail, end=b""):
    with path.open("wb") as file:
        file.write(LOG)
        if tail == b"\0":
            file.truncate(len(LOG) + TAIL)
            file.seek(0, 2)
        else:
            block = tail * ((1 << 20) // len(tail))
            for _ in range(TAIL >> 20):
                file.write(block)
        file.write(end)
    return path


@pytest.mark.slow_but_first
@pytest.mark.parametrize("tail", TAILS.values(), ids=TAILS.keys())
def test_a_tail_of_nothing_costs_no_memory_and_no_record(tmp_path, monkeypatch, whole, tail):
    path = with_tail(tmp_path / "long.tlog", tail, end=LOG[: whole.offset[300] - 8])
    looked_at = []
    batches = tlog_scan._batches

    def counted(places):
        for at in batches(places):
            looked_at.append(at.size)
            yield at

    monkeypatch.setattr(tlog_scan, "_batches", counted)
    tracemalloc.start()
    log = Tlog.open(path)
    found = info(log)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < WINDOW_BYTES
    # each place costs a header and perhaps a checksum; of the magics of the tail, up to 96 million, next to none count
    assert sum(looked_at) < len(LOG)
    assert len(log.index) == len(whole) + 300, "what stands behind the tail too"
    assert log.index.offset[: len(whole)].tolist() == whole.offset.tolist()
    assert (log.index.t_us[: len(whole)] == whole.t_us).all()
    assert found.counts.damaged_bytes == pytest.approx(TAIL, abs=300)
    assert (len(whole.damage), len(found.damage)) == (0, 1)


def test_check_takes_no_more(tmp_path, whole):
    for tail in (b"\n", b"\xfe"):
        path = with_tail(tmp_path / "long.tlog", tail)
        tracemalloc.start()
        found = check(Tlog.open(path))
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert peak < WINDOW_BYTES
        assert found.records == len(whole)
        assert not found.sent_as_text


def test_a_log_without_a_frame_is_looked_through_in_windows(tmp_path):
    path = tmp_path / "none.tlog"
    path.write_bytes(b"\xfe" * (10 << 20))
    tracemalloc.start()
    assert check(Tlog.open(path, any_file=True)).records == 0
    assert tracemalloc.get_traced_memory()[1] < 4 * WINDOW_BYTES, "numbers of one window"
    tracemalloc.stop()


@pytest.mark.parametrize("window", [64, 301, 4096])
def test_where_windows_end_nothing_is_lost(monkeypatch, window):
    rng = np.random.default_rng(window)
    noise = rng.integers(0, 256, 2000, dtype=np.uint8).tobytes()
    unknown = bytes([0xFD, 1, 0, 0, 7, 9, 1, 0x39, 0x30, 0, 5])  # a message that no dialect has, without its checksum
    parts = [
        LOG[:5000],
        b"\xfd" * 700,
        LOG[5000:9000],
        noise,
        unknown * 30,
        b"\xfe" * 700,
        LOG[9000:20_000],
        b"\0" * 900,
    ]
    data = np.frombuffer(b"".join(parts), dtype=np.uint8)
    before = build_index(data)
    assert len(before) > 100
    for module in (tlog_scan, tlog_hint, tlog_check):
        monkeypatch.setattr(module, "_WINDOW", window)
    monkeypatch.setattr(tlog_scan, "_BATCH", 10)
    after = build_index(data)
    for name in ("offset", "length", "t_us", "known", "message_id"):
        assert (getattr(after, name) == getattr(before, name)).all(), name
    assert after.damage == before.damage


def test_line_ends_are_compared_across_windows(monkeypatch):
    monkeypatch.setattr(tlog_hint, "_WINDOW", 5)
    text = np.frombuffer(b"ab\r\n" * 50, dtype=np.uint8)
    assert sent_as_text(text)
    assert not sent_as_text(text[:40])
    assert not sent_as_text(np.append(text, np.uint8(0x0A)))
    assert not sent_as_text(text[3:]), "the first has nothing before it"


def each_over_the_next(count):
    return Frames(np.arange(count, dtype=np.int64) * 10, np.full(count, 15, dtype=np.int64))


def test_of_thousands_of_frames_over_each_other_every_second_stays():
    kept = _without_overlaps(each_over_the_next(20_000), 8)
    assert (np.diff(kept.offset) >= 15).all()
    assert len(kept.offset) == 10_000


def test_twice_as_many_frames_over_each_other_take_twice_the_work():
    some, twice = (instructions_of(partial(_without_overlaps, each_over_the_next(n), 8)) for n in (1000, 2000))
    assert twice < 2.2 * some


def test_frames_are_found_however_many_magics_stand_around():
    whole = find_frames(np.frombuffer(LOG, dtype=np.uint8))
    crowded = np.frombuffer(b"\xfd" * 5000 + LOG + b"\xfe" * 5000, dtype=np.uint8)
    assert (find_frames(crowded).offset == whole.offset + 5000).all()
