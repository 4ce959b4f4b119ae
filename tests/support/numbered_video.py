"""Video whose frames show their number: in a file, or coded once and sent as MPEG-TS datagrams in real time."""

from __future__ import annotations

import socket
import threading
import time
from fractions import Fraction
from functools import lru_cache

import av
import numpy as np

FPS, GOP, BITS = 25, 10, 10
WIDTH, HEIGHT = 160, 96
PIECE = 7 * 188


def image(number):
    """The number as ten bars, light for 1."""
    image = np.zeros((HEIGHT, WIDTH, 3), dtype=np.uint8)
    for bit in range(BITS):
        if number >> bit & 1:
            image[:, bit * 16 : bit * 16 + 16] = 255
    return image


def number_of(image):
    return sum(1 << bit for bit in range(BITS) if image[HEIGHT // 2, bit * 16 + 8].mean() > 127)


def steady(n):
    """Times in ms of frames at 25 a second."""
    return np.arange(n) * 1000 // FPS


def write_clip(path, pts_ms, *, gop=12, bframes=2):
    """A clip whose i-th frame is shown at ``pts_ms[i]`` and carries the number i."""
    with av.open(str(path), "w") as container:
        options = {"preset": "ultrafast", "x264-params": f"bframes={bframes}"}
        stream = container.add_stream("libx264", rate=30, options=options)
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, "yuv420p"
        stream.codec_context.gop_size = gop
        stream.codec_context.time_base = Fraction(1, 1000)
        for number, pts in enumerate(pts_ms):
            frame = av.VideoFrame.from_ndarray(image(number), format="bgr24")
            frame.pts, frame.time_base = int(pts), Fraction(1, 1000)
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path


class _Sink:
    def __init__(self):
        self.data = b""

    def write(self, data):
        self.data += data
        return len(data)


@lru_cache
def coded(n, times_ms=None):
    """Datagrams of each of n frames; ``times_ms`` instead of an even pace."""
    sink, frames = _Sink(), []
    with av.open(sink, "w", format="mpegts", options={"flush_packets": "1", "pat_period": "0.1"}) as container:
        options = {"preset": "ultrafast", "tune": "zerolatency", "x264-params": "bframes=0:repeat-headers=1"}
        stream = container.add_stream("libx264", rate=FPS, options=options)
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, "yuv420p"
        stream.codec_context.gop_size = GOP
        stream.codec_context.time_base = Fraction(1, 1000)
        for number in range(n):
            frame = av.VideoFrame.from_ndarray(image(number), format="bgr24")
            frame.pts = times_ms[number] if times_ms else number * 1000 // FPS
            frame.time_base = Fraction(1, 1000)
            container.mux(stream.encode(frame))
            data, sink.data = sink.data, b""
            frames.append([data[at : at + PIECE] for at in range(0, len(data), PIECE)])
    return frames


class Sender(threading.Thread):
    """Sends frames to a port of this machine; ``spoil`` turns each datagram into those that arrive."""

    def __init__(self, port, frames, *, times_ms=None, spoil=lambda data: [data]):
        super().__init__(daemon=True)
        self.sent = 0
        self.stamps_s = []
        self._port, self._frames, self._times_ms, self._spoil = port, frames, times_ms, spoil
        self._halt = threading.Event()

    def run(self):
        begin = time.monotonic()
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as outlet:
            for number, datagrams in enumerate(self._frames):
                due = self._times_ms[number] / 1000 if self._times_ms else number / FPS
                if self._halt.wait(max(begin + due - time.monotonic(), 0)):
                    return
                for data in datagrams:
                    for piece in self._spoil(data):
                        outlet.sendto(piece, ("127.0.0.1", self._port))
                self.stamps_s.append(time.time())
                self.sent += 1

    def __enter__(self):
        self.start()
        return self

    def __exit__(self, *args):
        self._halt.set()
        self.join(5)


def reconnects(stream):
    """Connections of a video stream after the first."""
    return max(stream._progress.connections - 1, 0)
