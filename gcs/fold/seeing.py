"""First stage of the fold: where the camera is, and the tracks of the boxes that the detector found."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gcs.fold.camera.frame_camera import FrameCamera, ground_warp, reported_pixels
from gcs.fold.camera.frame_cameras import FrameCameras
from gcs.fold.ground.contact import pixels_on_ground
from gcs.fold.naming import NamingStage
from gcs.fold.turn import Look, Turn
from gcs.mission.mission import Mission
from gcs.snapshot import Event
from mavlink.fleet.fleet import Fleet
from vision.detect.detections import Detections
from vision.motion.image_motion import ImageMotion
from vision.track.parts import JoinedBoxes, PartJoiner
from vision.track.tracker import Tracker
from vision.track.tracks import TrackerParams

MAX_BOXES = 300
"""Most boxes of a frame: more vehicles than there are system ids, and at most 0.2 s of work."""


class SeeingStage:
    """Follows the camera, and the vehicles in its picture.

    Args:
        mission: who flies with which camera.
        fleet: asked for the UAV's attitude at other times.
        naming: the second stage: tracks go on where it knows their vehicles to be.
        sized: whether frames of unknown size are of the size that the camera is described for.
    """

    def __init__(self, mission: Mission, fleet: Fleet, naming: NamingStage, *, sized: bool) -> None:
        self.cameras = FrameCameras(mission, sized=sized)
        self._fleet, self._naming = fleet, naming
        self._crowded, self._score = False, mission.detector.score
        self._parts = PartJoiner()
        self._tracker: Tracker | None = None
        self._looked_us: dict[int, int] = {}
        """Time of the last look at where a vehicle reports to be, while not all of the picture is looked at."""

    def best_boxes(self, t_us: int, detections: Detections) -> tuple[Detections, list[Event]]:
        """Boxes of a frame that count, the best 300, and an event when there are more for the first time."""
        if len(detections) <= MAX_BOXES:
            return detections, []
        events, boxes = list[Event](), len(detections.at_least(self._score))
        if boxes > MAX_BOXES and not self._crowded:
            text = f"{boxes} boxes in a frame, only the {MAX_BOXES} best count: the detector sees what is not there"
            events, self._crowded = [Event(t_us=t_us, level="warning", kind="video", text=text)], True
        return detections.select(np.sort(np.argsort(-detections.score, kind="stable")[:MAX_BOXES])), events

    def look(
        self, turn: Turn, detections: Detections, motion: ImageMotion | None, before: FrameCamera | None
    ) -> tuple[Look, list[Event]]:
        """Take in the boxes of a frame.

        Args:
            turn: The frame, with the camera as the UAV reports it.
            detections: Boxes found, weak ones too.
            motion: How the camera moved since the last look, by the pixels; None: not known.
            before: The camera of the last look, None unknown.

        Returns:
            What was seen, nobody named; and what an operator should know of the camera.
        """
        t_us, state, view = turn.t_us, turn.state, turn.view
        if view is not None:
            moved = motion if before else None
            view = self.cameras.zoomed(t_us, view, detections.at_least(self._score))
            view = self.cameras.predicted(state, view, self._fleet, moved, yaw_error=self._naming.yaw_error)
        joined = self._join_parts(t_us, detections, view)
        if self._tracker is None:
            self._tracker = Tracker(TrackerParams(new_score=self._score, frame_size=self.cameras.size))
        expected = self._naming.expected_px(state, view) or {}
        tracks = self._tracker.update(
            joined.boxes,
            t_us,
            warp=ground_warp(before, view) if motion is None else motion.H,
            stitch=self._naming.stitch(state.t_us, view),
            known=self._naming.followed(state),
            focal_px=view.intrinsics.fx if view else None,
            reported_px=np.array(list(expected.values())).reshape(-1, 2),
        )
        begins_anew, events = self.cameras.find(state, joined.boxes, tracks, view)
        view = None if begins_anew or view is None else self.cameras.seen(state.t_us, view, joined.boxes, tracks)
        return Look(
            t_us=t_us,
            detections=detections,
            joined=joined,
            tracks=tracks,
            living=self._tracker.living,
            size=self.cameras.size,
            view=view,
            uv=reported_pixels(state, view),
            unlooked_s=self._unlooked_s(t_us, expected, detections),
            begins_anew=begins_anew,
        ), list(events)

    def _join_parts(self, t_us: int, detections: Detections, view: FrameCamera | None) -> JoinedBoxes:
        """The boxes of a frame, one for each vehicle where it has two."""
        if view is None:
            pixel_m: NDArray[np.float64] = np.tile(np.eye(2), (len(detections), 1, 1))
        else:
            pixel_m = pixels_on_ground(view.intrinsics.rays(detections.centre), view)
        return self._parts.join(t_us, detections, pixel_m, self._score)

    def _unlooked_s(
        self, t_us: int, expected: dict[int, tuple[float, float]], detections: Detections
    ) -> dict[int, float]:
        """Seconds for which nobody looked where vehicles report to be, by system id."""
        if detections.looked is None:
            return {}
        looked = detections.looked_at(list(expected.values())).tolist()
        self._looked_us |= dict.fromkeys((i for i, seen in zip(expected, looked, strict=True) if seen), t_us)
        return {i: (t_us - self._looked_us.get(i, 0)) * 1e-6 for i in expected}
