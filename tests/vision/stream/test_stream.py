"""Live video over the loopback: what is listed is what is recorded, nothing waits for ever, nothing is printed."""

from __future__ import annotations

import signal
import socket
import subprocess
import sys
import threading
import time
from fractions import Fraction

import av
import numpy as np
import pytest

from tests.support.ports import free_port
from tests.support.video_senders import FPS, image, number_of, reconnects
from tests.support.waiting import until
from vision.errors import VideoError
from vision.stream.frame_clock import CREEP, ArrivalClock
from vision.stream.messages import Progress
from vision.stream.stream import VideoStream
from vision.video.recording import DisplayOrder
from vision.video.video import VideoFile


def encode(target, n, *, kind=None, pace=False, bframes=0, stop=None, gop=10):
    with av.open(str(target), "w", format=kind) as container:
        options = {"preset": "ultrafast", "tune": "zerolatency", "x264-params": f"bframes={bframes}:repeat-headers=1"}
        stream = container.add_stream("libx264", rate=FPS, options=options)
        stream.width, stream.height, stream.pix_fmt = 160, 96, "yuv420p"
        stream.codec_context.gop_size = gop
        begin = time.monotonic()
        for number in range(n):
            if pace:
                time.sleep(max(begin + number / FPS - time.monotonic(), 0))
            if stop is not None and stop.is_set():
                return
            frame = av.VideoFrame.from_ndarray(image(number), format="bgr24")
            frame.pts, frame.time_base = number, Fraction(1, FPS)
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))


def frames(stream, within_s=120.0):
    """What a file shows, to its end."""
    deadline = time.monotonic() + within_s
    while time.monotonic() < deadline:
        ended, frame = stream.ended, stream.latest(0.5)
        if frame is not None:
            yield frame
        elif ended:
            return
    raise AssertionError(f"no end within {within_s} s: {stream.error}")


@pytest.fixture
def sender():
    """Starts a live MPEG-TS sender; gives its URL."""
    stop, threads = threading.Event(), []

    def start(n=1000, url=None, kind="mpegts"):
        url = url or f"udp://127.0.0.1:{free_port()}"
        out = f"{url}?pkt_size=1316" if kind == "mpegts" else url
        thread = threading.Thread(target=encode, args=(out, n), kwargs={"kind": kind, "pace": True, "stop": stop})
        thread.start()
        threads.append(thread)
        return url

    yield start
    stop.set()
    for thread in threads:
        thread.join(60)


def test_what_is_listed_is_what_is_recorded(tmp_path, sender, capfd):
    rows, shown, begin_us = [], [], time.time() * 1e6
    url = sender()
    stream = VideoStream(url, tmp_path / "video.mkv", on_frame=lambda index, t_us: rows.append((index, t_us)))
    end = time.monotonic() + 60.0
    while (len(rows) < 2 * FPS or len(shown) < FPS) and time.monotonic() < end:
        frame = stream.latest(0.2)
        if frame is not None:
            shown.append((frame.index, frame.t_us, number_of(frame.image)))
    assert until(lambda: stream.connected and not stream.stalled)
    stream.close()
    end_us = time.time() * 1e6
    assert stream.recording_error == "" and stream.received == len(rows) >= 2 * FPS
    assert [index for index, _ in rows] == list(range(len(rows)))
    times = np.array([t_us for _, t_us in rows])
    # a frame is known to be whole when the next one begins, so that the last one's time may be a little ahead
    assert begin_us < times[0] and times[-1] < end_us + 2e6 / FPS
    assert (np.diff(times) > 0).all()
    # even as the time stamps; while the first ones are late on a busy machine, the clock still comes nearer
    assert np.diff(times).max() < 1e6 / FPS + 2000
    with VideoFile.open(tmp_path / "video.mkv", times) as video:
        assert (video.n, video.mismatch) == (len(rows), 0)
        recorded = {frame.index: (frame.t_us, number_of(frame.image)) for frame in video.frames()}
    assert len(shown) >= FPS
    assert all(recorded[index] == (t_us, number) for index, t_us, number in shown)
    assert capfd.readouterr() == ("", "")


