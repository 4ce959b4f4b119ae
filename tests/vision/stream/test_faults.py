"""Live video among bad senders, dead servers and a process that is killed: it goes on, and says what is missing."""

from __future__ import annotations

import os
import random
import signal
import socket
import sys
import threading
import time

import numpy as np
import pytest

from infra.processes.child_process import ChildProcess
from tests.support.ports import free_port
from tests.support.video_senders import FPS, GOP, Sender, coded, number_of, reconnects
from tests.support.waiting import until
from vision.stream.stream import VideoStream
from vision.stream.stream_worker import WAITING_PATIENCE_S
from vision.video.video import VideoFile

CLIP = 1000


class Watched:
    """A stream on a free port, and the rows it lists."""

    def __init__(self, folder, **options):
        self.port, self.rows, self.path = free_port(), [], folder / "video.mkv"
        self.stream = VideoStream(f"udp://127.0.0.1:{self.port}", self.path, on_frame=self.row, **options)

    def row(self, index, t_us):
        self.rows.append((index, t_us))

    def __enter__(self):
        return self

    def __exit__(self, *args):
        self.stream.close()

    def shows(self, n):
        return until(lambda: len(self.rows) >= n)

    def film(self):
        """(index, number) of all recorded frames, after a look at their rows."""
        self.stream.close()
        assert [index for index, _ in self.rows] == list(range(len(self.rows)))
        times = np.array([t_us for _, t_us in self.rows])
        assert (np.diff(times) > 0).all()
        with VideoFile.open(self.path, times) as video:
            assert video.n <= len(times)
            return [(frame.index, number_of(frame.image)) for frame in video.frames()], video


@pytest.mark.slow
def test_nothing_is_lost_whenever_the_sender_begins(tmp_path):
    """The port is bound before the process runs and stays so: the first frame sent is the first recorded."""
    with Watched(tmp_path) as watched, Sender(watched.port, coded(CLIP)[:40]) as sender:
        assert until(lambda: sender.sent == 40)
        assert watched.shows(39)
    film, _ = watched.film()
    assert film == [(k, k) for k in range(40)]


@pytest.mark.slow
def test_a_sender_that_returns_at_any_moment_is_recorded_within_a_group_of_frames(tmp_path):
    rng = random.Random(5)
    with Watched(tmp_path) as watched:
        for pause_s in (0.0, 0.7, rng.uniform(1.5, 2.5)):
            time.sleep(pause_s)
            with Sender(watched.port, coded(CLIP)[100:160]) as sender:
                assert watched.shows(len(watched.rows) + 5)
                assert until(lambda sender=sender: sender.sent >= 40)
        assert until(lambda: reconnects(watched.stream) == 2)
    film, video = watched.film()
    numbers = [number for _, number in film]
    starts = [0, *(k for k in range(1, len(numbers)) if numbers[k] < numbers[k - 1])]
    assert len(starts) == 3 and video.missing == 0
    assert numbers[0] == 100
    assert all(numbers[k] <= 100 + GOP for k in starts[1:])


@pytest.mark.slow
def test_a_silent_sender_is_told_and_taken_back(tmp_path):
    with Watched(tmp_path) as watched:
        with Sender(watched.port, coded(CLIP)[:500]) as sender:
            assert until(lambda: len(watched.rows) >= 45 and not watched.stream.stalled and watched.stream.connected)
        count = sender.sent
        assert watched.shows(count - 1)
        assert until(lambda: watched.stream.stalled)
        assert not watched.stream.connected
        # what the transport held back to the end is not news: it stays stalled until something comes
        assert not until(lambda: not watched.stream.stalled, 3)
        with Sender(watched.port, coded(CLIP)[500:]):
            assert until(lambda: not watched.stream.stalled and len(watched.rows) > count + 10)
        assert watched.stream.restarts == 0 and watched.stream.recording_error == ""
    film, video = watched.film()
    assert {number for _, number in film} >= {*range(count - 1), *range(500, 510)} and video.missing == 0
    assert not (tmp_path / "video.1.mkv").exists()


