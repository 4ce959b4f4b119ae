"""A flight: links and camera in, recording and snapshots out.

One thread for each link (stamp, record, hand on), the video stream's own thread, one thread for the fold. The fold
takes only the newest frame; what it skips is still recorded and counted.
"""

from __future__ import annotations

import os
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from gcs.config import Mission
from gcs.perception import open_perception
from gcs.pipeline import Pipeline
from gcs.recorder import Recorder
from gcs.snapshot import Event, Health, Level, LinkHealth, Snapshot
from mavlink.link import Link, open_link
from mavlink.packet import Packet
from vision.detector import Detector
from vision.stream import VideoStream
from vision.video import Frame

__all__ = ["Flight", "FlightPlan"]

READ_S = 0.2
IDLE_S = 0.2
"""Without a new frame for this long the fleet is shown all the same."""
HEALTH_S = 1.0
MOST_EVENTS = 2000
LOOK_THREADS = min(os.cpu_count() or 1, 2)
"""Of the detector: the newest picture is looked at alone, and soon."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightPlan:
    """What to listen to, and where to keep it."""

    mission: Mission
    links: tuple[str, ...]
    video: str
    """Empty: no camera."""
    sessions: Path


class Flight:
    """A station (``gcs.station.Station``) in flight."""

    timeline = None

    def __init__(self, plan: FlightPlan, on_snapshot: Callable[[Snapshot], None] = lambda snapshot: None) -> None:
        """Open links, camera, detector and recording, then start.

        Args:
            plan: What to listen to.
            on_snapshot: Called in the fold's thread with each frame that was looked at.

        Raises:
            LinkError, ModelError, SessionError: something cannot be opened; nothing is left open.
        """
        self._on_snapshot = on_snapshot
        self._detector: Detector | None = None
        if plan.video:
            self._detector = open_perception(plan.mission.detector, threads=LOOK_THREADS)
        self._links: list[Link] = []
        try:
            self._links += (open_link(url, k) for k, url in enumerate(plan.links))
            self._recorder = Recorder(plan.sessions, plan.mission, video=bool(plan.video))
        except BaseException:
            self._close_links()
            raise
        self._pipeline = Pipeline(plan.mission)
        self._queue: deque[Packet] = deque()
        self._events: deque[Event] = deque(maxlen=MOST_EVENTS)
        self._latest: Snapshot | None = None
        self._health = Health(recording=True, free_bytes=self._recorder.free_bytes)
        self._health_due = 0.0
        self._frames = 0
        self._frame_ends: deque[float] = deque(maxlen=20)
        self._stop = threading.Event()
        self._stopped = threading.Lock()
        self._closed = False
        self.error: BaseException | None = None
        self._stream: VideoStream | None = None
        if plan.video:
            self._stream = VideoStream(plan.video, self._recorder.video_path, on_frame=self._recorder.frame_time)
        self._threads = [
            threading.Thread(target=self._guard, args=(self._listen, link), name=link.name, daemon=True)
            for link in self._links
        ]
        self._threads.append(threading.Thread(target=self._guard, args=(self._fold,), name="fold", daemon=True))
        for thread in self._threads:
            thread.start()

    @property
    def title(self) -> str:
        """Where it is recorded."""
        return self._recorder.folder.name

    @property
    def folder(self) -> Path:
        """The session folder."""
        return self._recorder.folder

    @property
    def packets(self) -> int:
        """Telemetry packets received on all links."""
        return sum(link.counts.packets for link in self._links)

    def latest(self) -> Snapshot | None:
        """The newest snapshot."""
        return self._latest

    def events(self) -> Sequence[Event]:
        """What happened so far."""
        return tuple(self._events)

    def stop(self) -> None:
        """End the threads, then seal the recording."""
        with self._stopped:
            if self._closed:
                return
            self._closed = True
        self._stop.set()
        if self._stream:
            self._stream.close()
        for thread in self._threads:
            if thread is not threading.current_thread():
                thread.join(timeout=5)
        self._close_links()
        self._recorder.close()

    def _close_links(self) -> None:
        for link in self._links:
            link.close()

    def _guard(self, work: Callable[..., None], *args: object) -> None:
        """Run a thread's work; what ends it is kept for the screen to tell and the flight stops."""
        try:
            work(*args)
        except Exception as error:  # noqa: BLE001 - told on the screen and in the exit code, never swallowed
            self.error = error
            self._stop.set()

    def _listen(self, link: Link) -> None:
        while not self._stop.is_set():
            for packet in link.read(READ_S):
                self._recorder.packet(packet)
                self._queue.append(packet)

    def _fold(self) -> None:
        while not self._stop.is_set():
            frame = self._stream.latest(IDLE_S) if self._stream else None
            if self._stream is None:
                self._stop.wait(IDLE_S)
            while self._queue:
                self._pipeline.feed(self._queue.popleft())
            self._look_after()
            snapshot = self._look(frame) if frame else self._wait()
            self._events.extend(snapshot.events)
            self._latest = snapshot

    def _look(self, frame: Frame) -> Snapshot:
        """A new frame: detect, fold, record."""
        assert self._detector is not None
        boxes = self._detector.detect(frame.image, gsd_m=self._pipeline.gsd_m(frame.t_us, frame.image))
        self._recorder.detections(frame.index, boxes)
        self._frames += 1
        self._frame_ends.append(time.monotonic())
        lag_s = max(time.time() - frame.t_us * 1e-6, 0.0)
        health = replace(self._health, frames=self._frames, lag_s=lag_s)
        snapshot = self._pipeline.frame(frame.index, frame.t_us, image=frame.image, detections=boxes, health=health)
        self._recorder.snapshot(snapshot)
        self._on_snapshot(snapshot)
        return snapshot

    def _wait(self) -> Snapshot:
        """No new frame: the fleet goes on, the last picture stays."""
        now_us = time.time_ns() // 1000
        snapshot = self._pipeline.frame(-1, now_us, health=self._health)
        self._recorder.events(snapshot.events)
        last = self._latest
        if last is None or last.image is None:
            return snapshot
        return replace(snapshot, frame=last.frame, image=last.image, width=last.width, height=last.height)

    def _look_after(self) -> None:
        """Once a second: counters, disk, video."""
        now = time.monotonic()
        if now < self._health_due:
            return
        self._health_due = now + HEALTH_S
        ends = self._frame_ends
        fps = (len(ends) - 1) / (ends[-1] - ends[0]) if len(ends) > 1 and now - ends[-1] < 2 else 0.0
        video = self._video_state()
        if video != self._health.video:
            level: Level = "alarm" if video == "stalled" else "info"
            self._pipeline.note(Event(t_us=time.time_ns() // 1000, level=level, kind="video", text=f"video {video}"))
        self._health = Health(
            fps=fps,
            frames=self._frames,
            skipped_frames=self._stream.skipped if self._stream else 0,
            video=video,
            links=tuple(_link_health(link) for link in self._links),
            recorded_bytes=self._recorder.bytes,
            recording=True,
            free_bytes=self._recorder.free_bytes,
        )

    def _video_state(self) -> str:
        if self._stream is None:
            return "none"
        if self._stream.ended:
            return "ended"
        if self._stream.stalled:
            return "stalled"
        return "ok" if self._stream.received else "waiting"


def _link_health(link: Link) -> LinkHealth:
    counts = link.counts
    return LinkHealth(
        name=link.name,
        packets=counts.packets,
        bytes=counts.bytes,
        bad=counts.bad,
        dropped=counts.dropped,
        silent_s=counts.silent_s,
    )
