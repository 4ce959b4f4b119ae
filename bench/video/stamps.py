"""Error of pictures' time stamps against the sender's clock, by how they are sent or kept.

    python -m bench.video.stamps

Pictures that show their number are sent at an even pace from this computer, each at a time that is noted, received by
the station's own stream, recorded, and read again: the number in the picture says when it was sent. Files are written
with known times. SRT needs an ffmpeg program that can.
"""

# mypy: disable-error-code="no-untyped-call"
from __future__ import annotations

import contextlib
import socket
import subprocess
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import astuple, dataclass
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
from av.container import OutputContainer

from bench.command_line import parser_of, print_results
from bench.rows import write
from tests.support.ports import free_port
from tests.support.video_senders import (
    FPS,
    HEIGHT,
    WIDTH,
    RtspServer,
    coded,
    image,
    mjpeg,
    number_of,
    packed,
    pictures,
    remuxed,
    steady,
    write_clip,
)
from vision.errors import VideoError
from vision.stream.srt_relay import ffmpeg_program
from vision.stream.stream import VideoStream
from vision.video.video import VideoFile

N, QUICK_N = 250, 50
RAW = {"preset": "ultrafast", "tune": "zerolatency", "x264-params": "bframes=0:repeat-headers=1"}
Sent = dict[int, float]


@dataclass(frozen=True, slots=True)
class StampErrors:
    """Errors of one kind."""

    kind: str
    pictures: int
    median_ms: float
    worst_ms: float


def paced(pieces: Sequence[bytes], put: Callable[[bytes], None]) -> Sent:
    """Send a picture every 1/25 s; when each was, Unix s."""
    begin_s, sent = time.time() + 0.5, {}
    for number, data in enumerate(pieces):
        time.sleep(max(begin_s + number / FPS - time.time(), 0.0))
        sent[number] = time.time()
        put(data)
    return sent


def datagrams(frames: Sequence[Sequence[bytes]], port: int) -> Sent:
    """Send a picture's datagrams at once."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as outlet:

        def put(number: bytes) -> None:
            for piece in frames[int(number)]:
                outlet.sendto(piece, ("127.0.0.1", port))

        return paced([b"%d" % k for k in range(len(frames))], put)


def served(pieces: Sequence[bytes], port: int, head: bytes = b"") -> Sent:
    """Send to the first who connects and stays: who was refused before asks for another address, and hangs up."""
    with socket.create_server(("127.0.0.1", port)) as listener:
        while True:
            client, _ = listener.accept()
            with client, contextlib.suppress(ConnectionError):
                if head:
                    client.recv(4096)
                    client.sendall(head)
                sent = paced(pieces, client.sendall)
                time.sleep(1.0)
                return sent


def pushed(n: int, port: int) -> Sent:
    """RTMP, as an app pushes it."""
    for _ in range(50):
        try:
            with av.open(f"rtmp://127.0.0.1:{port}/live/key", "w", format="flv", timeout=6.0) as container:
                return paced([b"%d" % k for k in range(n)], _muxed(container))
        except (av.FFmpegError, OSError):  # not listened yet
            time.sleep(0.2)
    return {}


def _muxed(container: OutputContainer) -> Callable[[bytes], None]:
    stream = container.add_stream("libx264", rate=FPS, options=dict(RAW))
    stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, "yuv420p"
    stream.codec_context.gop_size = 10
    container.start_encoding()  # the first picture is not to wait for it

    def put(number: bytes) -> None:
        frame = av.VideoFrame.from_ndarray(image(int(number)), format="bgr24")
        frame.pts, frame.time_base = int(number), Fraction(1, FPS)
        container.mux(stream.encode(frame))

    return put


def called(frames: Sequence[Sequence[bytes]], port: int) -> Sent:
    """SRT, sent by a program."""
    words = ("-loglevel", "quiet", "-f", "data", "-i", "pipe:0", "-map", "0", "-c", "copy", "-f", "data")
    command = [ffmpeg_program(), *words, "-flush_packets", "1", f"srt://127.0.0.1:{port}?pkt_size=1316"]
    with subprocess.Popen(command, stdin=subprocess.PIPE) as program:
        assert program.stdin is not None
        pipe = program.stdin
        time.sleep(1.0)

        def put(data: bytes) -> None:
            pipe.write(data)
            pipe.flush()

        sent = paced([b"".join(frame) for frame in frames], put)
        time.sleep(1.0)
        pipe.close()
    return sent


def live(kind: str, url: str, sender: Callable[[], Sent]) -> StampErrors:
    """Errors of a stream that is received."""
    rows: list[tuple[int, int]] = []
    sent: Sent = {}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "video.mkv"
        with VideoStream(url, path, on_frame=lambda *row: rows.append(row)):
            thread = threading.Thread(target=lambda: sent.update(sender()))
            thread.start()
            thread.join()
            time.sleep(2.0)
        times_us = np.array([t_us for _, t_us in rows])
        with VideoFile.open(path, times_us) as film:
            errors = [
                1e-6 * frame.t_us - sent[number]
                for frame in film.frames()
                if (number := number_of(frame.image)) in sent
            ]
    return summed(kind, errors)


def rtsp(kind: str, n: int, *, over_udp: bool) -> StampErrors:
    with RtspServer(packed(n), datagrams=over_udp) as server:
        begin_s = server._begin_s + time.time() - time.monotonic()
        sent = {number: begin_s + number / FPS for number in range(n)}

        def sender() -> Sent:
            time.sleep(max(begin_s + n / FPS - time.time(), 0.0))
            return sent

        return live(kind, server.url, sender)


def kept(n: int) -> Iterator[StampErrors]:
    """Errors of the times of files, against those that were written."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        clip = write_clip(folder / "clip.mp4", steady(n))
        films = {
            "MP4": (clip, 0),
            "MKV": (write_clip(folder / "clip.mkv", steady(n)), 0),
            "MP4 with an edit list": (remuxed(clip, folder / "cut.mp4", earlier_ms=int(steady(n)[17])), 17),
            "MP4, turned by 90°": (remuxed(clip, folder / "turned.mp4", turned=90), 0),
        }
        for kind, (path, first) in films.items():
            with VideoFile.open(path) as film:
                yield summed(kind, 1e-6 * film.times_us - 1e-3 * (steady(n)[first:] - steady(n)[first]))


