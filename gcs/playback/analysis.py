"""A recording folded from start to end: the same snapshots for a screen, a log or a test.

The decoder and the detector are imported when a recording needs them: to load them takes longer than many a fold.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gcs.errors import SessionError
from gcs.fold.frame_size import FrameSize, fitting_size, holds
from gcs.fold.pipeline import Pipeline
from gcs.mission.mission import Mission, MissionVehicle
from gcs.playback.recorded_order import RecordedTurns, missing_inputs
from gcs.session.fold_order import NO_FRAME
from gcs.session.frame_tables import FrameDetections, read_detections, read_times
from gcs.session.log import SessionLog
from gcs.session.session import Session
from gcs.snapshot import Event, Health, Snapshot
from mavlink.protocol.decode import decode
from mavlink.protocol.messages import Heartbeat
from mavlink.protocol.modes import is_aircraft, is_ground_vehicle
from mavlink.protocol.packet import Packet
from vision.camera.intrinsics import resized
from vision.detect.detections import Detections

if TYPE_CHECKING:
    from vision.detect.detector import Detector
    from vision.video.video import Frame, VideoFile

__all__ = ["Analysis", "discover"]

Image = NDArray[np.uint8]

# Frames a second when there is neither video nor detections: the fleet and the map still replay.
TELEMETRY_FPS = 5.0
TELEMETRY_PAUSE_US = 60_000_000
"""By then every alarm of silence has come."""


def discover(log: SessionLog) -> Mission:
    """Who flies and who drives, from the heartbeats of a log.

    Raises:
        SessionError: no aircraft or no ground vehicle sends in it.
    """
    kinds: dict[int, int] = {}
    for packet in log.accepted_packets(0):
        sample = decode(packet)
        if isinstance(sample, Heartbeat):
            kinds.setdefault(sample.system_id, sample.type)
    aircraft = sorted(i for i, kind in kinds.items() if is_aircraft(kind))
    ground = sorted(i for i, kind in kinds.items() if is_ground_vehicle(kind))
    if not aircraft or not ground:
        missing = "aircraft" if not aircraft else "ground vehicle"
        raise SessionError(f"{log.path}: no {missing} heartbeat in it; name the vehicles with --mission")
    return Mission(uav=MissionVehicle(system_id=aircraft[0]), ugv=tuple(MissionVehicle(system_id=i) for i in ground))


class Analysis:
    """One session, opened: its frames' times and the fold over them."""

    def __init__(self, session: Session, *, redetect: bool = False) -> None:
        """Open all files of a session.

        Args:
            session: What to fold.
            redetect: Look at the video again even when the session has detections.

        Raises:
            SessionError, TlogError, VideoError, ModelError: a part that cannot be used.
            CameraError: the mission's camera cannot have taken the video.
        """
        self.session = session
        self.faults = 0
        """Packets that could not be worked on."""
        self._log = SessionLog(session.tlog, session.notes.had_key_for)
        self.mission = session.mission or discover(self._log)
        self._frames = read_times(session.frames) if session.frames else None
        steps, start_us = self._log.steps, self._log.start_us
        times = steps.correct_frames(self._frames.times_us, start_us) if self._frames else None
        self.video = self._open_video(session.video, times)
        self._boxes = self._open_detections(redetect)
        self._turns = (
            RecordedTurns.open(session.folds, self._log, self._boxes) if session.folds and self._boxes else None
        )
        self.times_us = self._frame_times(times)
        self._size = self._frame_size()
        self.warnings = tuple(self._find_warnings())

    def _open_video(self, path: Path | None, times: NDArray[np.int64] | None) -> VideoFile | None:
        if path is None:
            return None
        from vision.video.video import VideoFile

        start_us = self._log.start_us + round(self.session.video_start_s * 1e6)
        return VideoFile.open(path, times, start_us=start_us)

    def _open_detections(self, redetect: bool) -> FrameDetections | None:
        path = self.session.detections
        if redetect and self.session.video is None:
            raise SessionError(f"{self.session.path}: no video to detect in; leave --detect out to use its detections")
        if path is None or redetect:
            return None
        if self.session.frames is None and self.session.video is None:
            raise SessionError(
                f"{self.session.path}: detections.csv needs frames.csv beside it, the time of each frame"
            )
        return read_detections(path)

    def _frame_times(self, times: NDArray[np.int64] | None) -> NDArray[np.int64]:
        known = self.video.times_us if self.video is not None else times
        if known is not None:
            return self._turns.times_from(known) if self._turns else known
        return _telemetry_times(self._log.times_us)

    def _frame_size(self) -> FrameSize:
        """Size of frames that have no image, as far as it is known."""
        recorded = self._turns.sizes if self._turns else set()
        if self.video is not None:
            recorded = recorded | {(self.video.width, self.video.height)}
        stated = self.session.frame_size
        if stated and recorded and stated not in recorded:
            sizes = " and ".join(f"{width}×{height}" for width, height in sorted(recorded))
            raise SessionError(f"{self.session.path}: its frames are {sizes}; leave --frame-size out")
        camera = self.mission.camera.intrinsics if self.mission.camera else None
        size = stated or (None if self.video is None else (self.video.width, self.video.height))
        if size:
            if camera is not None:
                resized(camera, *size)
            if self.video is None and self._boxes is not None and not holds(size, self._boxes):
                x, y = self._boxes.extent
                raise SessionError(
                    f"{self.session.path}: boxes lie at {x:.0f},{y:.0f} px, outside frames of {size[0]}×{size[1]}"
                )
            return FrameSize(size=size)
        if recorded or self._boxes is None or not self.session.notes.flown:
            return FrameSize()
        return fitting_size(self.mission, self._log, self.times_us, self._boxes)

    def _find_warnings(self) -> Iterator[str]:
        yield from self._log.warnings
        if self._boxes is not None and self._boxes.skipped:
            yield f"detections.csv: {self._boxes.skipped} rows could not be read and were skipped"
        yield from self._time_warnings()
        if self.video is not None and self.video.missing:
            yield f"{self.video.missing} frames were seen in flight and are not in the recorded video"
        if self.mission.camera is None or self.mission.camera.intrinsics is None:
            yield "no [camera] in the mission: boxes are named only once the UAV reports its camera"
        if self._size.doubt:
            yield self._size.doubt
        if self._turns:
            yield from self._turns.warnings
        yield from missing_inputs(
            self.session, self._log, detected_again=self.video is not None and self._boxes is None
        )

    def _time_warnings(self) -> Iterator[str]:
        if self._frames is not None and self._frames.skipped:
            yield f"frames.csv: {self._frames.skipped} rows cannot be used; their frames got the time between others"
        if self._frames is not None and self._frames.unordered:
            yield f"frames.csv: {self._frames.unordered} rows are out of order; they were sorted by frame"
        backwards = int(np.count_nonzero(np.diff(self.times_us) < 0))
        if backwards:
            yield f"the frames' time goes back {backwards} times: what is named around there is not to be trusted"

    @property
    def frames_us(self) -> NDArray[np.int64] | None:
        """(n,) when each frame was taken; None for telemetry alone."""
        return self.times_us if self.video is not None or self._frames is not None else None

    @property
    def packets_us(self) -> NDArray[np.int64]:
        """(k,) when each packet was received."""
        return self._log.times_us

    def detector(self) -> Detector | None:
        """The mission's detector when frames have to be looked at, else None."""
        if self.video is None or self._boxes is not None:
            return None
        from gcs.fold.detector_factory import open_mission_detector

        return open_mission_detector(self.mission.detector)

    def snapshots(self, *, images: bool = True) -> Iterator[Snapshot]:
        """Fold the whole recording: one snapshot for each frame.

        A flight is folded as it was flown, where it kept the order; else telemetry and frames go by their times.

        Args:
            images: Put each frame's image into its snapshot; frames of a video that cannot be decoded are left out.
        """
        senders = self._log.senders
        pipeline = Pipeline(self.mission, links=senders.names, address=senders.address, sized=self._size.known)
        for text in self.warnings:
            pipeline.add_event(Event(t_us=int(self.times_us[0]), level="warning", kind="recording", text=text))
        if self._turns is None:
            yield from self._by_time(pipeline, images)
            return
        for snapshot in self._by_turns(pipeline, self._turns, images):
            if snapshot.image is not None or not images or self.video is None:
                yield snapshot  # a video has no frames without an image

    def _by_time(self, pipeline: Pipeline, images: bool) -> Iterator[Snapshot]:
        packets = _PacketsInOrder(self._log.packets())
        for index, t_us, image, boxes in self._frames_with_boxes(images):
            for packet in packets.until(t_us):
                self._add_packet(pipeline, packet)
            shown = image if images else None
            yield pipeline.add_frame(
                index, t_us, image=shown, size=self._size.size, detections=boxes, health=self._health(index)
            )

    def _by_turns(self, pipeline: Pipeline, recorded: RecordedTurns, images: bool) -> Iterator[Snapshot]:
        """Each turn of the fold as it was made; frames that the flight did not look at show the fleet as it was.

        Events of a moment without a frame go to the snapshot before it.
        """
        places = self._frames_in_order(images)
        latest: Snapshot | None = None
        early: tuple[Event, ...] = ()
        for turn, packets, boxes in recorded.turns(len(self.times_us)):
            for packet in packets:
                self._add_packet(pipeline, packet)
            if turn.frame == NO_FRAME:
                health = self._health(latest.frame if latest else 0)
                events = pipeline.add_frame(NO_FRAME, turn.t_us, health=health, heard_us=turn.heard_us).events
                early += () if latest else events
                latest = replace(latest, events=latest.events + events) if latest else None
                continue
            now = pipeline.add_frame(
                turn.frame,
                turn.t_us,
                size=turn.size,
                detections=boxes,
                health=self._health(turn.frame),
                heard_us=turn.heard_us,
            )
            if latest is not None:
                yield latest
            for index, t_us, image in places:
                if index == turn.frame:
                    now = replace(now, image=image, events=early + now.events)
                    break
                yield _without_boxes(latest or now, index, t_us, image)
            latest, early = now, ()
        if latest is not None:
            yield latest
            for index, t_us, image in places:
                yield _without_boxes(latest, index, t_us, image)

    def _frames_in_order(self, images: bool) -> Iterator[tuple[int, int, Image | None]]:
        """Index, time and, where asked for, image of every frame."""
        frames = self.video.frames() if self.video is not None and images else iter(())
        frame = next(frames, None)
        for index, t_us in enumerate(self.times_us.tolist()):
            while frame is not None and frame.index < index:
                frame = next(frames, None)
            yield index, t_us, frame.image if frame is not None and frame.index == index else None

    def _add_packet(self, pipeline: Pipeline, packet: Packet) -> None:
        """As in a flight, a packet that cannot be worked on costs nothing else; the first is an event."""
        try:
            pipeline.add_packet(packet)
        except Exception as error:  # noqa: BLE001 - an event, below
            if not self.faults:
                text = f"a fault of this program was passed over: packet of system {packet.system_id}: {error!r}"
                pipeline.add_event(Event(t_us=packet.t_us, level="alarm", kind="recording", text=text))
            self.faults += 1

    def _health(self, index: int) -> Health:
        return Health(frames=index + 1, video="ok" if self.video else "none")

    def _frames_with_boxes(self, images: bool) -> Iterator[tuple[int, int, Image | None, Detections | None]]:
        """Index, time, image and boxes of every frame; the images only where asked for."""
        detector = self.detector()
        if detector is not None and self.video is not None:
            from vision.video.prefetch import look_ahead

            scale = _GroundScale(self.mission, _PacketsInOrder(self._log.packets()))
            with closing(look_ahead(self.video.frames(), detector, scale.gsd_m)) as looked:
                for frame, boxes in looked:
                    yield frame.index, frame.t_us, frame.image, boxes
        elif self.video is not None and images:
            for frame in self.video.frames():
                yield frame.index, frame.t_us, frame.image, self._recorded_boxes(frame.index)
        else:
            for index, t_us in enumerate(self.times_us.tolist()):
                yield index, t_us, None, self._recorded_boxes(index)

    def _recorded_boxes(self, index: int) -> Detections | None:
        """Detections of a frame; one without any was perhaps never looked at, as a live flight skips frames."""
        boxes = self._boxes.at(index) if self._boxes else None
        return boxes if boxes else None

    def close(self) -> None:
        """Close the video."""
        if self.video is not None:
            self.video.close()