@pytest.mark.slow_but_first
@pytest.mark.parametrize(
    ("encoder", "key", "source"),
    [
        ("libx264", "x264-params", "udp://127.0.0.1:{port}"),
        ("libx265", "x265-params", "rtp://127.0.0.1:{port}?codec=h265"),
    ],
)
def test_rtp_is_received_as_well(tmp_path, encoder, key, source):
    """Another codec and another wrapping, found out or named; every frame from the first on."""
    port, rows = free_port(), []
    stream = VideoStream(source.format(port=port), tmp_path / "video.mkv", on_frame=lambda *row: rows.append(row))
    extra = ":log-level=none:pools=none" if encoder == "libx265" else ""
    with av.open(f"rtp://127.0.0.1:{port}", "w", format="rtp") as container:
        options = {"preset": "ultrafast", "tune": "zerolatency", key: f"bframes=0:repeat-headers=1{extra}"}
        coded = container.add_stream(encoder, rate=FPS, options=options)
        coded.width, coded.height, coded.pix_fmt = 160, 96, "yuv420p"
        coded.codec_context.gop_size = 10
        begin = time.monotonic()
        for number in range(50):
            time.sleep(max(begin + number / FPS - time.monotonic(), 0))
            container.mux(coded.encode(av.VideoFrame.from_ndarray(image(number), format="bgr24")))
        container.mux(coded.encode(None))
    assert until(lambda: len(rows) == 50)
    frame = stream.latest(60.0)
    assert frame is not None and number_of(frame.image) == frame.index == 49
    stream.close()
    assert (stream.received, stream.damaged, stream.undecoded, stream.error) == (50, 0, 0, "")
    assert np.diff([t_us for _, t_us in rows]).max() < 1e6 / FPS + 2000
    with VideoFile.open(tmp_path / "video.mkv") as video:
        assert [number_of(frame.image) for frame in video.frames()] == list(range(50))


def test_a_slow_reader_gets_the_newest_and_the_rest_is_counted(tmp_path):
    encode(tmp_path / "clip.mp4", 40)
    rows = []
    with VideoStream(str(tmp_path / "clip.mp4"), on_frame=lambda index, _: rows.append(index)) as stream:
        seen, behind, listed = [], [], 0
        for frame in frames(stream):
            assert number_of(frame.image) == frame.index
            seen.append(frame.index)
            behind.append(listed - frame.index)
            time.sleep(0.2)
            listed = len(rows)  # before the next is asked for
        assert np.median(behind) <= FPS // 2
        assert stream.ended and not stream.stalled
        assert rows == list(range(40)) and seen == sorted(set(seen)) and seen[-1] == 39
        assert stream.skipped + len(seen) == 40
    assert stream.latest(0.0) is None


def test_frames_stored_out_of_order_are_listed_in_order(tmp_path):
    path = tmp_path / "clip.mp4"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=FPS, options={"x264-params": "bframes=3:b-adapt=0"})
        stream.width, stream.height, stream.pix_fmt = 160, 96, "yuv420p"
        for number in range(30):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image(number), format="bgr24")))
        container.mux(stream.encode(None))
    rows, shown = [], {}
    live = VideoStream(str(path), tmp_path / "copy.mkv", on_frame=lambda index, t_us: rows.append((index, t_us)))
    for frame in frames(live):
        shown[frame.index] = number_of(frame.image)
    live.close()
    assert [index for index, _ in rows] == list(range(30))
    assert all(index == number for index, number in shown.items()) and shown
    with VideoFile.open(tmp_path / "copy.mkv") as video:
        assert [number_of(frame.image) for frame in video.frames()] == list(range(30))


def test_it_connects_again_and_goes_on_in_the_same_recording(tmp_path, sender):
    url = sender(n=40)
    rows = []
    stream = VideoStream(url, tmp_path / "video.mkv", on_frame=lambda index, t_us: rows.append((index, t_us)))
    assert until(lambda: rows and stream.stalled)
    first = len(rows)
    assert first > 5
    sender(url=url)
    assert until(lambda: stream.received >= first + 10)
    stream.close()
    assert reconnects(stream) == 1 and stream.received >= first + 10
    assert [index for index, _ in rows] == list(range(len(rows)))
    assert (np.diff([t_us for _, t_us in rows]) > 0).all()
    with VideoFile.open(tmp_path / "video.mkv") as video:
        assert video.n == len(rows)
        assert len(list(video.frames())) >= len(rows) - 1