def summed(kind: str, errors: Sequence[float]) -> StampErrors:
    ms = 1e3 * np.asarray(errors, float)
    if not len(ms):
        return StampErrors(kind, 0, np.nan, np.nan)
    return StampErrors(kind, len(ms), round(float(np.median(ms)), 1), round(float(ms[np.argmax(np.abs(ms))]), 1))


def measured(n: int) -> Iterator[StampErrors]:
    """All kinds, one after the other."""
    port, place = free_port(), free_port(socket.SOCK_STREAM)
    raw = list(pictures(n, "libx264", "yuv420p", **RAW))
    head = b"HTTP/1.1 200 OK\r\nContent-Type: multipart/x-mixed-replace; boundary=frame\r\n\r\n"
    whole = [b"".join(frame) for frame in coded(n)]
    yield live("MPEG-TS over UDP", f"udp://127.0.0.1:{port}", lambda: datagrams(coded(n), port))
    yield live("RTP, H.264", f"rtp://127.0.0.1:{port}", lambda: datagrams(packed(n), port))
    yield rtsp("RTSP over TCP", n, over_udp=False)
    yield rtsp("RTSP over UDP", n, over_udp=True)
    yield live("MPEG-TS over TCP", f"tcp://127.0.0.1:{place}", lambda: served(whole, place))
    yield live("raw H.264 over TCP", f"tcp://127.0.0.1:{place}", lambda: served(raw, place))
    yield live("MJPEG over HTTP", f"http://127.0.0.1:{place}/", lambda: served(list(mjpeg(n, True)), place, head))
    yield live("RTMP, pushed", f"rtmp://0.0.0.0:{place}/live", lambda: pushed(n, place))
    with contextlib.suppress(VideoError):
        ffmpeg_program()
        yield live("SRT", f"srt://127.0.0.1:{port}?mode=listener", lambda: called(coded(n), port))
    yield from kept(n)


def main() -> None:
    """Measure and print."""
    args = parser_of("stamps", __doc__ or "", f"{QUICK_N} pictures of each kind, not {N}").parse_args()
    rows = []
    for row in measured(QUICK_N if args.quick else N):
        rows.append(row)
        print(*astuple(row), flush=True)
    args.out.mkdir(parents=True, exist_ok=True)
    write(args.out / "stamps.csv", StampErrors, rows)
    text = "| kind | pictures | median error, ms | worst, ms |\n|---|--:|--:|--:|\n" + "".join(
        f"| {row.kind} | {row.pictures} | {row.median_ms:+.1f} | {row.worst_ms:+.1f} |\n" for row in rows
    )
    print_results(text, args.out / "stamps.csv", as_json=args.json)


if __name__ == "__main__":
    main()
