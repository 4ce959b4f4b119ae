"""Packets of a live stream: numbered, timed, recorded, decoded. Runs in the stream's own process.

Every frame from the first key frame on has an index and a time, whether it can be decoded or not. Of the decoded
ones only the newest is kept for the parent.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import av
from av.video.frame import VideoFrame

from vision.stream.connection import READ_TIMEOUT_S, Input, listen
from vision.stream.frame_clock import ArrivalClock
from vision.stream.messages import Progress, Settings
from vision.stream.stamps import Coded, Stamps
from vision.video.recording import DisplayOrder, Recording

BEHIND_S = 0.4
"""Decoding has fallen behind when no packet had to be waited for this long; then none is up to the next key frame."""
WAITED_S = 0.003
"""A packet that one had to wait this long for was not buffered."""
PROBED = 600
"""Most packets held back while those buffered at opening are drained."""
READING_PATIENCE_S = READ_TIMEOUT_S + 1.5
"""Time within which the next report is promised while a packet is read, seconds."""
REMEMBERED = 256
"""Places of frames that may still come out of the decoder."""


class NewestFrame:
    """The newest decoded frame until it is popped."""

    def __init__(self) -> None:
        self.skipped = 0
        self.over = False
        self._fresh = threading.Condition()
        self._frame: tuple[int, int, VideoFrame] | None = None

    def put(self, index: int, t_us: int, frame: VideoFrame) -> None:
        """Keep a decoded frame; one that it replaces before it was popped is counted in ``skipped``."""
        with self._fresh:
            self.skipped += self._frame is not None
            self._frame = index, t_us, frame
            self._fresh.notify_all()

    def pop(self, timeout_s: float) -> tuple[int, int, VideoFrame] | None:
        """Index, time (Unix µs) and frame of the newest, waited for; None when none comes in time."""
        with self._fresh:
            self._fresh.wait_for(lambda: self._frame is not None or self.over, timeout_s)
            frame, self._frame = self._frame, None
            return frame

    def end(self) -> None:
        """Note that no more frames will come."""
        with self._fresh:
            self.over = True
            self._fresh.notify_all()


class StreamReader:
    """All connections of one process.

    Args:
        settings: where the last process stopped.
        go_on: False ends reading.
        send: called with progress for the parent.
    """

    def __init__(self, settings: Settings, go_on: Callable[[], bool], send: Callable[[Progress], None]) -> None:
        self.newest = NewestFrame()
        self.progress = Progress(patience_s=READING_PATIENCE_S, rows=[], segment=settings.segment)
        self.order = DisplayOrder(settings.received)
        self.last_us = settings.last_us
        self.offset_s = settings.offset_s
        self.recording = Recording(Path(settings.record), settings.segment) if settings.record else None
        self.go_on = go_on
        self.lock = threading.Lock()
        """Lock that is held while packets are numbered and recorded."""
        self._send = send
        self._sent_s = 0.0
        self._connection: _OpenStream | None = None

    def report_alive(self, patience_s: float = READING_PATIENCE_S) -> None:
        """Report being alive and when the next report is due; not more often than needed."""
        now = time.monotonic()
        if now - self._sent_s > 0.25 or patience_s != self.progress.patience_s or self.progress.rows:
            self.progress.patience_s, self._sent_s = patience_s, now
            self.send_progress()

    def send_progress(self) -> None:
        """Send what is new."""
        progress = self.progress
        progress.skipped = self.newest.skipped
        if self.recording is not None:
            progress.segment, progress.recording_error = self.recording.segment, self.recording.error
        self._send(progress)
        progress.rows = []

    def read(self, source: Input, *, paced: bool) -> None:
        """One connection until it ends.

        Raises:
            av.FFmpegError: it broke.
        """
        self.progress.connections += 1
        self.progress.error = ""
        self._connection = _OpenStream(self, source, paced)
        try:
            self._connection.run()
        finally:
            self.progress.connected = False
            with self.lock:
                self._end_connection()

    def finish(self) -> None:
        """List what still waits and seal the recording; may be called from another thread while reading hangs."""
        with self.lock:
            self._end_connection()
            if self.recording is not None:
                self.recording.close()
            self.send_progress()

    def _end_connection(self) -> None:
        connection, self._connection = self._connection, None
        if connection is not None:
            connection.list(self.order.flush())


class _OpenStream:
    """Packets of one connection."""

    def __init__(self, reader: StreamReader, source: Input, paced: bool) -> None:
        self._reader = reader
        self._source = source
        self._stream = source.stream
        self._tick_s = source.tick_s
        self._clock = ArrivalClock()
        self._paced = paced
        self._first: tuple[float, float] | None = None
        self._stamps = Stamps(self._tick_s)
        self._placed: dict[int, tuple[int, int]] = {}
        self._decoding = False
        self._busy_since_s = time.monotonic()
        self._key_pts: int | None = None

    def run(self) -> None:
        """Read until the source ends, breaks or is closed."""
        held: list[tuple[Coded, float]] | None = None if self._paced else []
        try:
            for packet, waited in self._received():
                if packet.size:
                    arrival_s = self._arrive(packet)
                    self._note_arrival()
                    if held is not None:
                        # what was buffered while opening came earlier than now: it waits for one that is on time
                        held.append((packet, arrival_s))
                    if held is None:
                        self._settle([(packet, arrival_s)])
                    elif waited or len(held) >= PROBED:
                        whole, held = held, None
                        self._settle(whole)
                self._reader.report_alive()
        finally:
            # also where the connection breaks
            self._settle(held or [])
            self._show(None)

    def _received(self) -> Iterator[tuple[Coded, bool]]:
        """Packets while there are to be any, and whether each had to be waited for."""
        asked_s = time.monotonic()
        for packet in self._source.packets:
            if not (self._reader.go_on() or self._source.drains):
                return
            now_s = time.monotonic()
            waited = now_s - asked_s > WAITED_S
            if waited or self._paced:
                self._busy_since_s = now_s
            yield packet, waited
            asked_s = time.monotonic()

    def _note_arrival(self) -> None:
        progress, exposures = self._reader.progress, self._source.exposures
        progress.connected = self._source.live()
        progress.exposure_source, progress.exposure_delay_s = exposures.source, exposures.delay_s
        progress.clock_error_s = exposures.error_s

    def _arrive(self, packet: Coded) -> float:
        """Unix time of arrival; a file's packets arrive at the pace of their time stamps."""
        if self._paced and packet.dts is not None:
            decoded_s = packet.dts * self._tick_s
            self._first = self._first or (decoded_s, time.monotonic())
            due_s = self._first[1] + decoded_s - self._first[0]
            while self._reader.go_on() and (wait_s := due_s - time.monotonic()) > 0:
                self._reader.report_alive()
                time.sleep(min(wait_s, 0.1))
        return self._source.arrival_s(packet)

    def _settle(self, packets: list[tuple[Coded, float]]) -> None:
        """Learn the arrivals of packets that came together, then use the packets."""
        self._stamps.fill(packets)
        learnt: list[Coded] = []
        for packet, arrival_s in packets:
            if packet.pts is None:
                continue
            if self._stamps.has_restarted(packet, arrival_s):
                self._use(learnt)
                learnt = []
                with self._reader.lock:
                    self._renew()
                self._clock = ArrivalClock()
            # what is drained at the end comes before its time
            if self._reader.go_on() or not self._clock.known:
                self._clock.add(packet.pts * self._tick_s, arrival_s)
                if not self._paced:
                    listen(self._source, packet, arrival_s)
            learnt.append(packet)
        self._use(learnt)

    def _use(self, packets: list[Coded]) -> None:
        for packet in packets:
            with self._reader.lock:
                taken = self._place(packet)
            if taken:
                self._decode(packet)

    def _renew(self) -> None:
        """Drop what waits: only a key frame can begin from here on."""
        self.list(self._reader.order.flush())
        self._placed.clear()
        self._key_pts = None

    def _place(self, packet: Coded) -> bool:
        """Record, number and time one packet, from the first key frame on; False for what has no place."""
        reader, order, pts = self._reader, self._reader.order, packet.pts or 0
        taken_s = self._taken_s(pts)
        recording = reader.recording
        if packet.is_keyframe and recording is not None and recording.wants_segment(self._stream, taken_s):
            self._renew()
            recording.begin(self._stream, order.count, taken_s)
        if self._key_pts is None and packet.is_keyframe:
            self._key_pts = pts
        # frames shown before the first key frame have nothing to be decoded from
        if self._key_pts is None or pts < self._key_pts or order.repeats(pts):
            return False
        if recording is not None:
            recording.write(packet, taken_s)
        reader.progress.damaged += packet.is_corrupt
        self.list(order.add(pts, pts if packet.dts is None else packet.dts))
        return True

    def _taken_s(self, pts: int) -> float:
        """Unix time at which a frame was taken: by the stream's own exposure times, else by its arrival."""
        stamp_s = pts * self._tick_s
        stamped_s = self._source.exposures.unix_s(stamp_s)
        return self._clock.unix_s(stamp_s) - self._reader.offset_s if stamped_s is None else stamped_s

    def list(self, released: list[tuple[int, int]]) -> None:
        """Give frames whose place in the order is certain their time, and report them."""
        reader = self._reader
        for index, pts in released:
            t_us = round(self._taken_s(pts) * 1e6)
            reader.last_us = t_us = max(t_us, reader.last_us + 1)
            self._placed[pts] = index, t_us
            reader.progress.rows.append((index, t_us))
        while len(self._placed) > REMEMBERED:
            del self._placed[next(iter(self._placed))]

    def _decode(self, packet: Coded) -> None:
        """Decode unless that has fallen behind."""
        behind = not self._paced and time.monotonic() - self._busy_since_s > BEHIND_S
        if packet.is_keyframe:
            self._decoding = True
            self._busy_since_s = max(self._busy_since_s, time.monotonic() - BEHIND_S / 2)
        elif behind:
            self._decoding = False
        if self._decoding:
            self._show(packet)
        else:
            self._reader.progress.undecoded += 1
            self._source.shown()

    def _show(self, packet: Coded | None) -> None:
        """Decode; the last frame that comes out is the newest."""
        reader = self._reader
        try:
            frames: list[Any] = self._stream.codec_context.decode(packet)
        except (av.FFmpegError, ValueError):
            reader.progress.undecoded += packet is not None
            return
        if frames:
            self._source.shown()
        for frame in frames:
            pts = frame.pts
            if pts is None:
                continue
            reader.progress.damaged += frame.is_corrupt
            place = self._placed.get(pts)
            if place is None:
                place = reader.order.place(pts), round(self._taken_s(pts) * 1e6)
            reader.newest.put(*place, frame)
