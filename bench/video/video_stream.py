"""What live video costs in a process of its own, how late it is shown, and whether every frame is recorded.

    python -m bench.video.video_stream [seconds per case]

1080p30 H.264 at 6 Mb/s as MPEG-TS over UDP on the loopback, sent by another process, recorded and decoded. The consumer
takes every frame, or one every 100 ms as a detector does; "busy" is a station whose Python is busy besides. Processor
time is that of the station and its video process together; lag runs from sending a frame to having its image.
"""

from __future__ import annotations

import io
import multiprocessing
import os
import socket
import sys
import tempfile
import threading
import time
from fractions import Fraction
from pathlib import Path

import av
import numpy as np

from vision.stream.stream import VideoStream

WIDTH, HEIGHT, FPS, BIT_RATE = 1920, 1080, 30, 6_000_000
RESULT = Path("bench-results/video_stream.md")
PIECE = 7 * 188


class Own(VideoStream):
    """The station's stream, and what its process uses."""

    def cpu_s(self) -> float:
        return time.process_time() + self._supervisor.process.processor_time.used_s


def coded(n: int) -> list[list[bytes]]:
    """Datagrams of each of n frames: a scene that drifts under noise."""
    sink, frames = io.BytesIO(), []
    scene = np.random.default_rng(0).integers(0, 255, (HEIGHT // 8 + 40, WIDTH // 8 + 40, 3), dtype=np.uint8)
    scene = scene.repeat(8, 0).repeat(8, 1)
    with av.open(sink, "w", format="mpegts", options={"flush_packets": "1"}) as container:
        options = {"preset": "veryfast", "tune": "zerolatency", "x264-params": "repeat-headers=1"}
        stream = container.add_stream("libx264", rate=FPS, options=options)
        stream.width, stream.height, stream.pix_fmt, stream.bit_rate = WIDTH, HEIGHT, "yuv420p", BIT_RATE
        stream.codec_context.gop_size = FPS
        for k in range(n):
            image = np.ascontiguousarray(scene[k % 300 : k % 300 + HEIGHT, k % 300 : k % 300 + WIDTH])
            frame = av.VideoFrame.from_ndarray(image, format="bgr24")
            frame.pts, frame.time_base = k, Fraction(1, FPS)
            at = sink.tell()
            container.mux(stream.encode(frame))
            data = sink.getvalue()[at:]
            frames.append([data[i : i + PIECE] for i in range(0, len(data), PIECE)])
    return frames


def send(port: int, frames: list[list[bytes]], begin_s: float) -> None:
    """In a process of its own: frame k at ``begin_s + k / FPS`` Unix time."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as outlet:
        for k, pieces in enumerate(frames):
            time.sleep(max(begin_s + k / FPS - time.time(), 0.0))
            for piece in pieces:
                outlet.sendto(piece, ("127.0.0.1", port))


def case(frames: list[list[bytes]], every_s: float, busy: bool) -> list[float]:
    """CPU ms a frame sent, median and 95 % lag ms, frames shown, frames recorded."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    stop = threading.Event()
    spin = threading.Thread(target=_spin, args=(stop,))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "video.mkv"
        stream = Own(f"udp://127.0.0.1:{port}", path)
        time.sleep(3.0)
        begin_s = time.time() + 1.0
        sender = multiprocessing.get_context("spawn").Process(target=send, args=(port, frames, begin_s))
        sender.start()
        if busy:
            spin.start()
        lags: list[float] = []
        before_s = stream.cpu_s()
        end_s = begin_s + len(frames) / FPS + 0.3
        while time.time() < end_s:
            frame = stream.latest(0.2)
            if frame is not None:
                lags.append(time.time() - begin_s - frame.index / FPS)
                if every_s:
                    time.sleep(every_s)
        cpu_s = stream.cpu_s() - before_s
        stop.set()
        if busy:
            spin.join()
        sender.join()
        stream.close()
        with av.open(str(path)) as film:
            kept = sum(1 for packet in film.demux(video=0) if packet.size)
    return [cpu_s * 1e3 / len(frames), *(np.percentile(lags[FPS // 3 :], (50, 95)) * 1e3), len(lags), kept]


def _spin(stop: threading.Event) -> None:
    """Python that never waits."""
    while not stop.is_set():
        sum(range(1000))


def main() -> None:
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 8.0
    frames = coded(round(seconds * FPS))
    rate = sum(len(piece) for pieces in frames for piece in pieces) * 8 / seconds / 1e6
    lines = [
        "# Live video in a process of its own",
        "",
        f"`python -m bench.video.video_stream {seconds:g}`: {len(frames)} frames of {WIDTH}×{HEIGHT} at {FPS} a "
        "second,",
        f"{rate:.1f} Mb/s, MPEG-TS over UDP on the loopback; {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}.",
        "Processor time is that of the station and of its video process; the thread that is busy in the busy case is",
        "part of it. Recorded with every case; a slow consumer sees the newest frame.",
        "",
        "| consumer | CPU ms a frame | lag ms, median | 95 % | frames shown | recorded |",
        "|---|--:|--:|--:|--:|--:|",
    ]
    for name, every_s, busy in (
        ("every frame", 0.0, False),
        ("100 ms each", 0.1, False),
        ("100 ms each, busy", 0.1, True),
    ):
        cost, middle, most, shown, kept = case(frames, every_s, busy)
        lines.append(f"| {name} | {cost:.1f} | {middle:.0f} | {most:.0f} | {shown:.0f} | {kept:.0f} of {len(frames)} |")
        print(lines[-1], flush=True)
    RESULT.parent.mkdir(exist_ok=True)
    RESULT.write_text("\n".join(lines) + "\n", encoding="utf-8")
    print(f"written to {RESULT}")


if __name__ == "__main__":
    main()
