"""A camera for tests that speaks RTSP: one track of H.264 within the connection, at the pace of its clock."""

from __future__ import annotations

import contextlib
import socket
import struct
import threading
import time
from fractions import Fraction
from functools import lru_cache

import av

from tests.support.numbered_video import FPS, GOP, image
from tests.support.ports import free_port

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

    Attributes:
        hold: while set, connections stay open and nothing is sent.
        plays: how often PLAY was asked for.
        sent: frames sent.
    """

    def __init__(self, frames, port=None):
        self.frames = frames
        self.hold = threading.Event()
        self.plays = self.sent = 0
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
        for connection in (self._listener, *self._clients):
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
        body, extra = "", "Session: 1\r\n"
        if method == "OPTIONS":
            extra = "Public: OPTIONS, DESCRIBE, SETUP, PLAY, TEARDOWN\r\n"
        elif method == "DESCRIBE":
            body = _SDP
            extra = f"Content-Type: application/sdp\r\nContent-Base: {self.url}/\r\nContent-Length: {len(body)}\r\n"
        elif method == "SETUP":
            extra += "Transport: RTP/AVP/TCP;unicast;interleaved=0-1\r\n"
        head = f"RTSP/1.0 200 OK\r\nCSeq: {fields[b'CSeq'].strip().decode()}\r\n{extra}\r\n"
        client.sendall((head + body).encode())
        if method == "PLAY":
            self.plays += 1
            threading.Thread(target=self._play, args=(client,), daemon=True).start()

    def _play(self, client):
        first = round((time.monotonic() - self._begin_s) * FPS) // GOP * GOP  # a key frame
        with contextlib.suppress(OSError):
            for number in range(first, len(self.frames)):
                time.sleep(max(self._begin_s + number / FPS - time.monotonic(), 0))
                if self.hold.is_set() or self._closed:
                    continue
                for data in self.frames[number]:
                    client.sendall(struct.pack("!cBH", b"$", 0, len(data)) + data)
                self.sent = number + 1
