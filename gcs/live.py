"""A flight: links and camera in, recording and snapshots out.

Telemetry and video each come in through a process of their own, which records them untouched. Here, one thread takes
packets, one the pictures, one folds. The fold takes only the newest frame; what it skips is still recorded and counted.
"""

from __future__ import annotations

import os
import shutil
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, cast

from gcs.config import Mission
from gcs.flight_health import flight_health
from gcs.flight_video import FlightVideo, check_source
from gcs.perception import open_perception
from gcs.pipeline import Pipeline
from gcs.recorder import Recorder
from gcs.snapshot import Event, Health, Level, Snapshot
from gcs.station import Commands
from mavlink.ingest.ingest import Ingest
from mavlink.ingest.plan import Outputs, Signing
from mavlink.keys import KeyRing, read_ring
from mavlink.outgoing import SYSTEM_ID
from mavlink.packet import Packet
from mavlink.rates import RateKeeper
from vision.detector import Detector
from vision.video import Frame

if TYPE_CHECKING:
    from gcs.command import CommandDesk

__all__ = ["Flight", "FlightPlan"]

READ_S = 0.2
IDLE_S = 0.2
"""Without a new frame for this long the fleet is shown all the same."""
HEALTH_S = 0.5
MOST_EVENTS = 2000
LOOK_THREADS = min(os.cpu_count() or 1, 2)
"""Of the detector: the newest picture is looked at alone, and soon."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightPlan:
    """What to listen to, and where to keep it."""

    mission: Mission
    links: tuple[str, ...]
    video: str
    """Empty: no camera; ``auto``: the stream that the UAV offers, once it does."""
    sessions: Path
    forward: tuple[str, ...] = ()
    """Where packets go on to, as they came."""
    command: bool = False
    """Whether this station may speak: beat, ask for rates, and command the UAV."""


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
        mission = plan.mission
        self._ring = read_ring(mission.signing.folder) if mission.signing.folder else KeyRing()
        self._detector: Detector | None = None
        if plan.video:
            check_source(plan.video)
            self._detector = open_perception(mission.detector, threads=LOOK_THREADS)
        self._recorder = Recorder(plan.sessions, mission, video=bool(plan.video), telemetry=False)
        self._desk: CommandDesk | None = None
        try:
            self._ingest = _open_ingest(plan, self._recorder.tlog_path)
        except BaseException:
            # nothing was received: what is in the folder are headings
            self._recorder.close()
            shutil.rmtree(self._recorder.folder, ignore_errors=True)
            raise
        self._video = FlightVideo(plan.video, self._recorder)
        self._pipeline = Pipeline(mission, links=self._ingest.names)
        self._queue: deque[Packet] = deque()
        self._rates = RateKeeper(None, mission.uav.system_id, mission.ugv_ids)
        self._said: deque[Event] = deque()
        self._events: deque[Event] = deque(maxlen=MOST_EVENTS)
        self._latest: Snapshot | None = None
        self._health = Health(recording=True, free_bytes=self._recorder.free_bytes, keys=len(self._ring))
        self._health_due = 0.0
        self._frames = 0
        self._frame_ends: deque[float] = deque(maxlen=20)
        self._stop = threading.Event()
        self._stopped = threading.Lock()
        self._closed = False
        self.lost: tuple[str, ...] = ()
        self.error: BaseException | None = None
        if plan.command:
            self._desk = self._open_desk(mission)
        jobs = {"telemetry": self._listen, "fold": self._fold}
        self._threads = [
            threading.Thread(target=self._guard, args=(job,), name=name, daemon=True) for name, job in jobs.items()
        ]
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
        """Telemetry packets recorded, of all links."""
        return self._ingest.health().packets

    @property
    def commands(self) -> Commands | None:
        """The command desk, None for a station that listens only."""
        return self._desk

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
        if self._desk:
            self._desk.close()
        self._video.close()
        for thread in self._threads:
            if thread is not threading.current_thread():
                thread.join(timeout=5)
        self._ingest.stop()
        self.lost = self._recorder.close(self._ingest.health().record)

    def _open_desk(self, mission: Mission) -> CommandDesk:
        # MAVSDK's native library is loaded only by stations that may command
        from gcs.steering import open_desk, place_of

        return open_desk(
            mission,
            self._ingest,
            self._ring,
            where=lambda system_id: place_of(system_id, self._latest, self._pipeline.fleet.origin),
            tell=self._said.append,
        )

    def _guard(self, work: Callable[..., None], *args: object) -> None:
        """Run a thread's work; what ends it is kept for the screen to tell and the flight stops."""
        try:
            work(*args)
        except Exception as error:  # noqa: BLE001 - told on the screen and in the exit code, never swallowed
            self.error = error
            self._stop.set()

    def _listen(self) -> None:
        while not self._stop.is_set():
            packets = self._ingest.read(READ_S)
            self._queue.extend(packets)
            if self._desk:
                for packet in packets:
                    self._desk.take(packet)
            elif packets:
                now_s = time.monotonic()
                for packet in packets:
                    self._rates.take(packet, now_s)

    def _fold(self) -> None:
        while not self._stop.is_set():
            frame = self._video.latest(IDLE_S)
            if self._video.stream is None:
                self._stop.wait(IDLE_S)
            while self._queue:
                self._pipeline.feed(self._queue.popleft())
            while self._said:
                self._pipeline.note(self._said.popleft())
            if self._desk:
                self._desk.poll()
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
        """Twice a second: counters, disk, video."""
        now = time.monotonic()
        if now < self._health_due:
            return
        self._health_due = now + HEALTH_S
        ends = self._frame_ends
        fps = (len(ends) - 1) / (ends[-1] - ends[0]) if len(ends) > 1 and now - ends[-1] < 2 else 0.0
        ingest = self._ingest.health()
        for notice in self._ingest.notices():
            self._note(notice.t_us, cast(Level, notice.level), "link", notice.text)
        for event in self._recorder.check(ingest.record):
            self._pipeline.note(event)
        if self._desk is None:
            for rate in self._rates.troubles(now):
                self._note(time.time_ns() // 1000, "warning", "link", rate.words)
        for event in self._video.check(self._pipeline.fleet.video_offer):
            self._pipeline.note(event)
        self._health = flight_health(
            ingest, self._recorder, self._video, keys=len(self._ring), frames=self._frames, fps=fps
        )

    def _note(self, t_us: int, level: Level, kind: str, text: str) -> None:
        self._pipeline.note(Event(t_us=t_us, level=level, kind=kind, text=text))


def _open_ingest(plan: FlightPlan, log: Path) -> Ingest:
    mission = plan.mission
    signing = mission.signing
    return Ingest(
        plan.links,
        log,
        system_ids=(mission.uav.system_id, *mission.ugv_ids),
        signing=Signing(
            keys=str(signing.folder) if signing.folder else "", unsigned=signing.unsigned, keyless=signing.keyless
        ),
        outputs=Outputs(urls=plan.forward, write_back=plan.command, own=SYSTEM_ID),
    )
