"""Pictures without time stamps: MJPEG over HTTP, raw H.264 over TCP; and RTMP that is pushed here."""

from __future__ import annotations

import base64
import contextlib
import socket
import threading
from types import SimpleNamespace

import av
import numpy as np
import pytest

from tests.support.ports import free_port
from tests.support.video_senders import HEIGHT, WIDTH, coded, image, mjpeg, number_of, pictures
from tests.support.waiting import until
from vision.stream import byte_stream
from vision.stream import stamps as stamps_module
from vision.stream.connection import datagrams, open_input
from vision.stream.source import parse_source
from vision.stream.stamps import HeldBack
from vision.stream.stream import VideoStream
from vision.video.video import VideoFile

N, STEP_S, T0_S = 40, 0.1, 1_790_000_000.0


def h264():
    yield from pictures(
        N, "libx264", "yuv420p", preset="ultrafast", tune="zerolatency", **{"x264-params": "bframes=0:repeat-headers=1"}
    )


SENDERS = {
    "mjpeg": ("http://10.0.0.2/", lambda: mjpeg(N, True)),
    "mjpeg without lengths": ("http://10.0.0.2/", lambda: mjpeg(N, False)),
    "h264": ("tcp://10.0.0.2:5000", h264),
}


@pytest.mark.parametrize("kind", SENDERS)
@pytest.mark.parametrize("pieces", [1, 3])
def test_pictures_without_time_stamps_are_dated_by_when_they_came(kind, pieces, monkeypatch):
    address, frames = SENDERS[kind]
    now_s = [0.0]

    class Line:
        def demux(self):
            for number, data in enumerate(frames()):
                size = -(-len(data) // pieces)
                for at in range(0, len(data), size):
                    now_s[0] = T0_S + number * STEP_S + at * 1e-6
                    yield data[at : at + size]

        def close(self):
            now_s[0] = -1.0

    monkeypatch.setattr(byte_stream, "av", SimpleNamespace(open=lambda *_, **__: Line()))
    monkeypatch.setattr(byte_stream, "time", SimpleNamespace(time=lambda: now_s[0]))
    opened = open_input(parse_source(address))
    came_s = []
    with contextlib.suppress(av.FFmpegError):  # it ends in the middle of a part
        came_s += ((packet.pts * opened.tick_s, opened.arrival_s(packet)) for packet in opened.packets if packet.size)
    opened.close()
    assert len(came_s) >= N - 2, "a part whose end does not come is none"
    for k, times in enumerate(came_s[:N]):
        assert times == pytest.approx((T0_S + k * STEP_S,) * 2, abs=2e-3)
    assert now_s[0] == -1.0


class TakingTurns:
    """Where datagrams of each of N frames come from, and the time at which the last one came."""

    def __init__(self):
        self.arrival_s, self.live = 0.0, True
        self.senders = SimpleNamespace(shown=lambda: None)
        self._datagrams = ((k, data) for k, frame in enumerate(coded(N)) for data in frame)

    def wait(self):
        return SimpleNamespace(kind="mpegts")

    def read(self):
        number, data = next(self._datagrams, (0, b""))
        self.arrival_s = T0_S + number * STEP_S
        return data

    def demux(self):
        while data := self.read():
            yield data

    def close(self):
        self.live = False


@pytest.mark.parametrize("by", ["datagrams", "tcp", "http"])
def test_pictures_of_a_transport_stream_came_when_their_first_bytes_did(by, monkeypatch):
    """Not when the container handed them out, which is with the picture after the next one."""
    line = TakingTurns()
    if by != "datagrams":
        monkeypatch.setattr(byte_stream, "av", SimpleNamespace(open=lambda *_, **__: line))
        monkeypatch.setattr(byte_stream, "time", SimpleNamespace(time=lambda: line.arrival_s))
        opened = open_input(parse_source(f"{by}://10.0.0.2:5000"))
    else:
        opened = datagrams(parse_source("udp://:5600"), line, lambda: True)
    came_s = [opened.arrival_s(packet) for packet in opened.packets if packet.size]
    opened.close()
    assert came_s == pytest.approx(T0_S + STEP_S * np.arange(N), abs=1e-6)


@pytest.mark.parametrize(
    ("stamps", "early"),
    [
        ([0, 3000, 6000, 9000], [0, 3000, 3000, 3000]),
        # a silence is no step: to date a picture early is remembered long
        ([0, 3000, 93_000, 96_000], [0, 3000, 3000, 3000]),
        # shown in another order than coded
        ([0, 9000, 3000, 6000], [0, 9000, 6000, 3000]),
        ([5, 5, None, 5], [0, 0, 0, 0]),
    ],
)
def test_frames_that_come_out_with_the_next_one_came_earlier(stamps, early, monkeypatch):
    monkeypatch.setattr(stamps_module, "time", SimpleNamespace(time=lambda: T0_S))
    arrival_s = HeldBack(1 / 90_000)
    came_s = [arrival_s(SimpleNamespace(pts=stamp, dts=None)) for stamp in stamps]
    assert T0_S - np.array(came_s) == pytest.approx(np.array(early) / 90_000, abs=1e-6)


def serve_pictures(listener, password):
    """MJPEG for who knows the password, until he goes."""
    wanted = b"Basic " + base64.b64encode(f"eve:{password}".encode())
    with contextlib.suppress(OSError):
        while True:
            client, _ = listener.accept()
            with client, contextlib.suppress(ConnectionError):
                if wanted not in client.recv(4096):
                    client.sendall(b'HTTP/1.1 401 Unauthorized\r\nWWW-Authenticate: Basic realm="x"\r\n\r\n')
                    continue
                client.sendall(b"HTTP/1.1 200 OK\r\nContent-Type: multipart/x-mixed-replace;boundary=frame\r\n\r\n")
                for part in mjpeg(N, True):
                    client.sendall(part)


def test_a_camera_with_a_password_is_recorded_over_http(tmp_path):
    rows = []
    with socket.create_server(("127.0.0.1", 0)) as listener:
        threading.Thread(target=serve_pictures, args=(listener, "pa#ss"), daemon=True).start()
        address = f"http://eve:pa#ss@127.0.0.1:{listener.getsockname()[1]}/video"
        with VideoStream(address, tmp_path / "video.mkv", on_frame=lambda *row: rows.append(row)) as stream:
            assert until(lambda: len(rows) >= N)
            assert "pa#ss" not in stream.url + stream.error
    with VideoFile.open(tmp_path / "video.mkv", np.array([t_us for _, t_us in rows])) as film:
        assert [number_of(frame.image) for frame in film.frames()][:N] == list(range(N))


def push(port, until_s=6.0):
    """A clip as a telephone's app pushes it."""
    address = f"rtmp://127.0.0.1:{port}/live/key"
    with av.open(address, "w", format="flv", timeout=until_s) as container:
        stream = container.add_stream("libx264", rate=25, options={"preset": "ultrafast", "tune": "zerolatency"})
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, "yuv420p"
        stream.codec_context.gop_size = 10
        for number in range(N):
            frame = av.VideoFrame.from_ndarray(image(number), format="bgr24")
            frame.pts = number
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))


@pytest.mark.slow
def test_what_is_pushed_by_rtmp_is_recorded_one_after_the_other(tmp_path):
    rows, port = [], free_port(socket.SOCK_STREAM)
    with VideoStream(
        f"rtmp://0.0.0.0:{port}/live", tmp_path / "video.mkv", on_frame=lambda *row: rows.append(row)
    ) as stream:
        for times in (1, 2):

            def pushed():
                with contextlib.suppress(av.FFmpegError, OSError):  # not listened yet
                    push(port)
                    return True

            assert until(pushed)
            assert until(lambda times=times: len(rows) >= times * N)
        assert "cannot be opened" not in stream.error
    with VideoFile.open(tmp_path / "video.mkv", np.array([t_us for _, t_us in rows])) as film:
        assert [number_of(frame.image) for frame in film.frames()] == 2 * list(range(N))
