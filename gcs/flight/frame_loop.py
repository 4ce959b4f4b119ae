"""The main loop of a flight: queued packets, the newest frame and new events become one snapshot a turn."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

from gcs.flight.monitor import Throughput
from gcs.fold.pipeline import Pipeline
from gcs.fold.showing import HELD_US
from gcs.health.faults import Faults
from gcs.session.fold_order import NO_FRAME, FoldTurn
from gcs.session.recorder import ViewRecorder
from gcs.snapshot import Event, Health, Snapshot
from infra.wall_clock import now_us
from mavlink.protocol.packet import Packet
from vision.detect.detections import Detections
from vision.detect.detector import Detector
from vision.detect.scale_finder import ScaleFinder
from vision.detect.turns import LookInTurns
from vision.motion.estimator import MotionEstimator
from vision.motion.image_motion import ImageMotion
from vision.video.video import Frame

MAX_EVENTS = 2000
MAX_WAITING = 200_000
"""Packets: half a minute of the fastest fleet."""
PACE_FRAMES, PACE_S = 20, 2.0
MAX_LAG_US = HELD_US
"""Greatest delay behind the clock of what is shown without a frame, and the time after the last frame for which it
is."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _LookedAt:
    """A frame that the detector has seen and that is not folded in yet."""

    frame: Frame
    boxes: Detections | None
    motion: ImageMotion | None
    since_us: int
    """Time at which the frame was put aside, by the wall clock."""