@pytest.mark.slow_but_first
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP], ids=lambda n: n.name)
def test_a_process_that_dies_or_hangs_is_started_again(tmp_path, number):
    with Watched(tmp_path) as watched, Sender(watched.port, coded(CLIP)):
        assert watched.shows(30)
        victim = watched.stream.process_id
        os.kill(victim, number)
        assert until(lambda: watched.stream.restarts == 1)
        assert "started again" in watched.stream.error
        before = len(watched.rows)
        assert watched.shows(before + 20) and watched.stream.process_id != victim
        frame = watched.stream.latest(60.0)
        assert frame is not None and frame.index >= before
    film, video = watched.film()
    numbers = [k for _, k in film]
    assert video.missing <= 2
    second = next(index for index, k in film if index and k != dict(film).get(index - 1, -1) + 1)
    # what was sent meanwhile waited at the port: at most the rest of a group of pictures is gone
    assert (
        numbers == sorted(numbers) and dict(film)[second] - dict(film)[max(i for i, _ in film if i < second)] <= 2 * GOP
    )
    assert (tmp_path / "video.1.mkv").exists()


def test_a_process_that_waits_for_its_disk_is_not_ended(tmp_path, monkeypatch):
    with Watched(tmp_path) as watched, Sender(watched.port, coded(CLIP)):
        assert watched.shows(30)
        monkeypatch.setattr(ChildProcess, "waits_for_disk", property(lambda process: True))
        victim = watched.stream.process_id
        os.kill(victim, signal.SIGSTOP)
        time.sleep(WAITING_PATIENCE_S + 1.0)
        assert watched.stream.stalled and watched.stream.process_id == victim
        os.kill(victim, signal.SIGCONT)
        assert watched.shows(len(watched.rows) + 10)
        assert watched.stream.restarts == 0 and watched.stream.process_id == victim
    assert not (tmp_path / "video.1.mkv").exists()


@pytest.mark.slow
def test_damage_on_the_way_is_counted_and_never_raises(tmp_path):
    rng = random.Random(6)

    def spoil(data):
        if rng.random() < 0.1:
            return []
        body = bytearray(data)
        for _ in range(rng.randrange(3) if rng.random() < 0.3 else 0):
            body[rng.randrange(len(body))] ^= 1 << rng.randrange(8)
        return [bytes(body)]

    with Watched(tmp_path) as watched:
        with Sender(watched.port, coded(CLIP)[:100], spoil=spoil) as sender:
            assert until(lambda: sender.sent == 100)
        with Sender(watched.port, coded(CLIP)[100:]) as sender:
            before = len(watched.rows)
            assert watched.shows(before + 20)
            assert until(lambda: sender.sent > 30 and watched.rows[-1][1] * 1e-6 > sender.stamps_s[30])
        assert watched.stream.damaged + watched.stream.undecoded > 0
        assert watched.stream.restarts == 0
    film, _ = watched.film()
    assert {number for _, number in film} >= set(range(120, 125))  # the next whole group of pictures


@pytest.mark.slow
def test_strangers_on_the_port_do_not_disturb(tmp_path):
    stop = threading.Event()

    def shout(port):
        rng = random.Random(7)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as outlet:
            while not stop.wait(0.002):
                outlet.sendto(rng.randbytes(188), ("127.0.0.1", port))

    with Watched(tmp_path) as watched, Sender(watched.port, coded(CLIP)[:80]) as sender:
        noise = threading.Thread(target=shout, args=(watched.port,))
        assert watched.shows(1)
        noise.start()
        try:
            assert until(lambda: sender.sent == 80)
            assert watched.shows(78)
        finally:
            stop.set()
            noise.join()
        assert watched.stream.damaged == 0
    film, _ = watched.film()
    assert [number for _, number in film][:78] == list(range(78))


