"""A recording folded from start to end: the same snapshots for a screen, a log or a test.

The decoder and the detector are imported when a recording needs them: to load them takes longer than many a fold.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import chain
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gcs.errors import GcsError
from gcs.fold.camera.frame_camera import identifier_params
from gcs.fold.pipeline import Pipeline
from gcs.fold.seen_elsewhere import with_elsewhere
from gcs.playback.in_step import InStep
from gcs.playback.looked_frames import LookedFrame, look_again, recorded_frames
from gcs.playback.moments import moments_between
from gcs.playback.opened_session import OpenedSession
from gcs.playback.recorded_order import GroundScale, PacketsInOrder, RecordedTurns
from gcs.playback.session_warnings import session_warnings
from gcs.session.event_log import read_statements, video_awaited_us
from gcs.session.fold_order import NO_FRAME, FoldTurn
from gcs.session.session import Session
from gcs.snapshot import Event, Health, Snapshot
from mavlink.errors import MavlinkError
from mavlink.protocol.packet import Packet
from vision.detect.detections import Detections
from vision.errors import VisionError
from vision.stream.pace import stall_after_s

if TYPE_CHECKING:
    from assoc.whole_flight.evidence import FlightEvidence
    from gcs.fold.view_exchange import ExchangeMember
    from gcs.mission.mission import Camera, DetectorChoice
    from vision.detect.detector import Detector

Image = NDArray[np.uint8]
Times = NDArray[np.int64]

WARM_UP_US = 20_000_000
"""A fold that begins in the middle takes in this much telemetry before: what is sent every few seconds has come."""
LOOKED_US = 4_000_000
"""Time before it whose frames it looks at: most vehicles are named after two or three seconds."""


class Analysis:
    """One session, opened, and the fold over it.

    Attributes:
        opened: the session's parts.
        mission: who flew.
        video: None where there is none.
        times_us: (n,) when each frame was taken, Unix µs; of telemetry alone: moments to show it at.
        awaited_us: from when on the flight waited for a video, infinite where it does not say so.
        warnings: what an analyst should know before names are trusted, one line each.
        faults: packets that could not be worked on.
    """

    def __init__(
        self,
        session: Session,
        *,
        redetect: bool = False,
        open_detector: Callable[[DetectorChoice], Detector] | None = None,
        looking_threads: int = 2,
        video_offset_s: float | None = None,
        camera: Camera | None = None,
        in_step: InStep | None = None,
        followed: bool = False,
    ) -> None:
        """Open all files of a session.

        Args:
            session: What to fold.
            redetect: Look at the video again even when the session has detections.
            open_detector: loads the mission's networks, for those who keep them; None: they are loaded again.
            looking_threads: which look at the next frames meanwhile; 0: the one that folds looks, too.
            video_offset_s: Video time minus telemetry time, s, instead of the mission's; None: as it says.
            camera: Instead of the mission's; None: as it says.
            in_step: The flight's cameras that are folded in step, which this one joins; None: the others are opened
                and folded for this one's sake.
            followed: It is such another one.

        Raises:
            SessionError, TlogError, VideoError, ModelError: a part that cannot be used.
            CameraError: the mission's camera cannot have taken the video.
        """
        self._open_detector, self._looking_threads = open_detector, looking_threads
        self.faults = 0
        self.opened = opened = OpenedSession.open(session, redetect=redetect)
        self.mission, self.video, self.times_us = opened.mission, opened.video, opened.times_us
        if video_offset_s is not None:
            self.mission = replace(self.mission, clock=replace(self.mission.clock, video_offset_s=video_offset_s))
        if camera is not None:
            self.mission = replace(self.mission, camera=camera)
        self._folded: Pipeline | None = None
        self._evidence: FlightEvidence | None = None
        self._log, self._looks, self._turns = opened.log, opened.looks, opened.turns
        self._frames_order_us = np.maximum.accumulate(self.times_us)
        self._stall_s = stall_after_s(self._frames_order_us)
        self.awaited_us = video_awaited_us(session.folder)
        self.warnings = tuple(session_warnings(opened))
        self._in_step = in_step or InStep(self._warn)
        if trouble := self._in_step.join(self, followed=followed):
            self.warnings += (trouble,)
        if in_step is None:
            self._open_others(redetect=redetect)

    def _warn(self, t_us: int, text: str) -> None:
        """Report in the next snapshot what was found to be wrong with the recording."""
        if self._folded:
            self._folded.add_event(Event(t_us=t_us, level="warning", kind="recording", text=text))

    def _open_others(self, *, redetect: bool) -> None:
        """Open what the flight's other cameras recorded; one that cannot be used is left out, with a warning."""
        shared: Any = {"open_detector": self._open_detector, "looking_threads": self._looking_threads}
        for folder in self.opened.session.other_folders:
            try:
                view = self.opened.session.opened_beside(folder)
                if view.video or view.frames:
                    again = redetect and view.video is not None
                    Analysis(view, **shared, redetect=again, in_step=self._in_step, followed=True)
            except (GcsError, MavlinkError, VisionError) as error:
                self.warnings += (f"what another camera of the flight saw does not count here: {error}",)

    @property
    def uav_id(self) -> int:
        """System id of the aircraft that carries the camera."""
        return self.mission.uav.system_id

    @property
    def uav_name(self) -> str:
        """Name of that aircraft."""
        return self.mission.name_of(self.uav_id)

    @property
    def as_flown(self) -> bool:
        """True if the recording kept the order in which a flight folded it."""
        return self._turns is not None

    def detector(self) -> Detector | None:
        """The mission's detector when frames have to be looked at."""
        if self.video is None or self._looks is not None:
            return None
        if self._open_detector is not None:
            return self._open_detector(self.mission.detector)
        from gcs.fold.detector_factory import open_mission_detector

        return open_mission_detector(self.mission.detector)

    def snapshots(self, *, images: bool = True) -> Iterator[Snapshot]:
        """Fold the whole recording: one snapshot for each frame.

        A flight is folded as it was flown, where it kept the order; else telemetry and frames go by their times.

        Args:
            images: Put each frame's image into its snapshot; frames of a video that cannot be decoded are left out.
        """
        pipeline = self._pipeline(self._in_step.begin(self.uav_id))
        if self._turns is None:
            yield from self._by_time(pipeline, images)
            return
        for snapshot in self._by_turns(pipeline, self._turns, images):
            if snapshot.image is not None or not images or self.video is None:
                yield snapshot  # a video has no frames without an image

    @property
    def found_camera(self) -> Camera | None:
        """The camera by the film as far as it was folded, where the mission does not describe it; None: not found."""
        return self._folded.found_camera if self._folded else None

    @property
    def frames(self) -> int:
        """Number of frames that came, looked at or not; 0 of telemetry alone."""
        return 0 if self.opened.frames_us is None else len(self.times_us)

    def moments(
        self, flown: Sequence[Event] = (), provisional_from_us: int | None = None
    ) -> Iterator[tuple[int, Snapshot]]:
        """Fold the recording for a screen: its frames, without images, and moments in between at which none came.

        Args:
            flown: What the flight reported, in order of time: the recording lasts at least this long, and alarms that
                were acknowledged then are.
            provisional_from_us: Begin some seconds before this time, with provisional names and no alarms. None:
                from the start.

        Returns:
            An iterator over times on the recording's time line, Unix µs, and what is known then.
        """
        if provisional_from_us is not None:
            return self._provisional(flown, provisional_from_us)
        return self._in_step.shown(self.uav_id, self.folded(self._in_step.begin(self.uav_id), flown))

    def seen_elsewhere(self, snapshot: Snapshot) -> Snapshot:
        """The newest snapshot with what the flight's other cameras see, which are folded for this one's sake."""
        others = self._in_step.followed()
        return with_elsewhere(snapshot, others) if others else snapshot

    def folded(self, exchange: ExchangeMember | None, flown: Sequence[Event] = ()) -> Iterator[tuple[int, Snapshot]]:
        """Moments from the start.

        Args:
            exchange: With the folds of the flight's other cameras.
            flown: As of :meth:`moments`.
        """
        seen = deque(event for event in flown if event.acknowledges)
        received_us = self._received_us(flown)
        pipeline, start_us = self._pipeline(exchange), int(received_us[0])
        for at_us, snapshot in self._moments(pipeline, received_us, start_us, None):
            yield at_us, snapshot
            while seen and seen[0].t_us <= at_us:
                pipeline.add_event(seen.popleft())

    def _provisional(self, flown: Sequence[Event], from_us: int) -> Iterator[tuple[int, Snapshot]]:
        """Moments from some seconds before a time on, by this camera alone."""
        looks_us = from_us - LOOKED_US
        pipeline, received_us = self._pipeline(None), self._received_us(flown)
        for at_us, snapshot in self._moments(pipeline, received_us, from_us - WARM_UP_US, looks_us):
            if at_us > looks_us:
                yield at_us, replace(snapshot, provisional=True, alarms=(), events=())

    def _received_us(self, flown: Sequence[Event]) -> Times:
        """(m,) when anything is known of the recording, in order."""
        flown_us = np.array([event.t_us for event in flown], dtype=np.int64)
        return np.sort(np.concatenate([self.opened.known_us, flown_us]))

    def with_images(self, moments: Iterator[tuple[int, Snapshot]]) -> Iterator[tuple[int, Snapshot]]:
        """Return the same moments, those at which a frame came with its image, where there is one that can be
        decoded."""
        frames = self.video.frames() if self.video is not None else iter(())
        frame, shown = next(frames, None), -1
        for at_us, snapshot in moments:
            while frame is not None and frame.index < snapshot.frame:
                frame = next(frames, None)
            if frame is not None and shown < frame.index == snapshot.frame:
                shown = frame.index
                yield at_us, replace(snapshot, image=frame.image)
            else:
                yield at_us, snapshot

    def keep_evidence(self) -> FlightEvidence:
        """Keep, from the next fold on, what names rest on: for a look at the whole flight."""
        from assoc.whole_flight.evidence import FlightEvidence

        self._evidence = FlightEvidence(identifier_params(self.mission))
        return self._evidence

    def _pipeline(self, exchange: ExchangeMember | None) -> Pipeline:
        senders, session, mission = self._log.senders, self.opened.session, self.mission
        if session.began is not None:
            mission = replace(mission, uav=session.began.uav, ugv=session.began.ugv)
        pipeline = Pipeline(mission, links=senders.names, address=senders.address, sized=self.opened.size.known)
        self._folded, pipeline.naming.exchange, pipeline.naming.evidence = pipeline, exchange, self._evidence
        if self._evidence is not None:
            self._evidence.begin_anew(mission.ugv_ids)
        for statement in read_statements(session.folder, self.mission.ugv_ids):
            pipeline.state_name(statement)
        for change in session.changes:
            pipeline.change_fleet(change)
        for text in self.warnings:
            pipeline.add_event(Event(t_us=int(self.times_us[0]), level="warning", kind="recording", text=text))
        return pipeline

    def _moments(
        self, pipeline: Pipeline, received_us: Times, hears_us: int, looks_us: int | None
    ) -> Iterator[tuple[int, Snapshot]]:
        """Moments with the telemetry from one time on and the frames from another, None: with all frames."""
        shift_us, at_us = 0, (hears_us if looks_us is None else looks_us) - 1
        if self._turns is not None:
            for at_us, turn, taken, boxes in self._turns.placed_turns(self.times_us):
                for packet in taken:
                    if at_us >= hears_us:
                        self._add_packet(pipeline, packet)
                if looks_us is None or at_us >= looks_us:
                    yield at_us, self._fold_turn(pipeline, turn, boxes, self.health_at(at_us, turn.frame))
                shift_us = turn.t_us - at_us
            packets = PacketsInOrder(self._turns.packets_after())
            frames: Iterator[LookedFrame] = iter(())
        else:
            packets = PacketsInOrder(self._log.packets())
            deque(packets.until(hears_us - 1), maxlen=0)
            frames = self._looked_frames(images=False, from_us=looks_us)
        for frame in frames:
            t_us = frame.t_us
            yield from self._moments_without_frame(pipeline, packets, moments_between(at_us, t_us, received_us))
            yield t_us, self._fold_frame(pipeline, packets, frame, None, self.health_at(t_us, frame.index))
            at_us = max(at_us, t_us)
        stop_us = int(received_us[-1])
        times_us = chain(moments_between(at_us, stop_us, received_us), [stop_us] * (at_us < stop_us))
        yield from self._moments_without_frame(pipeline, packets, times_us, shift_us)

    def _moments_without_frame(
        self, pipeline: Pipeline, packets: PacketsInOrder, times_us: Iterator[int], shift_us: int = 0
    ) -> Iterator[tuple[int, Snapshot]]:
        """Moments on the recording's time line; shift_us: what the clock of the packets' stamps is ahead of it."""
        for t_us in times_us:
            for packet in packets.until(t_us + shift_us):
                self._add_packet(pipeline, packet)
            yield t_us, pipeline.between_frames(t_us + shift_us, self.health_at(t_us, NO_FRAME))

    def _by_time(self, pipeline: Pipeline, images: bool) -> Iterator[Snapshot]:
        packets = PacketsInOrder(self._log.packets())
        for frame in self._looked_frames(images):
            shown = frame.image if images else None
            yield self._fold_frame(pipeline, packets, frame, shown, self._health(frame.index))

    def _fold_frame(
        self, pipeline: Pipeline, packets: PacketsInOrder, frame: LookedFrame, image: Image | None, health: Health
    ) -> Snapshot:
        for packet in packets.awaited(pipeline, frame.t_us):
            self._add_packet(pipeline, packet)
        pipeline.add_news(frame.t_us, frame.news)
        return pipeline.add_frame(
            frame.index,
            frame.t_us,
            image=image,
            size=self.opened.size.size,
            detections=frame.boxes,
            motion=frame.motion,
            health=health,
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
            without = turn.frame == NO_FRAME
            health = self._health((latest.frame if latest else 0) if without else turn.frame)
            now = self._fold_turn(pipeline, turn, boxes, health)
            if without:
                early += () if latest else now.events
                latest = replace(latest, events=latest.events + now.events) if latest else None
                continue
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

    def _fold_turn(self, pipeline: Pipeline, turn: FoldTurn, boxes: Detections | None, health: Health) -> Snapshot:
        return pipeline.add_frame(
            turn.frame,
            turn.t_us,
            size=turn.size,
            detections=boxes,
            motion=self._looks.motion(turn.frame) if self._looks else None,
            health=health,
            heard_us=turn.heard_us,
        )

    def _frames_in_order(self, images: bool) -> Iterator[tuple[int, int, Image | None]]:
        """Index, time and, where asked for, image of every frame."""
        frames = self.video.frames() if self.video is not None and images else iter(())
        frame = next(frames, None)
        for index, t_us in enumerate(self.times_us.tolist()):
            while frame is not None and frame.index < index:
                frame = next(frames, None)
            yield index, t_us, frame.image if frame is not None and frame.index == index else None

    def _add_packet(self, pipeline: Pipeline, packet: Packet) -> None:
        """Add a packet; as in a flight, one that cannot be worked on costs nothing else; the first is an event."""
        try:
            pipeline.add_packet(packet)
        except Exception as error:  # noqa: BLE001 - an event, below
            if not self.faults:
                text = f"a fault of this program was passed over: packet of system {packet.system_id}: {error!r}"
                pipeline.add_event(Event(t_us=packet.t_us, level="alarm", kind="recording", text=text))
            self.faults += 1

    def _health(self, index: int) -> Health:
        return Health(frames=index + 1, video="ok" if self.video else "none")

    def health_at(self, t_us: int, index: int) -> Health:
        """Health as far as it is recorded: whether frames came at a time; behind its last a film has ended.

        Before its first frame a film may just begin later: it was waited for only where the flight says so.
        """
        health = self._health(index)
        if self.opened.frames_us is None:
            return health
        if not (before := int(np.searchsorted(self._frames_order_us, t_us, side="right"))):
            return replace(health, video="waiting" if self.video and self.awaited_us <= t_us else "none")
        if t_us - int(self._frames_order_us[before - 1]) <= self._stall_s * 1e6:
            return health
        ended = before == len(self.times_us) and not self.as_flown
        return replace(health, video="ended" if ended else "stalled")

    def _looked_frames(self, images: bool, from_us: int | None = None) -> Iterator[LookedFrame]:
        """Every frame, or those from a time on, with what was seen in it; the images only where asked for."""
        first = 0 if from_us is None else int(np.searchsorted(self._frames_order_us, from_us))
        detector = self.detector()
        if detector is not None and self.video is not None:
            packets = PacketsInOrder(self._log.packets())
            deque(packets.until(0 if from_us is None else from_us - WARM_UP_US), maxlen=0)
            scale = GroundScale(self.mission, packets)
            least, threads = self.mission.detector.score, self._looking_threads
            return look_again(self.video, detector, scale.gsd_m, least, first, threads=threads)
        return recorded_frames(self._looks, self.times_us, first, self.video if images else None)

    def close(self) -> None:
        """Close the video."""
        self.opened.close()
        self._in_step.close()


def _without_boxes(near: Snapshot, index: int, t_us: int, image: Image | None) -> Snapshot:
    """A frame on which the detector was not run: the fleet as it was then, and no boxes."""
    return replace(near, frame=index, t_us=t_us, image=image, boxes=(), events=())
