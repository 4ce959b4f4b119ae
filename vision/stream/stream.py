"""Live video: the newest frame on request, every packet into a file, a time for every frame.

A process of its own reads, records and decodes (``vision.stream.stream_worker``): when FFmpeg crashes or hangs there it
is killed and started again, and the flight goes on. A slow consumer gets the newest frame only; the others are
counted and still listed, since the recording has them. ``vision.stream.source`` lists what can be a source; a file is
read as if live.
"""

from __future__ import annotations

import contextlib
import math
import os
import socket
import threading
import time
from collections import deque
from collections.abc import Callable
from functools import partial
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from infra.processes.child_process import ChildProcess
from infra.processes.supervisor import Supervisor
from infra.secrets import conceal_in, hide
from infra.shared_memory import make_memory, map_memory
from vision.errors import VideoError
from vision.stream.messages import (
    IMAGE_BYTES,
    FrameReply,
    FrameRequest,
    Preference,
    Progress,
    Sender,
    Settings,
    VideoReport,
)
from vision.stream.pace import PACE_FRAMES, STALL_S, stall_after_s
from vision.stream.port import bind
from vision.stream.source import Source, parse_source
from vision.video.recording import require_new
from vision.video.video import Frame

_EXPOSURE_SOURCES = {"SEI": "time stamps (SEI)", "KLV": "metadata (KLV)", "RTCP": "sender reports (RTCP)"}

AWAKE = 2
"""Frames that end a stall."""
START_PATIENCE_S = 20.0
"""Time within which a process must send its first message."""
WATCH_S = 0.2
"""Longest wait between two checks of whether the process is alive."""
CLOSE_S = 2.0
"""A process that was asked to end is killed after this long."""
ANSWER_S = 0.5
"""Time for an answer beyond the time that the frame was waited for, s."""
PAUSES_S = (0.0, 0.25, 0.5, 1.0, 2.0, 4.0)
"""Pauses before the process is started again, s; the last repeats."""
STEADY_S = 10.0
"""A process that lived this long was well."""