def test_silence_is_told_and_closing_does_not_wait_for_it(capfd):
    with VideoStream(f"udp://127.0.0.1:{free_port()}", stall_s=0.2) as stream:
        assert stream.latest(0.1) is None
        assert until(lambda: stream.stalled)
        assert not stream.connected
        process = stream._supervisor.process
    assert process._process.poll() == 0, "it waited for nobody, and was not killed"
    assert capfd.readouterr() == ("", "")


def test_a_slow_stream_has_not_stalled_between_its_frames():
    """One frame a second: it stalls after some of its own intervals."""
    rows = [(k, k * 1_000_000) for k in range(6)]
    with VideoStream(f"udp://127.0.0.1:{free_port()}") as stream:
        stream._take_progress(Progress(connected=True, patience_s=20.0, rows=rows))
        for silent_s, stalls in ((1.6, False), (2.6, True)):
            stream._heard_s = time.monotonic() - silent_s
            assert stream.stalled == stalls


def test_a_refused_connection_is_tried_again():
    with VideoStream(f"tcp://127.0.0.1:{free_port(socket.SOCK_STREAM)}") as stream:
        assert until(lambda: stream.error)
        assert "cannot be opened" in stream.error and "\n" not in stream.error
        assert stream._supervisor._thread.is_alive()
    assert not stream._supervisor._thread.is_alive()


def test_a_recording_is_never_overwritten(tmp_path):
    path = tmp_path / "video.mkv"
    path.write_bytes(b"precious")
    with pytest.raises(VideoError, match="exists already"):
        VideoStream("udp://127.0.0.1:1", path)
    assert path.read_bytes() == b"precious"


@pytest.mark.slow
def test_after_a_kill_the_recording_plays_to_a_second_before(tmp_path):
    encode(tmp_path / "clip.mp4", 200)
    code = (
        "import sys, time; from pathlib import Path; from vision.stream.stream import VideoStream\n"
        "s = VideoStream(sys.argv[1], Path(sys.argv[2]), on_frame=lambda i, t: print(i, flush=True))\n"
        "time.sleep(600)"
    )
    command = [sys.executable, "-c", code, str(tmp_path / "clip.mp4"), str(tmp_path / "video.mkv")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process:
        assert process.stdout is not None
        lines = [process.stdout.readline() for _ in range(2 * FPS)]
        process.send_signal(signal.SIGKILL)
    assert lines[-1].strip() == str(2 * FPS - 1)  # nothing else was printed
    with VideoFile.open(tmp_path / "video.mkv") as video:
        assert video.n >= FPS
        assert [number_of(frame.image) for frame in video.frames()] == list(range(video.n))
        assert number_of(video.read(video.n // 2).image) == video.n // 2


def test_the_least_delay_is_the_anchor_and_may_only_creep_up():
    clock = ArrivalClock()
    for stamp, delay in ((0.0, 0.3), (0.1, 0.05), (0.2, 0.5), (0.3, 0.06)):
        clock.add(stamp, 1000.0 + stamp + delay)
    assert clock.unix_s(0.3) == pytest.approx(1000.35, abs=1e-3)
    for second in range(1, 101):
        clock.add(float(second), 1001.0 + second)
    assert clock.unix_s(0.0) == pytest.approx(1000.05 + 101 * CREEP, abs=1e-3)
    clock.add(0.0, 2000.0)  # the sender began anew
    assert clock.unix_s(0.0) == 2000.0


def test_order_is_by_time_stamp_and_repeats_are_known():
    order = DisplayOrder()
    released = [pair for pts, dts in ((0, 0), (3, 1), (1, 1), (2, 2), (6, 3)) for pair in order.add(pts, dts)]
    assert released == [(0, 0), (1, 1), (2, 2), (3, 3)]
    assert order.repeats(2) and order.repeats(6) and not order.repeats(5)
    assert order.place(7) == 5
    assert order.flush() == [(4, 6)] and not order.repeats(0)
