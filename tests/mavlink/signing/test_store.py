import hashlib
import os
import signal
import struct
import subprocess
import sys
import time

import pytest

from mavlink.errors import SigningError
from mavlink.protocol.packet import Auth, Packet
from mavlink.signing.keys import write_key
from mavlink.signing.store import SLOTS, StreamStore, open_verifier
from mavlink.signing.streams import AHEAD, MAX_STREAMS, SECOND, StreamRow, ticks_of
from mavlink.signing.verifier import Verifier
from tests.support.signed_vehicles import Sender, ring_of, secret_of
from tests.support.waiting import until


def now_us():
    return time.time_ns() // 1000


def heard_now(count=2000, system_id=7, ahead=0):
    """Frames of the last moments, as they came."""
    t_us = now_us()
    sender = Sender(system_id, timestamp=ticks_of(t_us) - count + ahead)
    return [Packet(t_us, sender.frame()) for _ in range(count)]


def rows(store):
    return sorted(store.streams.rows())


def judged(checker, packets):
    verdicts = [checker.check(packet) for packet in packets]
    return {verdict: verdicts.count(verdict) for verdict in set(verdicts)}


def abandon(store):
    """As if the process had died: nothing more is saved, the lock is gone."""
    store._stop.set()
    store._thread.join()
    os.close(store._lock)
    store._journal.newest.release()
    store._journal._map.close()


def restarted(folder, heard, *, by):
    """Replays what was heard to a new station."""
    store = StreamStore(folder, period_s=30)
    checker = Verifier(ring_of(7, 8), streams=store.streams)
    assert judged(checker, heard) == {Auth.GOOD: len(heard)}
    by(store)
    again = StreamStore(folder, period_s=30)
    try:
        later = [Packet(now_us(), packet.raw, link=5) for packet in heard]
        return judged(Verifier(ring_of(7, 8), streams=again.streams), later)
    finally:
        again.close()


def test_frames_from_before_a_restart_are_refused(tmp_path):
    heard = heard_now()
    assert restarted(tmp_path, heard, by=StreamStore.close) == {Auth.REPLAYED: 2000}


def test_frames_from_before_a_crash_are_refused_though_the_last_were_not_saved(tmp_path):
    old = heard_now(500)
    store = StreamStore(tmp_path, period_s=30)
    checker = Verifier(ring_of(7), streams=store.streams)
    assert judged(checker, old) == {Auth.GOOD: 500}
    store._save(ended=False)
    time.sleep(0.05)
    new = heard_now(2000)  # never saved
    assert judged(checker, new) == {Auth.GOOD: 2000}
    abandon(store)
    again = StreamStore(tmp_path, period_s=30)
    checker = Verifier(ring_of(7), streams=again.streams)
    assert judged(checker, old + new) == {Auth.REPLAYED: 2500}
    # and who is alive goes on at once
    time.sleep(0.05)
    assert judged(checker, heard_now(10)) == {Auth.GOOD: 10}
    again.close()