class VideoStream:
    """Live video, read by a process of its own.

    Args:
        url: see ``vision.stream.source``.
        record_path: .mkv to be created, None to record nothing. Further files are named video.1.mkv, video.2.mkv, …
        offset_s: video time minus telemetry time, s; taken from every frame's time.
        on_frame: called from the listening thread with index and Unix µs of every frame, in order.
        stall_s: without a frame for this long the stream is stalled, unless it is a slow one.

    Attributes:
        url: the source as it may be shown.
        received: frames listed so far, in all files of the recording.

    Raises:
        VideoError: the recording exists already, or the source is none. That it does not answer is no error: it is
            tried again without end.
    """

    def __init__(
        self,
        url: str,
        record_path: Path | None = None,
        offset_s: float = 0.0,
        *,
        on_frame: Callable[[int, int], None] | None = None,
        stall_s: float = STALL_S,
    ) -> None:
        source = parse_source(url)
        if record_path is not None:
            require_new(record_path)
        self.url = source.text
        self._conceal = partial(conceal_in, address=url)
        hide(url)
        self.received = 0
        self._on_frame = on_frame
        self._stall_s = stall_s
        self._progress = Progress(patience_s=START_PATIENCE_S, rows=[])
        self._before = Progress(patience_s=0.0, rows=[])
        self._trouble = self._rows_error = ""
        self._last_us = 0
        self._times_us: deque[int] = deque(maxlen=PACE_FRAMES)
        self._late = 0
        self._heard_s = time.monotonic()
        self._waking = 0
        self._stop = threading.Event()
        self._answered = threading.Condition()
        self._answer: FrameReply | None = None
        self._asked = 0
        self._asking = threading.Lock()
        self._memory = os.fdopen(make_memory(IMAGE_BYTES), "r+b", buffering=0)
        self._images: NDArray[np.uint8] = np.frombuffer(map_memory(self._memory.fileno()), dtype=np.uint8)
        self._port = _bind(source)
        self._settings = Settings(
            source=url,
            record=str(record_path or ""),
            offset_s=offset_s,
            memory=self._memory.fileno(),
            port=-1 if self._port is None else self._port.fileno(),
        )
        self._supervisor = Supervisor(
            "video",
            start=self._start,
            begin=self._begin,
            watch=self._watch,
            replaced=self._note_restart,
            excused=lambda process: process.waits_for_disk,
            watch_s=WATCH_S,
            start_s=START_PATIENCE_S,
            stop_s=CLOSE_S,
            pauses_s=PAUSES_S,
            steady_s=STEADY_S,
        )
        self._supervisor.supervise()

    @property
    def connected(self) -> bool:
        """True if packets are coming in."""
        return self._progress.connected and not self.stalled

    @property
    def ended(self) -> bool:
        """True if a file came to its end."""
        return self._progress.ended

    @property
    def stalled(self) -> bool:
        """True if no frame has come for a second, or for some intervals of a slow stream."""
        return not self.ended and time.monotonic() - self._heard_s > stall_after_s(tuple(self._times_us), self._stall_s)

    @property
    def skipped(self) -> int:
        """Frames that were decoded and replaced by newer ones before they were requested."""
        return self._progress.skipped + self._late

    @property
    def undecoded(self) -> int:
        """Packets recorded but never decoded, because of damage or because decoding had fallen behind."""
        return self._progress.undecoded

    @property
    def damaged(self) -> int:
        """Packets and frames that the decoder or the transport reports as incomplete or damaged."""
        return self._progress.damaged

    @property
    def strangers(self) -> int:
        """Datagrams from other senders than the one being listened to, dropped."""
        return self._progress.strangers

    @property
    def sender(self) -> Sender | None:
        """Sender of the datagrams that are listened to; None while there is none, and where it is not datagrams."""
        return self._progress.sender

    @property
    def rival(self) -> Sender | None:
        """Another sender of video to the same port, None if there is none; ``vision.stream.senders`` has the rule."""
        return self._progress.rival

    def prefer(self, sender: Sender) -> None:
        """Listen to a sender before all others, from its next key frame on."""
        with contextlib.suppress(OSError):  # it is gone, and another begins as the last one was
            self._supervisor.process.channel.send(Preference(sender=sender), ANSWER_S)

    @property
    def exposure(self) -> str:
        """Source of the frames' times, in words; empty while it is their arrival."""
        progress = self._progress
        if progress.exposure_source:
            word, delay_s = _EXPOSURE_SOURCES.get(progress.exposure_source, "word"), progress.exposure_delay_s
            return f"by the stream's own {word}, {delay_s:.2f} s before they come"
        if progress.clock_error_s:
            return f"by when they come: the stream's own clock is {progress.clock_error_s:+.1f} s off and not used"
        return ""

    @property
    def error(self) -> str:
        """Last trouble in a line, empty when there is none."""
        return self._conceal(self._progress.error or self._trouble or self._rows_error)

    @property
    def recording_error(self) -> str:
        """Reason why the recording broke off, empty while it is well."""
        return self._conceal(self._progress.recording_error)

    @property
    def process_id(self) -> int:
        """Id of the process that reads the video now."""
        return self._supervisor.process.pid

    @property
    def restarts(self) -> int:
        """Number of times that the video's process was started again."""
        return self._supervisor.restarts

    def latest(self, timeout_s: float) -> Frame | None:
        """The newest frame that was not given out yet; None when none comes within ``timeout_s``."""
        with self._asking:
            deadline_s = time.monotonic() + timeout_s
            while not self._stop.is_set():
                process, wait_s = self._supervisor.process, max(deadline_s - time.monotonic(), 0.0)
                self._asked += 1
                with contextlib.suppress(OSError):  # it is gone, and another answers the next time
                    process.channel.send(FrameRequest(number=self._asked, wait_s=wait_s), ANSWER_S)
                with self._answered:
                    self._answered.wait_for(partial(self._is_answered, process), wait_s + ANSWER_S)
                    answer, self._answer = self._answer, None
                if answer is not None:
                    return self._frame(answer)
                if time.monotonic() >= deadline_s:
                    return None
            return None

    def close(self) -> None:
        """Stop reading and seal the recording; returns within 2.5 s, may be called twice."""
        self._stop.set()
        self._notify(None)
        self._supervisor.stop(CLOSE_S + ANSWER_S)
        self._memory.close()
        if self._port is not None:
            self._port.close()

    def __enter__(self) -> VideoStream:
        return self

    def __exit__(self, *args: object) -> None:
        self.close()

    def _is_answered(self, process: ChildProcess[VideoReport]) -> bool:
        return self._answer is not None or self._stop.is_set() or process is not self._supervisor.process

    def _frame(self, answer: FrameReply) -> Frame | None:
        """A copy of the frame that was handed over, None if there is none of that size."""
        size = answer.width * answer.height * 3
        if answer.index < 0 or answer.width <= 0 or not 0 < size <= IMAGE_BYTES:
            return None
        image = self._images[:size].reshape(answer.height, answer.width, 3).copy()
        return Frame(index=answer.index, t_us=answer.t_us, image=image)

    # ---- one process after the other

    def _start(self) -> ChildProcess[VideoReport]:
        fds = [self._memory.fileno(), *([] if self._port is None else [self._port.fileno()])]
        # numpy only carries frames there: threads for algebra would take memory for nothing
        environment = {"OPENBLAS_NUM_THREADS": "1"}
        return ChildProcess("vision.stream.stream_worker", VideoReport, fds=fds, environment=environment)

    def _begin(self, process: ChildProcess[VideoReport]) -> None:
        """Start a process that continues where the last one stopped, in a new file."""
        self._before = done = self._progress
        self._progress = Progress(patience_s=START_PATIENCE_S, rows=[], segment=done.segment, proven=done.proven).after(
            done
        )
        settings = msgspec.structs.replace(
            self._settings, segment=done.segment, received=self.received, last_us=self._last_us, proven=done.proven
        )
        with contextlib.suppress(OSError):  # it is gone already, which is seen when it is watched
            process.channel.send(settings)

    def _watch(self, process: ChildProcess[VideoReport], timeout_s: float) -> float | None:
        """Handle a message of the process; returns how long it may be silent afterwards."""
        message = process.channel.receive(timeout_s)
        if isinstance(message, FrameReply):
            self._hand_over(message)
        if not isinstance(message, Progress):
            return None
        self._take_progress(message)
        self._supervisor.replaces = not message.ended
        return math.inf if message.ended else message.patience_s

    def _note_restart(self, failure: str, alive_s: float) -> None:
        del alive_s
        self._trouble = f"video {self.url}: its process {failure} and was started again"
        self._notify(None)

    def _take_progress(self, progress: Progress) -> None:
        """Frames listed and numbers counted."""
        if progress.rows and progress.connected:
            self._end_stall(len(progress.rows))
        for index, t_us in progress.rows:
            self.received, self._last_us = index + 1, t_us
            self._times_us.append(t_us)
            self._list_frame(index, t_us)
        self._progress = progress.after(self._before)
        if progress.ended:
            self._notify(None)

    def _end_stall(self, frames: int) -> None:
        """End a stall after a few frames: a lone one may be the last that a transport had held back."""
        if self.stalled and self._waking + frames < AWAKE:
            self._waking += frames
        else:
            self._waking, self._heard_s = 0, time.monotonic()

    def _list_frame(self, index: int, t_us: int) -> None:
        if self._on_frame is None:
            return
        try:
            self._on_frame(index, t_us)
            self._rows_error = ""
        except (OSError, ValueError) as error:
            self._rows_error = f"video {self.url}: frame times are not kept, {error}"

    def _hand_over(self, answer: FrameReply) -> None:
        if answer.number == self._asked:
            self._notify(answer)
        else:
            self._late += answer.index >= 0

    def _notify(self, answer: FrameReply | None) -> None:
        with self._answered:
            self._answer = answer or self._answer
            self._answered.notify_all()


def _bind(source: Source) -> socket.socket | None:
    """The port that datagrams come to; a port that is taken is tried again by the process, which reports the reason."""
    if source.kind != "datagrams":
        return None
    try:
        return bind(source.host, source.port)
    except VideoError:
        return None
