"""Video whose frames show their number: in a file, sent as MPEG-TS datagrams, as RTP, or served over RTSP."""

from __future__ import annotations

import contextlib
import re
import socket
import struct
import threading
import time
from fractions import Fraction
from functools import lru_cache

import av
import numpy as np

from tests.support.ports import free_port
from vision.stream.rtp import parse

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


def write_clip(path, pts_ms, *, gop=12, bframes=2, aspect=1):
    """A clip whose i-th frame is shown at ``pts_ms[i]`` and carries the number i."""
    with av.open(str(path), "w") as container:
        options = {"preset": "ultrafast", "x264-params": f"bframes={bframes}"}
        stream = container.add_stream("libx264", rate=30, options=options)
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, "yuv420p"
        stream.codec_context.gop_size = gop
        stream.codec_context.time_base = Fraction(1, 1000)
        stream.codec_context.sample_aspect_ratio = Fraction(aspect)
        for number, pts in enumerate(pts_ms):
            frame = av.VideoFrame.from_ndarray(image(number), format="bgr24")
            frame.pts, frame.time_base = int(pts), Fraction(1, 1000)
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path


def remuxed(source, out, *, earlier_ms=0, turned=0, cover=False):
    """A copy of a clip, its first part hidden by an edit list, its pictures turned, behind a picture of one frame."""
    with av.open(str(source)) as old, av.open(str(out), "w") as new:
        stream = old.streams.video[0]
        if cover:
            picture = new.add_stream("mjpeg")
            picture.width, picture.height, picture.pix_fmt = WIDTH, HEIGHT, "yuvj420p"
        copy = new.add_stream_from_template(stream)
        if turned:
            copy.set_display_rotation(turned)
        if cover:
            new.mux(picture.encode(av.VideoFrame.from_ndarray(image(1000), format="bgr24")))
            new.mux(picture.encode(None))
        for packet in old.demux(stream):
            if packet.size:
                earlier = round(earlier_ms / 1000 / packet.time_base)
                packet.pts, packet.dts, packet.stream = packet.pts - earlier, packet.dts - earlier, copy
                new.mux(packet)
    return out


def pictures(n, codec, pixels, **options):
    """The first n pictures, each as coded alone."""
    encoder = av.CodecContext.create(codec, "w")
    encoder.width, encoder.height, encoder.pix_fmt = WIDTH, HEIGHT, pixels
    encoder.time_base, encoder.framerate, encoder.gop_size = Fraction(1, 25), Fraction(25), 10
    encoder.options = options
    for number in range(n):
        frame = av.VideoFrame.from_ndarray(image(number), format="bgr24").reformat(format=pixels)
        frame.pts = number
        yield b"".join(bytes(packet) for packet in encoder.encode(frame))


def mjpeg(n, length):
    """Parts of a multipart stream, with the boundary behind each picture, as cameras and small scripts write it."""
    for number, data in enumerate(pictures(n, "mjpeg", "yuvj420p")):
        head = f"Content-Length: {len(data)}\r\n" if length else ""
        begin = b"" if number else b"--frame\r\n"
        yield begin + f"Content-Type: image/jpeg\r\n{head}\r\n".encode() + data + b"\r\n--frame\r\n"


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
                self.stamps_s.append(time.time())
                for data in datagrams:
                    for piece in self._spoil(data):
                        outlet.sendto(piece, ("127.0.0.1", self._port))
                self.sent += 1

    def __enter__(self):
        self.start()
        return self

    def __exit__(self, *args):
        self._halt.set()
        self.join(60)


def reconnects(stream):
    """Connections of a video stream after the first."""
    return max(stream._progress.connections - 1, 0)


COUNT, KEY_EVERY = 40, 8
CODECS = {
    "h264": ("libx264", "x264-params", "repeat-headers=1"),
    "hevc": ("libx265", "x265-params", "repeat-headers=1"),
}


