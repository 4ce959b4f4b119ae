"""Times of pictures against the clock of who took them, for every kind of stream and container.

    python -m bench.video.stamps [seconds per stream]

Each picture shows its number. Streams send ten a second over the loopback, and the sender writes down when it took
each; in films the encoder was told. The error is a picture's time less the time at which it was taken.
"""

from __future__ import annotations

import http.server
import re
import socket
import socketserver
import struct
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing, suppress
from fractions import Fraction
from io import BufferedIOBase
from pathlib import Path

import av
import cv2
import numpy as np
from numpy.typing import NDArray

from bench.ports import free_port
from vision.stream.stream import VideoStream
from vision.video.video import VideoFile

RESULT = Path("bench-results/stamps.md")
WIDTH, HEIGHT, RATE, BITS = 160, 96, 10, 10
Taken = dict[int, float]
"""Unix seconds at which a picture was taken, by its number."""


def picture(number: int) -> NDArray[np.uint8]:
    """The number as ten bars, light for 1."""
    image = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    for bit in range(BITS):
        image[:, bit * 16 : bit * 16 + 16] = 255 * (number >> bit & 1)
    return image


def number_of(image: NDArray[np.uint8]) -> int:
    """The number that a picture shows."""
    row = image[image.shape[0] // 2]
    return sum(1 << bit for bit in range(BITS) if row[(2 * bit + 1) * image.shape[1] // (2 * BITS)].mean() > 127)


def at_a_steady_rate(seconds: float, taken: Taken) -> Iterator[tuple[int, NDArray[np.uint8]]]:
    """Number and picture when it is taken."""
    began_s = time.time()
    for number in range(round(seconds * RATE)):
        time.sleep(max(0.0, began_s + number / RATE - time.time()))
        taken[number] = time.time()
        yield number, picture(number)


def send(address: str | BufferedIOBase, kind: str, seconds: float, taken: Taken) -> None:
    """As an encoder without delay sends it."""
    with av.open(address, "w", format=kind, options={"flush_packets": "1"}) as container:
        options = {"preset": "ultrafast", "tune": "zerolatency", "x264-params": "bframes=0:repeat-headers=1"}
        stream = container.add_stream("libx264", rate=RATE, options=options)
        stream.width, stream.height, stream.pix_fmt, stream.codec_context.gop_size = WIDTH, HEIGHT, "yuv420p", RATE
        for number, image in at_a_steady_rate(seconds, taken):
            frame = av.VideoFrame.from_ndarray(image, format="bgr24")
            frame.pts, frame.time_base = number, Fraction(1, RATE)
            container.mux(stream.encode(frame))


def send_mjpeg(out: BufferedIOBase, seconds: float, taken: Taken) -> None:
    """As cameras send it to a browser, without a time stamp anywhere."""
    for _, image in at_a_steady_rate(seconds, taken):
        data = cv2.imencode(".jpg", image)[1].tobytes()
        out.write(b"--b\r\nContent-Type: image/jpeg\r\nContent-Length: %d\r\n\r\n" % len(data) + data)


def serve(port: int, content: str, body: Callable[[BufferedIOBase], None]) -> None:
    """Answer one request over HTTP."""

    class HttpCamera(http.server.BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200)
            self.send_header("Content-Type", content)
            self.end_headers()
            body(self.wfile)

        def log_message(self, format: str, *args: object) -> None:
            """Nothing is said."""

    with http.server.HTTPServer(("127.0.0.1", port), HttpCamera) as server:
        server.timeout = 10.0
        server.handle_request()


class RtspCamera(socketserver.StreamRequestHandler):
    """Answers who plays over RTSP, and hands on what is sent by RTP to ``relay``, over TCP or as datagrams."""

    server: RtspServer

    def handle(self) -> None:
        peer: int | None = None
        while request := self.rfile.readline():
            if request.startswith(b"$"):
                return  # the player's reports
            head = dict(line.split(b": ", 1) for line in iter(self.rfile.readline, b"\r\n") if b": " in line)
            method, status, more, body = request.split()[0], "200 OK", "Session: 1\r\n", ""
            if method == b"DESCRIBE":
                body = (
                    "v=0\r\no=- 0 0 IN IP4 127.0.0.1\r\ns=camera\r\nt=0 0\r\nm=video 0 RTP/AVP 96\r\n"
                    "a=rtpmap:96 H264/90000\r\na=fmtp:96 packetization-mode=1\r\na=control:track\r\n"
                )
                more = f"Content-Type: application/sdp\r\nContent-Length: {len(body)}\r\n"
            elif method == b"SETUP" and self.server.datagrams:
                asked = re.search(rb"client_port=(\d+)", head[b"Transport"])
                peer, status = (int(asked[1]), status) if asked else (None, "461 Unsupported Transport")
                more += f"Transport: RTP/AVP;unicast;client_port={peer}-{(peer or 0) + 1};server_port=1-2\r\n"
            elif method == b"SETUP":
                more += "Transport: RTP/AVP/TCP;unicast;interleaved=0-1\r\n"
            sequence = head.get(b"CSeq", b"0").strip().decode()
            self.wfile.write(f"RTSP/1.0 {status}\r\nCSeq: {sequence}\r\n{more}\r\n{body}".encode())
            if method == b"PLAY":
                threading.Thread(target=self._play, args=(peer,), daemon=True).start()

    def _play(self, peer: int | None) -> None:
        relay = self.server.relay
        with suppress(BlockingIOError):
            while relay.recv(2048, socket.MSG_DONTWAIT):
                pass  # nobody played yet
        with suppress(OSError):
            while data := relay.recv(2048):
                if peer is None:
                    self.wfile.write(struct.pack("!cBH", b"$", 0, len(data)) + data)
                else:
                    relay.sendto(data, ("127.0.0.1", peer))


class RtspServer(socketserver.ThreadingTCPServer):
    """Of one camera."""

    allow_reuse_address = daemon_threads = True

    def __init__(self, port: int, *, datagrams: bool) -> None:
        super().__init__(("127.0.0.1", port), RtspCamera)
        self.datagrams = datagrams
        self.relay = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.relay.bind(("127.0.0.1", 0))


def serve_rtsp(port: int, seconds: float, taken: Taken, *, datagrams: bool) -> None:
    """As a camera that sends all the time, whether somebody plays or not."""
    with RtspServer(port, datagrams=datagrams) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        send(f"rtp://127.0.0.1:{server.relay.getsockname()[1]}?pkt_size=1200", "rtp", seconds, taken)
        server.shutdown()
        server.relay.close()


def sender_of(kind: str, port: int) -> tuple[str, Callable[[float, Taken], None]]:
    """Address for the product, and what sends to it."""
    at = f"127.0.0.1:{port}"
    if kind == "MJPEG over HTTP":
        content = "multipart/x-mixed-replace; boundary=b"
        return f"http://{at}/", lambda s, taken: serve(port, content, lambda out: send_mjpeg(out, s, taken))
    if kind == "MPEG-TS over HTTP":
        return f"http://{at}/", lambda s, taken: serve(port, "video/mp2t", lambda out: send(out, "mpegts", s, taken))
    if kind.startswith("RTSP"):
        datagrams = kind.endswith("UDP")
        return f"rtsp://{at}/main", lambda s, taken: serve_rtsp(port, s, taken, datagrams=datagrams)
    product, sender, container = {
        "MPEG-TS over UDP": (f"udp://{at}", f"udp://{at}?pkt_size=1316", "mpegts"),
        "H.264 over RTP": (f"rtp://{at}", f"rtp://{at}", "rtp"),
        "MPEG-TS over TCP": (f"tcp://{at}", f"tcp://{at}?listen=1", "mpegts"),
        "raw H.264 over TCP": (f"tcp://{at}", f"tcp://{at}?listen=1", "h264"),
        "RTMP that is pushed": (f"rtmp://0.0.0.0:{port}/live", f"rtmp://{at}/live", "flv"),
    }[kind]
    return product, lambda seconds, taken: send(sender, container, seconds, taken)


STREAMS = (
    *("MPEG-TS over UDP", "H.264 over RTP", "MPEG-TS over TCP", "raw H.264 over TCP", "MJPEG over HTTP"),
    *("MPEG-TS over HTTP", "RTSP over TCP", "RTSP over UDP", "RTMP that is pushed"),
)


def errors_of_stream(kind: str, seconds: float) -> list[float]:
    """Error of each picture that came, seconds; without the first second, in which the connection is made."""
    taken: Taken = {}
    address, play = sender_of(kind, free_port())
    came: dict[int, float] = {}
    behind = 0
    """By how much pictures' numbers are ahead of their places in the stream."""

    def sending() -> None:
        while len(taken) < RATE and time.time() < until_s:
            taken.clear()
            try:
                play(seconds, taken)
            except (OSError, av.FFmpegError):
                time.sleep(0.2)  # nobody takes it yet, or no more

    until_s = time.time() + 15.0
    sender = threading.Thread(target=sending)
    with VideoStream(address, on_frame=lambda index, t_us: came.update({index: t_us * 1e-6})) as stream:
        sender.start()  # a sender that waits to be connected to holds this process up meanwhile
        while sender.is_alive():
            frame = stream.latest(0.1)
            behind = behind if frame is None else number_of(frame.image) - frame.index
    sender.join()
    numbers = {index + behind: t_s for index, t_s in came.items()}
    return [t_s - taken[number] for number, t_s in numbers.items() if number >= RATE and number in taken]


def write_film(path: Path) -> Path:
    """Sixty pictures at uneven times, some of which are shown in another order than coded."""
    with av.open(str(path), "w") as container:
        options = {"preset": "ultrafast", "x264-params": "bframes=2:keyint=12"}
        stream = container.add_stream("libx264", rate=30, options=options)
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, "yuv420p"
        stream.codec_context.time_base = Fraction(1, 1000)
        for number in range(60):
            frame = av.VideoFrame.from_ndarray(picture(number), format="bgr24")
            frame.pts, frame.time_base = film_ms(number), Fraction(1, 1000)
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path


def film_ms(number: int) -> int:
    """When a picture of a film is shown."""
    return 100 * number + 7 * (number % 3)


def copied(source: Path, out: Path, *, hidden_ms: int = 0, turned: int = 0) -> Path:
    """The same without coding it anew, its beginning hidden by an edit list, its pictures turned."""
    with av.open(str(source)) as old, av.open(str(out), "w") as new:
        stream = old.streams.video[0]
        copy = new.add_stream_from_template(stream)
        if turned:
            copy.set_display_rotation(turned)
        for packet in old.demux(stream):
            if packet.size and packet.pts is not None and packet.dts is not None:
                earlier = round(hidden_ms / 1000 / packet.time_base)
                packet.pts, packet.dts, packet.stream = packet.pts - earlier, packet.dts - earlier, copy
                new.mux(packet)
    return out


def errors_of_film(path: Path, *, hidden_ms: int = 0, turned: int = 0) -> list[float]:
    """Of each picture, from the first that is shown on."""
    with closing(VideoFile.open(path)) as video:
        rows = [(number_of(np.rot90(frame.image, turned // 90)), frame.t_us) for frame in video.frames()]
    first = rows[0][0]
    assert film_ms(first) >= hidden_ms
    return [t_us * 1e-6 - (film_ms(number) - film_ms(first)) * 1e-3 for number, t_us in rows]


def films(folder: Path) -> Iterator[tuple[str, list[float]]]:
    """Errors in each container."""
    # AVI has no uneven times
    for suffix in ("mp4", "mov", "mkv", "ts"):
        yield suffix.upper(), errors_of_film(write_film(folder / f"a.{suffix}"))
    whole = folder / "a.mp4"
    yield "MP4 with an edit list", errors_of_film(copied(whole, folder / "cut.mp4", hidden_ms=1350), hidden_ms=1350)
    yield "MP4 turned by 180°", errors_of_film(copied(whole, folder / "turned.mp4", turned=180), turned=180)


def row(kind: str, errors: list[float]) -> str:
    """Of the table: milliseconds."""
    size = np.abs(errors) * 1e3
    return f"| {kind} | {len(errors)} | {np.median(size):.0f} | {size.max():.0f} |"


def main() -> None:
    """Measure and write the table."""
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 8.0
    lines = ["| kind | pictures | median error, ms | worst, ms |", "|---|--:|--:|--:|"]
    with tempfile.TemporaryDirectory() as name:
        lines += [row(kind, errors) for kind, errors in films(Path(name))]
    lines += [row(kind, errors_of_stream(kind, seconds)) for kind in STREAMS]
    text = (
        "# Times of pictures\n\n"
        f"`python -m bench.video.stamps {seconds:g}`: a picture's time less the time at which it was taken, by the "
        "sender's clock. Streams\nat ten pictures a second over the loopback; films by the times that the encoder was "
        "given.\n\n"
    )
    RESULT.parent.mkdir(exist_ok=True)
    RESULT.write_text(text + "\n".join(lines) + "\n", encoding="utf-8")
    print("\n".join(lines))


if __name__ == "__main__":
    main()
