"""One camera of a flight: its video, its fold and its files."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

from gcs.flight.frame_loop import FrameLoop
from gcs.flight.video import FlightVideo
from gcs.fold.pipeline import Pipeline
from gcs.health.faults import Faults
from gcs.mission.mission import Mission
from gcs.session.recorder import ViewRecorder
from gcs.snapshot import OF_A_CAMERA, Alarm, Event, Snapshot
from mavlink.ingest.ingest import Ingest
from vision.detect.detector import Detector
from vision.video.video import Frame


class FlightView:
    """One camera of a flight.

    Args:
        mission: as this camera has it.
        video: its source, as of :class:`gcs.flight.video.FlightVideo`.
        recorder: keeps what it sees.
        detector: looks at its frames, and at those of other cameras; one thread does.
        ingest: how telemetry comes in.
        faults: records what fails on the way.
        on_snapshot: called with each snapshot.
    """

    def __init__(
        self,
        mission: Mission,
        video: str,
        recorder: ViewRecorder,
        detector: Detector | None,
        ingest: Ingest,
        faults: Faults,
        on_snapshot: Callable[[FlightView, Snapshot], None],
    ) -> None:
        self.recorder = recorder
        self.video = FlightVideo(video, recorder)
        self.pipeline = Pipeline(mission, links=ingest.names, address=ingest.address)
        self.loop = FrameLoop(self.pipeline, detector, recorder, faults, lambda snapshot: on_snapshot(self, snapshot))
        self.turned_s = -math.inf
        """Time of its last turn of the fold, s of the monotonic clock."""
        self._taken = 0

    @property
    def uav_id(self) -> int:
        """System id of the aircraft that carries it."""
        return self.pipeline.mission.uav.system_id

    @property
    def name(self) -> str:
        """Name of that aircraft."""
        return self.pipeline.mission.name_of(self.uav_id)

    @property
    def frames(self) -> int:
        """Frames received and recorded, whether they were looked at or not."""
        return self.video.stream.received if self.video.stream else 0

    def newest(self) -> Frame | None:
        """The newest frame, None where none came since the last; its process is not asked for nothing."""
        received = self.frames
        frame = self.video.latest(0.0) if received != self._taken else None
        self._taken = received if frame else self._taken
        return frame

    def label_event(self, event: Event, *, further: bool) -> Event:
        """Put the camera's name before an event, for a log that has those of all cameras.

        Args:
            further: it is not the first camera, whose fold has what the operator did to the fleet, too.
        """
        named = event.kind in OF_A_CAMERA or (further and event.is_about_a_box)
        return replace(event, text=f"{self.name}: {event.text}") if named else event

    def label_alarm(self, alarm: Alarm) -> Alarm:
        """Put the camera's name before an alarm, and the aircraft's id, by which it differs from others', into it."""
        if alarm.kind not in OF_A_CAMERA:
            return alarm
        return replace(alarm, text=f"{self.name}: {alarm.text}", system_id=alarm.system_id or self.uav_id)

    def own(self, alarm: Alarm) -> Alarm | None:
        """The alarm before :meth:`label_alarm`; None of one that is of another camera."""
        if alarm.kind not in OF_A_CAMERA:
            return alarm
        text = alarm.text.removeprefix(f"{self.name}: ")
        if alarm.system_id in (0, *self.pipeline.mission.ugv_ids):  # a vehicle's name is of all cameras
            return replace(alarm, text=text)
        return replace(alarm, text=text, system_id=0) if alarm.system_id == self.uav_id else None