def pack(codec):
    """COUNT noisy frames: the encoder's access units, and the datagrams that FFmpeg sends them in."""
    encoder, key, value = CODECS[codec]
    rng = np.random.default_rng(1)
    receiver = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    receiver.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4 << 20)
    receiver.bind(("127.0.0.1", 0))
    receiver.settimeout(0.3)
    units, datagrams = [], []
    with receiver, av.open(f"rtp://127.0.0.1:{receiver.getsockname()[1]}", "w", format="rtp") as container:
        extra = ":log-level=none:bframes=0:pools=none" if codec == "hevc" else ":bframes=0"
        options = {"preset": "ultrafast", "tune": "zerolatency", key: value + extra}
        stream = container.add_stream(encoder, rate=25, options=options)
        stream.width, stream.height, stream.pix_fmt = 320, 240, "yuv420p"
        stream.codec_context.gop_size = KEY_EVERY
        for number in range(COUNT):
            if number % 5 == 0:
                picture = rng.integers(0, 255, (240, 320, 3), dtype=np.uint8)
            frame = av.VideoFrame.from_ndarray(picture, format="bgr24")
            frame.pts, frame.time_base = number, Fraction(1, 25)
            for packet in stream.encode(frame):
                units.append(bytes(packet))
                container.mux(packet)
        for packet in stream.encode(None):
            units.append(bytes(packet))
            container.mux(packet)
        while True:
            try:
                datagrams.append(receiver.recv(65536))
            except TimeoutError:
                break
    return units, [data for data in datagrams if parse(data) is not None]


PATH = "/main"
_SDP = (
    "v=0\r\no=- 1 1 IN IP4 127.0.0.1\r\ns=camera\r\nt=0 0\r\na=control:*\r\nm=video 0 RTP/AVP 96\r\n"
    "c=IN IP4 0.0.0.0\r\na=rtpmap:96 H264/90000\r\na=fmtp:96 packetization-mode=1\r\na=control:track1\r\n"
)


class _Datagrams(list):
    def write(self, data):
        self.append(bytes(data))
        return len(data)


@lru_cache
def packed(n):
    """RTP datagrams of each of n numbered frames; every key frame brings its parameters."""
    sink, frames = _Datagrams(), []
    with av.open(sink, "w", format="rtp", options={"packetsize": "1200"}) as container:
        options = {"preset": "ultrafast", "tune": "zerolatency", "x264-params": "bframes=0:repeat-headers=1"}
        stream = container.add_stream("libx264", rate=FPS, options=options)
        stream.width, stream.height, stream.pix_fmt = 160, 96, "yuv420p"
        stream.codec_context.gop_size = GOP
        for number in range(n):
            frame = av.VideoFrame.from_ndarray(image(number), format="bgr24")
            frame.pts, frame.time_base = number, Fraction(1, FPS)
            container.mux(stream.encode(frame))
            frames.append([data for data in sink if data[1] & 0x7F == 96])  # without the sender's reports
            sink.clear()
    return frames


