"""Others at the video's port: junk in a pause of the camera and before it, another film, and a camera that moves."""

from __future__ import annotations

import random
import socket
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from pathlib import Path

import av
import numpy as np

from bench.attacks.records import read_events
from bench.attacks.report import AttackRow
from bench.attacks.run import Options
from bench.attacks.stage import StageCounts
from bench.ports import free_port
from bench.station import FlyingStation, mission_text
from infra.session_format import FRAMES

FPS, GOP, FILM_S = 10, 10, 14.0
WIDTH, HEIGHT, PIECE = 160, 96, 7 * 188
DARK, LIGHT = 20, 235
"""Grey values of the camera's and of the stranger's film, which tell whose frame was recorded."""
CAMERA, STRANGER = "127.0.0.1", "127.0.0.66"
JUNK_HZ = 5.0
WAIT_S = 3.0
"""After the film: what was sent last is on its way to the disk."""


class _CodedBytes:
    data = b""

    def write(self, data: bytes) -> int:
        self.data += data
        return len(data)


@lru_cache
def coded_film(level: int) -> list[list[bytes]]:
    """Datagrams of each frame of a film of one grey."""
    sink, frames = _CodedBytes(), []
    with av.open(sink, "w", format="mpegts", options={"flush_packets": "1", "pat_period": "0.1"}) as container:
        options = {"preset": "ultrafast", "tune": "zerolatency", "x264-params": "bframes=0:repeat-headers=1"}
        stream = container.add_stream("libx264", rate=FPS, options=options)
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, "yuv420p"
        stream.codec_context.gop_size = GOP
        rng = np.random.default_rng(1)
        for number in range(int(FILM_S * FPS)):
            noise = rng.integers(-15, 15, (HEIGHT, WIDTH, 1))
            image = np.broadcast_to(np.clip(level + noise, 0, 255), (HEIGHT, WIDTH, 3)).astype(np.uint8)
            frame = av.VideoFrame.from_ndarray(image, format="bgr24")
            frame.pts, frame.time_base = number, Fraction(1, FPS)
            container.mux(stream.encode(frame))
            data, sink.data = sink.data, b""
            frames.append([data[at : at + PIECE] for at in range(0, len(data), PIECE)])
    return frames


def _junk() -> list[list[bytes]]:
    """Five datagrams a second that look like a transport stream and are none."""
    rng = random.Random(7)
    every = int(FPS / JUNK_HZ)
    return [[b"\x47" + rng.randbytes(187)] if k % every == 0 else [] for k in range(int(FILM_S * FPS))]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Voice:
    """Who sends what when; each has a port of its own."""

    host: str
    frames: list[list[bytes]]
    begin_s: float = 0.0
    end_s: float = FILM_S
    hole: tuple[float, float] = (0.0, 0.0)

    def play(self, port: int, start_s: float) -> int:
        """Send, and return how many frames were sent."""
        sent = 0
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
            sock.bind((self.host, 0))
            for k, datagrams in enumerate(self.frames):
                t_s = k / FPS
                if not self.begin_s <= t_s < self.end_s or self.hole[0] <= t_s < self.hole[1]:
                    continue
                time.sleep(max(start_s + t_s - time.monotonic(), 0.0))
                for data in datagrams:
                    sock.sendto(data, ("127.0.0.1", port))
                sent += 1
        return sent


def others_at_the_port(options: Options) -> list[AttackRow]:
    """Others send to the video's port: whose frames are recorded, and whether it is told."""
    dark, light, junk = coded_film(DARK), coded_film(LIGHT), _junk()
    cases: dict[str, tuple[Sequence[_Voice], str]] = {
        "five junk datagrams a second, the camera pauses for 3.5 s": (
            (_Voice(host=CAMERA, frames=dark, hole=(4.0, 7.5)), _Voice(host=STRANGER, frames=junk, begin_s=3.0)),
            "others send to the video's port too",
        ),
        "five junk datagrams a second, before the camera": (
            (_Voice(host=CAMERA, frames=dark, begin_s=3.0), _Voice(host=STRANGER, frames=junk)),
            "others send to the video's port too",
        ),
        "another film beside the camera's": (
            (_Voice(host=CAMERA, frames=dark), _Voice(host=STRANGER, frames=light, begin_s=3.0)),
            f"contest the video's port: {CAMERA}",
        ),
        "the camera moves to another port": (
            (_Voice(host=CAMERA, frames=dark, end_s=5.0), _Voice(host=CAMERA, frames=dark, begin_s=5.0)),
            "and no longer from",
        ),
    }
    return [_play(options, k, name, *case) for k, (name, case) in enumerate(cases.items())]


def _play(options: Options, k: int, name: str, voices: Sequence[_Voice], told: str) -> AttackRow:
    port = free_port()
    station = FlyingStation(
        options.gcs,
        options.folder / f"video-port-{k}",
        mission_text([11]),
        [f"udpin:127.0.0.1:{free_port()}"],
        ["--video", f"udp://127.0.0.1:{port}"],
    )
    sent = [0] * len(voices)

    def run(i: int, start_s: float) -> None:
        sent[i] = voices[i].play(port, start_s)

    try:
        start_s = time.monotonic() + 1.0
        threads = [threading.Thread(target=run, args=(i, start_s)) for i in range(len(voices))]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        time.sleep(WAIT_S)
    finally:
        station.end()
    true = sum(n for n, voice in zip(sent, voices, strict=True) if voice.host == CAMERA)
    ours, others = _recorded(Path(station.session))
    texts = [event.text for event in read_events(station.session, StageCounts())]
    is_told = any(told in text for text in texts)
    # what follows a pause begins with the next key frame, and the last frame is whole when the next one comes
    lost = true - ours
    return AttackRow(
        attack="video port",
        case=name,
        sent=true,
        lost=lost,
        false_sent=sum(sent) - true,
        false_recorded=others,
        held=lost <= 2 * GOP and not others and is_told,
        note=f"{ours} of {true} frames of the camera, {others} of another; {'told' if is_told else 'not told'}",
    )


def _recorded(session: Path) -> tuple[int, int]:
    """Recorded frames of the camera and of others."""
    ours = others = 0
    for path in sorted(session.glob("video*.mkv")):
        with av.open(str(path)) as container:
            for frame in container.decode(video=0):
                dark = float(frame.to_ndarray(format="gray").mean()) < (DARK + LIGHT) / 2
                ours, others = ours + dark, others + (not dark)
    assert (session / FRAMES.name).exists()
    return ours, others