class FrameLoop:
    """Folds one frame after the other. ``run_once`` belongs to one thread; the rest may be called from any.

    Args:
        pipeline: what packets and frames are folded in.
        detector: finds vehicles; None: without a camera.
        recorder: keeps what was found.
        faults: records what fails on the way.
        on_snapshot: called with each snapshot, of a frame or without one.
        now_us: the wall clock, Unix µs.

    Attributes:
        health: of the flight, set by its monitor.
        latest: the newest snapshot, None before the first.
    """

    def __init__(
        self,
        pipeline: Pipeline,
        detector: Detector | None,
        recorder: ViewRecorder,
        faults: Faults,
        on_snapshot: Callable[[Snapshot], None],
        now_us: Callable[[], int] = now_us,
    ) -> None:
        self._pipeline, self._detector, self._recorder = pipeline, detector, recorder
        self._scale = ScaleFinder(detector)
        self._turns = LookInTurns(detector, pipeline.mission.detector.score) if detector else None
        self._motions = MotionEstimator()
        self._moved: ImageMotion | None = None
        self._faults, self._on_snapshot = faults, on_snapshot
        self._now_us = now_us
        self._waiting: deque[Packet] = deque(maxlen=MAX_WAITING)
        self._packets_dropped = 0
        self._heard_us = 0
        self._new_events: deque[Event] = deque()
        self._events: deque[Event] = deque(maxlen=MAX_EVENTS)
        self._frames = 0
        self._looked_at: deque[_LookedAt] = deque()
        """Frames that wait for the telemetry of their time, in order."""
        self._records = self._record_us = 0
        """Number of the record after the one taken in last, and the stamp of that one."""
        self._lag_us = self._shown_us = 0
        """Delay with which the last frame was shown after it was taken, µs, and the time of that."""
        self._frame_ends: deque[float] = deque(maxlen=PACE_FRAMES)
        self.health = Health()
        self.latest: Snapshot | None = None

    def add_packets(self, packets: Sequence[Packet], heard_us: int) -> None:
        """Queue packets for the next turn; where too many wait, the oldest are dropped and counted.

        Args:
            packets: in order of arrival.
            heard_us: with these, everything received before this Unix time is queued.
        """
        self._packets_dropped += max(len(self._waiting) + len(packets) - MAX_WAITING, 0)
        self._waiting.extend(packets)
        self._heard_us = heard_us

    def add_event(self, event: Event) -> None:
        """Queue an event of the links, the recording or the operator for the next snapshot."""
        self._new_events.append(event)

    def events(self) -> Sequence[Event]:
        """Events so far, oldest first, bounded in number."""
        return tuple(self._events)

    @property
    def throughput(self) -> Throughput:
        """Number of frames that it processes, and how fast."""
        ends = tuple(self._frame_ends)
        fps = (len(ends) - 1) / (ends[-1] - ends[0]) if len(ends) > 1 and time.monotonic() - ends[-1] < PACE_S else 0.0
        return Throughput(frames=self._frames, fps=fps, packets_dropped=self._packets_dropped)

    def run_once(self, frame: Frame | None) -> None:
        """Run one turn: fold in the queued packets and events, and each frame whose telemetry has come or is late.

        Args:
            frame: the newest, None if none came since the last turn.
        """
        heard_us = self._heard_us
        self.take_in_packets()
        while self._new_events:
            self._pipeline.add_event(self._new_events.popleft())
        if frame:
            self._looked_at.append(self._look_at(frame))
        elif not self._looked_at:
            self._show(self._process_without_frame(heard_us))
        while self._looked_at and not self._awaits(self._looked_at[0], heard_us):
            self._show(self._process_frame(self._looked_at.popleft(), heard_us))

    def take_in_packets(self) -> None:
        """Fold in the queued packets alone; of the thread of ``run_once``, or before there is one."""
        while self._waiting:
            self._process_packet(self._waiting.popleft())

    @property
    def frames_wait(self) -> bool:
        """True if frames wait for telemetry, so that the next turn should come soon."""
        return bool(self._looked_at)

    def close(self) -> None:
        """Fold in the frames that still wait, and all that came since the last turn: marks of the last moment, too."""
        try:
            while self._looked_at:
                self._show(self._process_frame(self._looked_at.popleft(), self._heard_us))
            self.run_once(None)
        except Exception as error:  # noqa: BLE001 - the recording is sealed all the same
            self._faults.turn_failed("naming", error)
        self._recorder.events(tuple(self._new_events))

    def _show(self, snapshot: Snapshot) -> None:
        self._events.extend(snapshot.events)
        self.latest = snapshot
        self._on_snapshot(snapshot)

    def _awaits(self, looked_at: _LookedAt, heard_us: int) -> bool:
        """Tell whether a frame's telemetry is still to come; where nothing is heard at all the wall clock decides."""
        waits_us = self._now_us() - looked_at.since_us
        return 0 <= waits_us < self._pipeline.wait_us and self._pipeline.awaits_telemetry(
            looked_at.frame.t_us, heard_us
        )

    def _process_packet(self, packet: Packet) -> None:
        if packet.record >= 0:
            self._note_record(packet)
        try:
            self._pipeline.add_packet(packet)
        except Exception as error:  # noqa: BLE001 - one packet must not cost a frame
            self._faults.record(f"packet of system {packet.system_id}", error)

    def _note_record(self, packet: Packet) -> None:
        """Note its place in the log: what the fold skips has to be skipped by a replay too."""
        if packet.record > self._records:
            self._recorder.unfolded(self._records, packet.record - self._records)
        self._records, self._record_us = packet.record + 1, packet.t_us

    def _look_at(self, frame: Frame) -> _LookedAt:
        boxes = self._detect(frame)
        motion = None if boxes is None else self._compare(frame, boxes)
        return _LookedAt(frame=frame, boxes=boxes, motion=motion, since_us=self._now_us())

    def _process_frame(self, looked_at: _LookedAt, heard_us: int) -> Snapshot:
        """Fold in and record a frame."""
        frame, boxes = looked_at.frame, looked_at.boxes
        self._frames += 1
        self._frame_ends.append(time.monotonic())
        self._shown_us = self._now_us()
        self._lag_us = max(self._shown_us - frame.t_us, 0)
        behind_s = _behind_s(frame.t_us, heard_us)
        health = replace(self.health, frames=self._frames, lag_s=self._lag_us * 1e-6, behind_s=behind_s)
        snapshot = self._pipeline.add_frame(
            frame.index,
            frame.t_us,
            image=frame.image,
            detections=boxes,
            motion=looked_at.motion,
            health=health,
            heard_us=heard_us,
        )
        self._record_turn(frame.index, frame.t_us, heard_us, boxes, (frame.image.shape[1], frame.image.shape[0]))
        self._recorder.snapshot(snapshot)
        return snapshot

    def _record_turn(
        self,
        frame: int,
        t_us: int,
        heard_us: int,
        boxes: Detections | None = None,
        size: tuple[int, int] | None = None,
    ) -> None:
        """Record what this turn was made of; size: width and height of the frame, px."""
        turn = FoldTurn(
            t_us=t_us,
            records=self._records,
            record_us=self._record_us,
            heard_us=heard_us,
            frame=frame,
            boxes=None if boxes is None else len(boxes),
            size=size,
        )
        self._recorder.fold(turn)

    def _detect(self, frame: Frame) -> Detections | None:
        """Boxes, recorded; None where the detector failed, so that the fleet goes on without it."""
        assert self._turns is not None
        try:
            known_m = self._pipeline.gsd_m(frame.t_us, frame.image)
            boxes = self._turns.look(
                *(frame.image, frame.t_us, self._scale.gsd_m(frame.image, frame.t_us, known_m)),
                moved=self._moved.H if self._moved else None,
                reported=partial(self._pipeline.reported_px, frame.t_us, frame.image),
            )
        except Exception as error:  # noqa: BLE001 - a detector that fails must not cost the fleet's table
            self._faults.turn_failed("detecting", error)
            return None
        self._faults.turn_succeeded("detecting")
        self._pipeline.add_news(frame.t_us, self._scale.news())
        boxes = boxes.useful(self._pipeline.mission.detector.score)
        self._recorder.detections(frame.index, boxes)
        return boxes

    def _compare(self, frame: Frame, boxes: Detections) -> ImageMotion | None:
        """Return how the camera moved since the last frame that was looked at, and record it; None where that cannot be
        told."""
        self._moved = None
        try:
            motion = self._motions.update(frame.image, boxes.at_least(self._pipeline.mission.detector.score))
        except Exception as error:  # noqa: BLE001 - names do without it
            self._faults.turn_failed("comparing images", error)
            return None
        self._faults.turn_succeeded("comparing images")
        self._moved = motion
        if motion is not None:
            self._recorder.motion(frame.index, motion)
        return motion

    def _process_without_frame(self, heard_us: int) -> Snapshot:
        """Fold without a new frame: the fleet goes on, the last image stays on the screen."""
        now_us = self._now_us()
        # the next frame is as old as the last when it comes: time must not be ahead of it
        lag_us = min(self._lag_us, MAX_LAG_US) if 0 <= now_us - self._shown_us < MAX_LAG_US else 0
        t_us = now_us - lag_us
        if self.latest is not None and t_us == self.latest.seen_us:
            t_us += 1  # boxes of the very time of a snapshot are new ones
        health = replace(self.health, lag_s=lag_us * 1e-6, behind_s=_behind_s(t_us, heard_us))
        snapshot = self._pipeline.add_frame(NO_FRAME, t_us, health=health, heard_us=heard_us)
        self._record_turn(NO_FRAME, t_us, heard_us)
        self._recorder.events(snapshot.events)
        return replace(snapshot, image=self.latest.image) if self.latest else snapshot


def _behind_s(t_us: int, heard_us: int) -> float:
    """Return how far telemetry is behind a moment, s; 0 where it is not or nothing is known."""
    return max(t_us - heard_us, 0) * 1e-6 if heard_us else 0.0