class RtspServer:
    """Serves ``frames`` from its start on, over and over for whoever plays, until closed.

    Args:
        frames: datagrams by frame.
        port: any free one unless given.
        datagrams: refuse RTP over TCP, and send it over UDP.

    Attributes:
        hold: while set, connections stay open and nothing is sent.
        plays: how often PLAY was asked for.
        sent: number of the next frame.
        first: of the first frame that was sent to who played last.
    """

    def __init__(self, frames, port=None, *, datagrams=False):
        self.frames = frames
        self._datagrams = datagrams
        self._outlet = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._outlet.bind(("127.0.0.1", 0))
        self.hold = threading.Event()
        self.plays = self.sent = self.first = 0
        # one that nobody is handed while the server is down
        self.port = port or free_port(socket.SOCK_STREAM)
        self._listener = socket.create_server(("127.0.0.1", self.port))
        self.url = f"rtsp://127.0.0.1:{self.port}{PATH}"
        self._begin_s = time.monotonic()
        self._clients = []
        self._closed = False
        threading.Thread(target=self._accept, daemon=True).start()

    def __enter__(self):
        return self

    def __exit__(self, *args):
        self.close()

    def close(self):
        """Drop every connection and the port, as a camera that loses its power."""
        self._closed = True
        for connection in (self._listener, self._outlet, *self._clients):
            with contextlib.suppress(OSError):
                connection.shutdown(socket.SHUT_RDWR)
            connection.close()

    def _accept(self):
        while not self._closed:
            try:
                client, _ = self._listener.accept()
            except OSError:
                return
            self._clients.append(client)
            threading.Thread(target=self._serve, args=(client,), daemon=True).start()

    def _serve(self, client):
        with contextlib.suppress(OSError, ValueError), client, client.makefile("rb") as lines:
            while request := lines.readline():
                if request.startswith(b"$"):
                    continue  # the client's reports
                fields = dict(line.split(b": ", 1) for line in iter(lines.readline, b"\r\n") if line)
                self._answer(client, request.split()[0].decode(), fields)

    def _answer(self, client, method, fields):
        body, extra, status = "", "Session: 1\r\n", "200 OK"
        if method == "OPTIONS":
            extra = "Public: OPTIONS, DESCRIBE, SETUP, PLAY, TEARDOWN\r\n"
        elif method == "DESCRIBE":
            body = _SDP
            extra = f"Content-Type: application/sdp\r\nContent-Base: {self.url}/\r\nContent-Length: {len(body)}\r\n"
        elif method == "SETUP" and not self._datagrams:
            extra += "Transport: RTP/AVP/TCP;unicast;interleaved=0-1\r\n"
        elif method == "SETUP" and b"client_port=" in fields[b"Transport"]:
            port = int(re.search(rb"client_port=(\d+)", fields[b"Transport"])[1])
            ours = self._outlet.getsockname()[1]
            self._outlet.connect(("127.0.0.1", port))
            extra += f"Transport: RTP/AVP;unicast;client_port={port}-{port + 1};server_port={ours}-{ours + 1}\r\n"
        elif method == "SETUP":
            status = "461 Unsupported Transport"
        head = f"RTSP/1.0 {status}\r\nCSeq: {fields[b'CSeq'].strip().decode()}\r\n{extra}\r\n"
        client.sendall((head + body).encode())
        if method == "PLAY":
            self.plays += 1
            threading.Thread(target=self._play, args=(client,), daemon=True).start()

    def _play(self, client):
        self.first = round((time.monotonic() - self._begin_s) * FPS) // GOP * GOP  # a key frame
        with contextlib.suppress(OSError):
            for number in range(self.first, len(self.frames)):
                time.sleep(max(self._begin_s + number / FPS - time.monotonic(), 0))
                if self.hold.is_set() or self._closed:
                    continue
                for data in self.frames[number]:
                    if self._datagrams:
                        self._outlet.send(data)
                    else:
                        client.sendall(struct.pack("!cBH", b"$", 0, len(data)) + data)
                self.sent = number + 1


def sent_as_rtp(film, times):
    """RTP datagrams of each frame of a film that is sent over and over by one sender, even in time."""
    sink, frames = _Datagrams(), []
    with av.open(str(film)) as source:
        packets = [packet for packet in source.demux(source.streams.video[0]) if packet.dts is not None]
        with av.open(sink, "w", format="rtp", options={"packetsize": "1200"}) as container:
            stream = container.add_stream_from_template(source.streams.video[0])
            for number in range(times * len(packets)):
                packet = av.Packet(bytes(packets[number % len(packets)]))
                packet.stream, packet.pts, packet.dts, packet.time_base = stream, number, number, Fraction(1, FPS)
                container.mux(packet)
                frames.append([data for data in sink if data[1] & 0x7F == 96])
                sink.clear()
    return frames
