"""The video's own process: connects, reads, records and decodes, so that a crash or hang of the decoder stays here.

Started by ``vision.stream.stream``. The memory for images and the bound port come as file descriptors. The end of the
requests means stop: also when the station was killed, the recording is sealed.
"""

from __future__ import annotations

import logging
import os
import resource
import socket
import threading
import time
from contextlib import closing, suppress

import av
import numpy as np

from infra.processes.channel import MessageChannel, connect_to_parent
from infra.reporting import Backoff
from infra.secrets import concealed, hide
from infra.shared_memory import map_memory
from vision.errors import VideoError
from vision.stream.connection import OPEN_TIMEOUT_S, READ_TIMEOUT_S, WAIT_S, Input, datagrams, open_input
from vision.stream.messages import IMAGE_BYTES, FrameReply, FrameRequest, Preference, Progress, Settings, VideoRequest
from vision.stream.port import Port, bind
from vision.stream.reader import StreamReader
from vision.stream.source import parse_source
from vision.video.frame_index import reason

_log = logging.getLogger(__name__)

PAUSES_S = (0.25, 0.5, 1.0, 2.0, 4.0)
"""Pauses before the next attempt to connect, s; the last repeats."""
OPENING_PATIENCE_S = 2 * OPEN_TIMEOUT_S + 2.0
"""FFmpeg takes its time twice: to connect, and to find out what comes."""
WAITING_PATIENCE_S = 3.0
"""Time within which the next report is promised while a connection is waited for, seconds."""
MEMORY_BYTES = 6 << 30
"""Frames of a larger size are refused, before they take the machine's memory."""
SEAL_S = 0.5
"""Longest wait for FFmpeg after a request to stop."""


class _StreamWorker:
    """The process's two threads: one reads the source, one answers requests."""

    def __init__(self, settings: Settings, station: MessageChannel[VideoRequest]) -> None:
        self._station = station
        self._images = np.frombuffer(map_memory(settings.memory), dtype=np.uint8)
        self._source = parse_source(settings.source)
        self._proven = settings.proven
        self._port: Port | None = None
        self._bound = socket.socket(fileno=settings.port) if settings.port >= 0 else None
        self._stop = threading.Event()
        self._finished = threading.Event()
        self._once = threading.Lock()
        self._reader = StreamReader(settings, self._go_on, self._report)

    def run(self) -> None:
        """Run until asked to stop, or to a file's end."""
        threading.Thread(target=self._answer_requests, name="answers", daemon=True).start()
        try:
            if self._source.kind == "datagrams":
                self._listen()
            else:
                self._connect()
        finally:
            self._reader.newest.end()
            self._finish()
        # frames that wait can still be asked for
        self._stop.wait()

    def _go_on(self) -> bool:
        if self._reader.progress.connected is False:
            self._reader.report_alive(WAITING_PATIENCE_S)
        return not self._stop.is_set()

    def _listen(self) -> None:
        """One connection after the other on a port that stays bound."""
        port = self._bind()
        if port is None:
            return
        self._port = port
        with closing(port):
            while self._go_on():
                try:
                    opened = datagrams(self._source, port, self._go_on)
                    if opened is not None:
                        self._read(opened)
                except VideoError as error:
                    self._report_error(str(error))

    def _bind(self) -> Port | None:
        backoff = Backoff(PAUSES_S)
        while self._go_on():
            try:
                bound = self._bound or bind(self._source.host, self._source.port)
                return Port(bound, self._source, self._proven, self._go_on, READ_TIMEOUT_S)
            except (VideoError, OSError) as error:
                self._report_error(str(error))
                self._pause(backoff)
        return None

    def _connect(self) -> None:
        """Connect, read until it breaks, and again with growing pauses."""
        backoff = Backoff(PAUSES_S)
        while self._go_on():
            self._reader.report_alive(OPENING_PATIENCE_S + (WAIT_S if self._source.waits else 0.0))
            before = self._reader.order.count
            try:
                opened = open_input(self._source)
                if opened is None:
                    continue
                self._read(opened)
                self._reader.progress.ended = self._source.paced and not self._stop.is_set()
            except VideoError as error:
                self._report_error(str(error))
            if self._reader.progress.ended:
                return
            if self._reader.order.count > before:
                backoff.succeeded()
            self._pause(backoff)

    def _read(self, opened: Input) -> None:
        with closing(opened):
            try:
                self._reader.read(opened, paced=self._source.paced)
            except av.ExitError:
                self._report_error(f"video {self._source.text}: nothing came for {READ_TIMEOUT_S:g} s")
            except (av.FFmpegError, OSError, ValueError) as error:
                self._report_error(f"video {self._source.text}: {reason(error)}")

    def _report_error(self, text: str) -> None:
        self._reader.progress.error = text
        self._reader.send_progress()

    def _pause(self, backoff: Backoff) -> None:
        until_s = time.monotonic() + backoff.failed()
        while self._go_on() and (left_s := until_s - time.monotonic()) > 0:
            self._stop.wait(min(left_s, 0.2))

    def _finish(self) -> None:
        with self._once:
            if not self._finished.is_set():
                self._reader.finish()
                self._finished.set()

    def _report(self, progress: Progress) -> None:
        """Send progress, with who sends to the port."""
        if self._port is not None:
            senders = self._port.senders
            progress.strangers, progress.sender, progress.rival = senders.strangers, senders.present, senders.rival
            progress.proven = list(senders.proven)
        self._send(progress)

    def _send(self, message: Progress | FrameReply) -> None:
        try:
            self._station.send(message)
        except OSError:
            # the parent is gone: only the recording is left to be sealed
            self._stop.set()

    def _answer_requests(self) -> None:
        """Hand out the newest frame whenever it is asked for; the end of the requests means stop."""
        with suppress(EOFError):
            while isinstance(request := self._station.receive(), FrameRequest | Preference):
                if isinstance(request, FrameRequest):
                    self._send(self._fetch(request))
                elif self._port is not None:
                    self._port.senders.prefer(request.sender)
        self._stop.set()
        self._finished.wait(SEAL_S)
        self._finish()
        os._exit(0)

    def _fetch(self, request: FrameRequest) -> FrameReply:
        taken = self._reader.newest.pop(request.wait_s)
        if taken is None:
            return FrameReply(number=request.number)
        index, t_us, frame = taken
        try:
            image = frame.to_ndarray(format="bgr24")
        except (av.FFmpegError, ValueError, MemoryError):
            return FrameReply(number=request.number)
        if image.size > IMAGE_BYTES:
            self._reader.progress.error = (
                f"video {self._source.text}: frames of {frame.width}×{frame.height} are too large"
            )
            return FrameReply(number=request.number)
        self._images[: image.size].reshape(image.shape)[:] = image
        return FrameReply(number=request.number, index=index, t_us=t_us, width=frame.width, height=frame.height)


def main() -> None:
    """Wait for the settings and work."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
    station: MessageChannel[VideoRequest] = connect_to_parent(VideoRequest)
    settings = station.receive()
    assert isinstance(settings, Settings)
    hide(settings.source)
    _log.info("video from %s", concealed(settings.source))
    _StreamWorker(settings, station).run()


if __name__ == "__main__":
    main()
