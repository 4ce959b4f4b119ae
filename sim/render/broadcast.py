"""A camera that streams: frames drawn on time, H.264 in MPEG-TS over UDP, on a thread of its own."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from typing import IO, Any

import av
import numpy as np

from sim.errors import PlayError
from sim.render.film import Film
from sim.telemetry.detections import truth_rows
from sim.world.world import World

TIME_BASE = Fraction(1, 90_000)
"""Time base of time stamps, s: 90 kHz, as MPEG-TS and RTP count video."""
DATAGRAM = 1316
"""Seven MPEG-TS packets, the most that fits an Ethernet frame."""


class VideoSender:
    """Streams from ``start`` until the scenario ends or ``close``. A frame that is late already is skipped."""

    def __init__(self, world: World, url: str, truth_path: Path | None = None) -> None:
        if not url.startswith("udp://"):
            raise PlayError(f"{url}: is no video address; give udp://host:port")
        self._world, self._start_us = world, 0
        self._url = url if "pkt_size=" in url else f"{url}{'&' if '?' in url else '?'}pkt_size={DATAGRAM}"
        self._truth_path = truth_path
        self._truth: IO[str] | None = None
        self._film = Film(world)
        # the first image of a scene takes longest; it is drawn once before it counts
        self._film.image(0.0, 0)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="sim-video", daemon=True)
        self._failure: BaseException | None = None
        self.sent, self.skipped = 0, 0
        self.lost = False
        """True if frames are drawn and not sent, as by a link that is lost; set by another thread."""
        self.mirrored = False
        """True if left and right are exchanged in what is sent; set by another thread."""

    def start(self, start_us: int) -> None:
        """Begin; the first frame is exposed at that Unix time.

        Raises:
            PlayError: if the truth file exists or cannot be made.
        """
        self._start_us = start_us
        if self._truth_path is not None:
            try:
                self._truth = self._truth_path.open("x", encoding="utf-8")
            except OSError as error:
                raise PlayError(f"{self._truth_path}: cannot be made: {error.strerror}; give another name") from error
            self._truth.write("time_us,cx,cy,w,h,angle,system_id\n")
        self._thread.start()

    def close(self) -> None:
        """Stop after the frame in hand.

        Raises:
            PlayError: if the video could not be sent.
        """
        self._stop.set()
        self._thread.join()
        if self._truth is not None:
            self._truth.close()
        if self._failure is not None:
            raise PlayError(f"{self._url}: video cannot be sent: {self._failure}") from self._failure

    def _run(self) -> None:
        try:
            with av.open(self._url, "w", format="mpegts", options={"flush_packets": "1"}) as container:
                stream = self._encoder(container)
                self._frames(lambda image, pts: self._encode(container, stream, image, pts))
                for packet in stream.encode():
                    container.mux(packet)
        except (av.FFmpegError, OSError) as error:
            self._failure = error

    def _frames(self, send: Callable[[Any, int], None]) -> None:
        scenario = self._world.scenario
        index = 0
        while index < scenario.frame_count and not self._stop.is_set():
            t = index / scenario.fps
            if self._stop.wait(max(0.0, t - self._now())):
                return
            image = self._film.image(t, index)
            if not self.lost:
                send(np.ascontiguousarray(image[:, ::-1]) if self.mirrored else image, round(t / TIME_BASE))
                self.sent += 1
                self._write_truth(t)
            # the next frame is the first whose exposure is still to come, or has just been
            following = max(index + 1, int((self._now() - 0.5 / scenario.fps) * scenario.fps) + 1)
            self.skipped += min(following, scenario.frame_count) - index - 1
            index = following

    def _encoder(self, container: Any) -> Any:  # noqa: ANN401 - PyAV publishes no types
        scenario = self._world.scenario
        stream = container.add_stream("libx264", rate=Fraction(scenario.fps).limit_denominator(1000))
        stream.width, stream.height, stream.pix_fmt = scenario.camera.width, scenario.camera.height, "yuv420p"
        stream.codec_context.time_base = TIME_BASE
        keyframes = str(max(1, round(scenario.fps)))
        stream.options = {
            "preset": "ultrafast",
            "tune": "zerolatency",
            "crf": "27",
            "g": keyframes,
            "keyint_min": keyframes,
            # a frame is sent in one burst, which has to fit into a receiver's default socket buffer
            "maxrate": "8M",
            "bufsize": "1M",
            "threads": "1",
        }
        return stream

    @staticmethod
    def _encode(container: Any, stream: Any, image: Any, pts: int) -> None:  # noqa: ANN401 - PyAV publishes no types
        frame = av.VideoFrame.from_ndarray(image, format="bgr24")
        frame.pts, frame.time_base = pts, TIME_BASE
        for packet in stream.encode(frame):
            container.mux(packet)

    def _write_truth(self, t: float) -> None:
        if self._truth is not None:
            stamp = self._start_us + round(t * 1e6)
            self._truth.writelines(f"{stamp},{row}\n" for row in truth_rows(self._world, t))
            self._truth.flush()

    def _now(self) -> float:
        """Seconds since the first frame's exposure."""
        return (time.time_ns() / 1000 - self._start_us) / 1e6