def test_frames_that_were_held_up_before_the_last_save_open_no_gap(tmp_path):
    store = StreamStore(tmp_path, period_s=30)
    now = ticks_of(now_us())
    for timestamp, heard in ((now - 2 * SECOND, now - 2 * SECOND), (now - SECOND * 3 // 2, now - SECOND // 2)):
        assert store.streams.admit(7, 1, 0, timestamp, heard) is Auth.GOOD
    store._save(ended=False)
    assert store.streams.admit(7, 1, 0, now, now) is Auth.GOOD  # never saved
    abandon(store)
    again = StreamStore(tmp_path, period_s=30)
    assert again.streams.admit(7, 1, 0, now, ticks_of(now_us())) is Auth.REPLAYED
    again.close()


def test_a_stream_that_wakes_up_before_a_crash_is_not_forgotten(tmp_path):
    store = StreamStore(tmp_path, period_s=30)
    then = ticks_of(now_us()) - 30 * SECOND
    store.streams.restore(StreamRow(7, 1, 0, then, then))
    store._save(ended=False)
    awake = heard_now(100)  # never saved
    assert judged(Verifier(ring_of(7), streams=store.streams), awake) == {Auth.GOOD: 100}
    abandon(store)
    time.sleep(0.05)
    again = StreamStore(tmp_path, period_s=30)
    assert judged(Verifier(ring_of(7), streams=again.streams), awake) == {Auth.REPLAYED: 100}
    again.close()


def test_crashes_one_after_another_change_nothing(tmp_path):
    store = StreamStore(tmp_path, period_s=30)
    then = ticks_of(now_us()) - 1000 * SECOND  # silent for long
    store.streams.restore(StreamRow(7, 1, 0, then + 5_995_000, then))
    for _ in range(4):
        store._save(ended=False)
        abandon(store)
        store = StreamStore(tmp_path, period_s=30)
    assert store.streams.newest(7, 1, 0) == then + 5_995_000
    store.close()


def test_a_new_stream_is_saved_at_once(tmp_path):
    store = StreamStore(tmp_path, period_s=3600)
    number = store._number
    heard = heard_now(10)
    assert judged(Verifier(ring_of(7), streams=store.streams), heard) == {Auth.GOOD: 10}
    assert until(lambda: store._number != number)
    abandon(store)
    again = StreamStore(tmp_path, period_s=3600)
    assert judged(Verifier(ring_of(7), streams=again.streams), heard) == {Auth.REPLAYED: 10}
    again.close()


def test_a_vehicle_that_signs_a_minute_ahead_goes_on_after_a_crash(tmp_path):
    store = StreamStore(tmp_path, period_s=30)
    checker = Verifier(ring_of(7), streams=store.streams)
    assert judged(checker, heard_now(100, ahead=5_995_000)) == {Auth.GOOD: 100}
    store._save(ended=False)
    abandon(store)
    time.sleep(0.05)
    again = StreamStore(tmp_path, period_s=30)
    time.sleep(0.05)
    checker = Verifier(ring_of(7), streams=again.streams)
    assert judged(checker, heard_now(10, ahead=5_995_000)) == {Auth.GOOD: 10}
    again.close()


def test_a_killed_station_has_saved(tmp_path):
    program = """
import sys, time
from pathlib import Path
from mavlink.signing.store import StreamStore
store = StreamStore(Path(sys.argv[1]), period_s=0.02)
for k in range(1, 10**6):
    store.streams.admit(7, 1, 0, k, 0)
    time.sleep(0.001)
    if k == 200:
        print("ready", flush=True)
"""
    child = subprocess.Popen([sys.executable, "-c", program, str(tmp_path)], stdout=subprocess.PIPE)
    assert child.stdout.readline() == b"ready\n"
    child.send_signal(signal.SIGKILL)
    child.wait()
    child.stdout.close()
    store = StreamStore(tmp_path)
    assert store.streams.newest(7, 1, 0) >= 100
    assert store.warning == ""
    store.close()


def test_every_stream_and_the_proven_time_come_back(tmp_path):
    store = StreamStore(tmp_path)
    for k in range(4096):
        store.streams.admit(1 + k % 255, k // 255, k % 3, 2**47 + k, 5)
    before, proven = rows(store), store.streams.proven
    assert proven == 2**47 + 4095 - AHEAD
    store.close()
    store.close()
    again = StreamStore(tmp_path)
    assert rows(again) == before
    assert again.streams.proven == proven
    again.close()


def test_it_is_saved_while_it_runs(tmp_path):
    store = StreamStore(tmp_path, period_s=0.02)
    store.streams.admit(7, 1, 0, 12345, 0)
    copy = tmp_path / "copy"
    copy.mkdir()

    def newest_saved():
        for name in SLOTS:
            if (tmp_path / name).exists():
                (copy / name).write_bytes((tmp_path / name).read_bytes())
        try:
            reader = StreamStore(copy)
        except SigningError:
            return None  # copied in the middle of a write
        newest = reader.streams.newest(7, 1, 0)
        reader.close()
        return newest

    assert until(lambda: newest_saved() is not None)
    assert until(lambda: all((tmp_path / name).exists() for name in SLOTS))
    assert all((tmp_path / name).stat().st_mode & 0o077 == 0 for name in SLOTS)
    store.close()


def filled(folder):
    """Both files written, the second one newer by one second of frames."""
    store = StreamStore(folder, period_s=30)
    now = ticks_of(now_us())
    store.streams.admit(7, 1, 0, now - 1000, now - 1000)
    store._save(ended=False)
    time.sleep(0.02)  # a file's time of change is coarse
    store.streams.admit(7, 1, 0, now, now)
    store.close()
    newest = max(SLOTS, key=lambda name: (folder / name).stat().st_mtime_ns)
    return newest, next(name for name in SLOTS if name != newest), now


def spoilt(data, how):
    if how == "empty":
        return b""
    if how == "cut":
        return data[:-1]
    if how == "zeros":
        return bytes(len(data))
    if how == "longer":
        return data + b"\0"
    flipped = bytearray(data)
    flipped[len(data) // 2] ^= 1
    return bytes(flipped)


HOW = ("empty", "cut", "zeros", "longer", "flipped")


@pytest.mark.parametrize("how", HOW)
def test_when_one_file_is_damaged_the_other_counts(tmp_path, how):
    newest, older, last = filled(tmp_path)
    path = tmp_path / newest
    path.write_bytes(spoilt(path.read_bytes(), how))
    store = StreamStore(tmp_path, period_s=30)
    # the older one does not know the last frames, which are allowed for
    assert store.streams.admit(7, 1, 0, last, last + SECOND) is Auth.HELD
    later = ticks_of(now_us()) + 3 * SECOND
    assert store.streams.admit(7, 1, 0, later, later) is Auth.GOOD
    assert newest in store.warning
    assert store.trouble == ""
    store.close()
    again = StreamStore(tmp_path, period_s=30)
    assert again.warning == ""
    assert (tmp_path / older).exists()
    again.close()


@pytest.mark.parametrize("how", HOW)
def test_when_both_are_damaged_it_says_so_and_stops(tmp_path, how):
    filled(tmp_path)
    for name in SLOTS:
        path = tmp_path / name
        path.write_bytes(spoilt(path.read_bytes(), how))
    before = [(tmp_path / name).read_bytes() for name in SLOTS]
    with pytest.raises(SigningError, match=r"could be replayed; move both away"):
        StreamStore(tmp_path)
    assert [(tmp_path / name).read_bytes() for name in SLOTS] == before
    for name in SLOTS:
        (tmp_path / name).rename(tmp_path / f"{name}.bad")
    store = StreamStore(tmp_path)
    assert rows(store) == []
    store.close()


def test_one_file_damaged_and_the_other_gone(tmp_path):
    newest, older, _ = filled(tmp_path)
    (tmp_path / newest).write_bytes(b"?")
    (tmp_path / older).unlink()
    with pytest.raises(SigningError, match=newest):
        StreamStore(tmp_path)


def test_a_table_of_the_format_before_is_read(tmp_path):
    now = ticks_of(now_us())
    body = struct.pack("<8sQQQ?I", b"RCSTRM1\n", 5, now, now - AHEAD, True, 1) + struct.pack(
        "<BBBQQ", 7, 1, 0, now - SECOND, now
    )
    (tmp_path / SLOTS[1]).write_bytes(body + hashlib.sha256(body).digest())
    store = StreamStore(tmp_path, period_s=30)
    assert rows(store) == [StreamRow(7, 1, 0, now - SECOND, now)]
    assert (store.warning, store.streams.proven) == ("", now - AHEAD)
    store.close()


@pytest.mark.slow_but_first
@pytest.mark.parametrize("torn", range(1, 32))
def test_a_row_that_was_cut_short_by_the_kill_costs_one_frame_at_most(tmp_path, torn):
    store = StreamStore(tmp_path, period_s=30)
    now = ticks_of(now_us())
    for k in range(10):
        assert store.streams.admit(7, 1, 0, now + k, now + 2 * k * SECOND) is Auth.GOOD
    path = store._journal.path
    before = path.read_bytes()
    assert store.streams.admit(7, 1, 0, now + 10, now + 20 * SECOND) is Auth.GOOD
    after = path.read_bytes()
    rows_at = 64 + MAX_STREAMS * 8
    first = next(k for k in range(rows_at, len(after)) if before[k] != after[k]) // 32 * 32
    abandon(store)
    path.write_bytes(before[:first] + after[first : first + torn] + before[first + torn :])
    again = StreamStore(tmp_path, period_s=30)
    assert again.streams.newest(7, 1, 0) in (now + 9, now + 10)
    again.close()


def test_a_journal_from_before_the_computer_was_started_is_not_trusted_to_be_the_newest(tmp_path):
    store = StreamStore(tmp_path, period_s=30)
    now = ticks_of(now_us())
    assert store.streams.admit(7, 1, 0, now, now) is Auth.GOOD
    store._save(ended=False)
    path = store._journal.path
    abandon(store)
    content = bytearray(path.read_bytes())
    content[8:16] = b"00000000"  # another start's mark
    path.write_bytes(content)
    again = StreamStore(tmp_path, period_s=30)
    # frames of the last second may be missing in what was saved
    assert again.streams.admit(7, 1, 0, now + SECOND, now + SECOND) is Auth.HELD
    later = ticks_of(now_us()) + 3 * SECOND
    assert again.streams.admit(7, 1, 0, later, later) is Auth.GOOD
    again.close()


def test_a_power_cut_under_a_clock_that_was_a_day_ahead_holds_nobody_for_a_day(tmp_path):
    store = StreamStore(tmp_path, period_s=30, wall_ns=lambda: time.time_ns() + 86_400 * 10**9)
    now = ticks_of(now_us())
    # the vehicle is right, and was believed by an operator's word
    store.streams.restore(StreamRow(7, 1, 0, now, now + 86_400 * SECOND))
    store._save(ended=False)
    path = store._journal.path
    abandon(store)
    path.unlink()
    again = StreamStore(tmp_path, period_s=30)
    assert again.streams.admit(7, 1, 0, now + SECOND, now + SECOND) is Auth.HELD
    soon = ticks_of(now_us()) + 3 * SECOND
    assert again.streams.admit(7, 1, 0, soon, soon) is Auth.GOOD
    again.close()


def test_two_stations_do_not_share_a_table(tmp_path):
    store = StreamStore(tmp_path)
    with pytest.raises(SigningError, match="another station"):
        StreamStore(tmp_path)
    store.close()
    StreamStore(tmp_path).close()


def test_a_disk_that_fails_is_told(tmp_path, monkeypatch):
    store = StreamStore(tmp_path, period_s=0.02)

    def full(fd):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    assert until(lambda: store.trouble)
    assert "No space left" in store.trouble
    assert "could be replayed" in store.trouble
    monkeypatch.undo()
    assert until(lambda: store.trouble == "")
    store.close()


def test_a_verifier_from_a_folder(tmp_path):
    with pytest.raises(SigningError, match="gcs keys new"):
        open_verifier(tmp_path / "absent")
    folder = tmp_path / "keys"
    folder.mkdir(mode=0o700)
    with pytest.raises(SigningError, match="no key in it"):
        open_verifier(folder)
    write_key(folder, 7, secret_of(7))
    with pytest.raises(SigningError, match="cannot come unsigned"):
        open_verifier(folder, unsigned=[33])
    checker, store = open_verifier(folder)
    heard = heard_now(50)
    assert judged(checker, heard) == {Auth.GOOD: 50}
    store.close()
    checker, store = open_verifier(folder)
    assert judged(checker, heard) == {Auth.REPLAYED: 50}
    store.close()