def test_a_server_that_never_answers_is_given_up_and_tried_again():
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(60)
        with VideoStream(f"rtsp://127.0.0.1:{server.getsockname()[1]}/main") as stream:
            first, _ = server.accept()
            # a bound on waiting, not on speed: without it FFmpeg takes half a minute
            assert until(lambda: "no answer within 3 s" in stream.error)
            second, _ = server.accept()
            assert stream.restarts == 0 and not stream.connected and stream.stalled
        first.close()
        second.close()


def test_a_taken_port_is_told_and_had_once_it_is_free(tmp_path):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as holder:
        holder.bind(("127.0.0.1", 0))
        port = holder.getsockname()[1]
        stream = VideoStream(f"udp://127.0.0.1:{port}", tmp_path / "video.mkv")
        assert until(lambda: "cannot be bound" in stream.error)
    with stream, Sender(port, coded(CLIP)):
        assert until(lambda: stream.received > 10)


def test_a_slow_consumer_sees_the_present(tmp_path):
    """Frames that had come before the one shown was asked for, and are newer than it."""
    behind = []
    with Watched(tmp_path) as watched, Sender(watched.port, coded(CLIP)) as sender:
        while len(behind) < 25:
            time.sleep(0.1)
            sent = sender.sent
            assert watched.shows(sent - 2)
            frame = watched.stream.latest(60.0)
            assert frame is not None
            behind.append(sent - 1 - number_of(frame.image))
    assert watched.stream.skipped > 25
    # half a second of film; the first ones waited for the process to start
    assert np.median(behind[5:]) <= FPS // 2


def test_times_are_those_of_the_time_stamps_when_the_pace_varies(tmp_path):
    times_ms = tuple(np.cumsum(np.random.default_rng(8).integers(10, 120, 60)).tolist())
    with Watched(tmp_path) as watched, Sender(watched.port, coded(60, times_ms), times_ms=times_ms) as sender:
        assert watched.shows(58)
        assert until(lambda: sender.sent == 60)
    watched.stream.close()
    listed = np.array([t_us for _, t_us in watched.rows]) * 1e-6
    stamps = np.array(times_ms[: len(listed)]) * 1e-3
    # a frame that comes sooner than all before it sets the clock back, and nothing sets it forward
    assert (np.diff(listed) - np.diff(stamps)).max() < 2e-3
    # and so by when the quickest so far was sent, however late the others were
    quickest = np.minimum.accumulate(np.array(sender.stamps_s[: len(listed)]) - stamps)
    offset_s = listed - stamps - quickest
    assert offset_s.min() > -0.05 and np.median(offset_s) < 0.3  # a busy machine notes late that it sent


@pytest.mark.slow
def test_time_stamps_that_begin_anew_on_the_same_port_go_on_in_order(tmp_path):
    """An encoder that restarts behind the same radio: no other sender, no pause, time stamps from zero."""
    with Watched(tmp_path) as watched:
        again = [*coded(CLIP)[:40], *coded(CLIP)[:40]]
        with Sender(watched.port, again) as sender:
            assert until(lambda: sender.sent == 80)
            assert watched.shows(77)
    film, _ = watched.film()
    assert [number for _, number in film][:75] == [*range(40), *range(35)]
    times = np.diff([t_us for _, t_us in watched.rows])
    assert times.max() < 1e6 * (1.0 + np.diff(sender.stamps_s).max())


@pytest.mark.slow
def test_a_process_may_be_stopped_by_many_threads_at_once(tmp_path):
    """Each closes what is its own: a descriptor that is closed twice may be somebody else's by then."""
    sys.setswitchinterval(1e-6)
    failed = []
    try:
        for k in range(3):
            folder = tmp_path / str(k)
            folder.mkdir()
            with Watched(folder) as watched:
                process = watched.stream._supervisor.process

                def stop(process=process):
                    try:
                        process.channel.close_sending()
                    except OSError as error:
                        failed.append(error)

                threads = [threading.Thread(target=stop) for _ in range(20)]
                for thread in threads:
                    thread.start()
                for thread in threads:
                    thread.join()
    finally:
        sys.setswitchinterval(0.005)
    assert failed == []