def _telemetry_times(t_us: NDArray[np.int64]) -> NDArray[np.int64]:
    """Moments to show a log at that has no frames: five a second, in pauses for a minute only."""
    t_us = np.unique(t_us)
    step_us = int(1e6 / TELEMETRY_FPS)
    ends = np.flatnonzero(np.diff(t_us, append=t_us[-1] + TELEMETRY_PAUSE_US + 1) > TELEMETRY_PAUSE_US)
    starts = np.concatenate([[0], ends[:-1] + 1])
    last_us = np.minimum(t_us[ends] + TELEMETRY_PAUSE_US, t_us[-1])
    return np.concatenate(
        [np.arange(a, b + 1, step_us, dtype=np.int64) for a, b in zip(t_us[starts], last_us, strict=True)]
    )


def _without_boxes(near: Snapshot, index: int, t_us: int, image: Image | None) -> Snapshot:
    """A frame on which the detector was not run: the fleet as it was then, and no boxes."""
    return replace(near, frame=index, t_us=t_us, image=image, boxes=(), events=())


class _PacketsInOrder:
    """Packets in the order of arrival, handed out up to a time."""

    def __init__(self, packets: Iterator[Packet]) -> None:
        self._packets = packets
        self._next = next(packets, None)

    def until(self, t_us: int) -> Iterator[Packet]:
        while self._next is not None and self._next.t_us <= t_us:
            yield self._next
            self._next = next(self._packets, None)


class _GroundScale:
    """Ground metres a pixel of frames that the fold has not come to yet, from a fold of the telemetry of its own."""

    def __init__(self, mission: Mission, packets: _PacketsInOrder) -> None:
        self._pipeline = Pipeline(mission)
        self._packets = packets

    def gsd_m(self, frame: Frame) -> float | None:
        for packet in self._packets.until(frame.t_us):
            self._pipeline.add_packet(packet)
        return self._pipeline.gsd_m(frame.t_us, frame.image)
