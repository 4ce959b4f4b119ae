"""The fold: packets and frames in time order go in, one snapshot a frame comes out.

The only place where telemetry, vision and association meet. A live flight, a replay and a test run this same code.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from assoc.geometry.ground import YAW
from assoc.identification.identifier import Identifier
from assoc.records import CameraState, Identities
from assoc.whole_flight.evidence import FlightEvidence
from gcs.fold.camera.frame_camera import (
    FrameCamera,
    camera_aim,
    expected_pixels,
    ground_warp,
    identifier_params,
    reported_pixels,
)
from gcs.fold.camera.frame_cameras import FrameCameras
from gcs.fold.candidates import CandidateWords
from gcs.fold.contradictions import Contradictions
from gcs.fold.evidence import camera_of, observation_of, reports_of
from gcs.fold.fences import Fences
from gcs.fold.fleet_changes import FleetChanges
from gcs.fold.ground.contact import pixels_on_ground
from gcs.fold.name_changes import NameChanges
from gcs.fold.notice_events import NoticeEvents
from gcs.fold.quarantine import limit_doubted, withhold_names
from gcs.fold.since import Since
from gcs.fold.snapshot_rows import boxes_of, vehicle_rows, with_camera_errors, with_standings
from gcs.fold.statements import Statements
from gcs.fold.view_exchange import ExchangeMember
from gcs.health.alarms import Alarms
from gcs.health.event_throttle import EventThrottle
from gcs.health.link_rates import LinkRates
from gcs.mission.mission import Camera, Mission
from gcs.session.fold_order import NO_FRAME
from gcs.snapshot import Box, Event, FleetChange, Health, Snapshot, Standing, Statement, doubted_by
from mavlink.estimation.gimbal import turns_camera
from mavlink.fleet.fleet import Fleet
from mavlink.geodesy import LocalFrame
from mavlink.protocol.packet import Auth, Packet
from mavlink.state import FleetState
from vision.camera.camera import footprint, ground_sampling
from vision.detect.detections import Detections
from vision.motion.image_motion import ImageMotion
from vision.track.parts import JoinedBoxes, PartJoiner
from vision.track.tracker import Tracker
from vision.track.tracks import Stitch, TrackerParams, Tracks

IntArray = NDArray[np.int64]
FloatArray = NDArray[np.float64]
MAX_BOXES = 300
"""Most boxes of a frame: more vehicles than there are system ids, and at most 0.2 s of work."""
HELD_US = 2_000_000
"""Time for which names are shown after their frame: at 5 m/s a vehicle is 10 m on, perhaps where its neighbour was."""
WAIT_US, MAX_WAIT_US = 150_000, 1_000_000
"""Time that a frame waits for the attitude after its own time, and the most over a slow radio: names that come as much
later are better than names by a pose that is extrapolated."""
REPORT_INTERVAL_US = 100_000
"""Usual time from one report of the UAV's position to the next."""
CLOCK_SET_US = 10_000_000
"""Greatest delay of a frame; one that is earlier still was dated by a clock that had been set back."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Look:
    """Result of the last frame that the detector looked at."""

    t_us: int
    detections: Detections
    """Boxes of the frame as the detector drew them: a vehicle in two parts has two."""
    joined: JoinedBoxes
    """Boxes with one for each vehicle."""
    tracks: Tracks
    found: Identities | None
    """None without a camera pose, and once names have started again."""
    view: FrameCamera | None
    uv: dict[int, FloatArray]
    """Pixel (2,) of each vehicle's reported place then, by system id."""


class Pipeline:
    """Folds one mission's packets and frames; owns the fleet, the tracker and the identifier.

    Args:
        mission: who flies.
        links: names of the links by index.
        address: of a link's index and a sender's number, in words; empty where it is not known.
        sized: whether frames of unknown size are of the size that the camera is described for.

    Attributes:
        exchange: with the folds of the flight's other cameras; None: it is by itself.
        evidence: keeps what names rest on, for those who look at the whole flight later; None: nobody does.
    """

    exchange: ExchangeMember | None = None
    evidence: FlightEvidence | None = None

    def __init__(
        self,
        mission: Mission,
        links: Sequence[str] = (),
        address: Callable[[int, int], str] = lambda link, peer: "",
        *,
        sized: bool = True,
    ) -> None:
        self.mission = mission
        camera_id, gimbal_id = (mission.camera.device, mission.camera.gimbal) if mission.camera else (0, 0)
        self.fleet = Fleet(
            mission.uav.system_id,
            mission.ugv_ids,
            camera_id=camera_id,
            gimbal_id=gimbal_id,
            links=links,
            address=address,
            stand=mission.mast.stand if mission.mast else None,
        )
        self._elsewhere = {view.system_id for view in mission.view}
        self._films = sorted((mission.uav.system_id, *self._elsewhere))
        self._crowded, self._score = False, mission.detector.score
        self._tracker: Tracker | None = None
        self._looked_us: dict[int, int] = {}
        """Time of the last look at where a vehicle reports to be, while not all of the picture is looked at."""
        self._parts = PartJoiner()
        self._params = identifier_params(mission)
        if auto := mission.clock.video_offset_s == "auto":
            self._params = replace(self._params, time_offset_std_s=self._params.unknown_offset_std_s)
        self._identifier = Identifier(mission.ugv_ids, self._params)
        self._origin: LocalFrame | None = None
        self._offset_s = 0.0 if auto else float(mission.clock.video_offset_s)
        self._offset_us = round(self._offset_s * 1e6)
        self._cameras = FrameCameras(mission, sized=sized)
        self._view: FrameCamera | None = None
        self._state_of: tuple[FrameCamera, CameraState] | None = None
        """The camera that was last asked about, as the identifier has it."""
        self._look: _Look | None = None
        self._frame, self._frame_us, self._clock_us = NO_FRAME, 0, 0
        self._names = NameChanges(mission)
        self._contradictions = Contradictions()
        self._statements = Statements(mission)
        self._candidates = CandidateWords(mission.identity.threshold)
        self._named_since: Since[int, int] = Since()
        self._standing_since: Since[int, Standing] = Since()
        self._fences = Fences(mission)
        self._changes = FleetChanges()
        self._events: list[Event] = []
        self._notices = NoticeEvents(mission)
        self._throttle = EventThrottle()
        self._link_rates = LinkRates()
        self._alarms = Alarms()

    def add_packet(self, packet: Packet) -> None:
        """Take in one telemetry packet; those of aircraft with other views are for the folds of these."""
        if packet.system_id in self._elsewhere:
            return
        if turns_camera(packet) and packet.system_id == self.mission.uav.system_id and packet.auth <= Auth.GOOD:
            self._cameras.order_given(packet.t_us)
        if notices := self.fleet.add_packet(packet):
            events = [self._notices.event(notice, packet) for notice in notices]
            for event in events:
                self._alarms.texts.add(event)
            self._events += self._throttle.admit(events)

    def awaits_telemetry(self, t_us: int, heard_us: int, *, most_us: int = MAX_WAIT_US) -> bool:
        """Tell whether a frame should be kept back since reports of the UAV's pose after it are still to come.

        Args:
            t_us: when the frame was taken, Unix µs on the video's clock.
            heard_us: whatever came before this Unix time was added.
            most_us: wait no longer, µs.
        """
        return heard_us < self.awaits_until(t_us, most_us) and self.fleet.awaits(self._attitude_time(t_us))

    def awaits_until(self, t_us: int, most_us: int) -> int:
        """Unix µs from which a frame waits no longer for reports of the UAV's pose.

        Args:
            t_us: when the frame was taken, Unix µs on the video's clock.
            most_us: wait no longer, µs.
        """
        return max(t_us, self._attitude_time(t_us)) + most_us

    def _attitude_time(self, t_us: int) -> int:
        """Telemetry's time, Unix µs, of the attitude that a frame was taken with."""
        return self.telemetry_time(t_us) + self._cameras.attitude_lag_us

    @property
    def wait_us(self) -> int:
        """Time that a flight's frame waits for the UAV's pose after its own time, µs: longer where radio is late."""
        return min(max(round(self.fleet.uav_delay_us) + REPORT_INTERVAL_US, WAIT_US), MAX_WAIT_US)

    @property
    def found_camera(self) -> Camera | None:
        """The camera by the film, where the mission does not describe it; None: not found, or not searched for."""
        return self._cameras.found

    def add_event(self, event: Event) -> None:
        """Add an event of the surroundings (links, video, operator) to the next snapshot."""
        self._alarms.texts.acknowledge(event.acknowledges)
        self._events.append(event)

    def add_news(self, t_us: int, text: str) -> None:
        """Add what was found out about the video, one line, empty for nothing."""
        if text:
            self.add_event(Event(t_us=t_us, level="info", kind="video", text=text))

    def state_name(self, statement: Statement) -> None:
        """Take what the operator states about a box; it counts from the next frame that is looked at.

        Raises:
            ValueError: the mission has no such ground vehicle.
        """
        self._statements.make(statement)

    def change_fleet(self, change: FleetChange) -> None:
        """Take what the operator changes about who is named; it counts from the next turn on."""
        self._changes.make(change)

    def follow_ground(self, t_us: int) -> None:
        """Take in how high the ground is at a frame that is measured and not folded."""
        self._cameras.follow_ground(self.fleet.at(self.telemetry_time(t_us)), self.fleet.origin)

    def gsd_m(self, t_us: int, image: NDArray[np.uint8]) -> float | None:
        """Ground metres a pixel in the middle of a frame (H, W, 3), None while the camera's pose or height is open."""
        view = self._frame_camera(self.fleet.at(self.telemetry_time(t_us)), _size_of(image))
        if view is None or view.ground.is_doubtful_below(float(view.pose.p_enu[2])):
            return None
        return ground_sampling(view.intrinsics, view.pose, view.ground_z)

    def reported_px(self, t_us: int, image: NDArray[np.uint8]) -> dict[int, tuple[float, float, float]]:
        """Places in a frame (H, W, 3) that the vehicles report, by system id: x, y and the 1σ of both, px."""
        state = self.fleet.at(self.telemetry_time(t_us))
        view = self._frame_camera(state, _size_of(image))
        if view is None:
            return {}
        std_m = np.hypot(view.place_std_m(state.p_enu), np.nan_to_num(state.std_m))
        away_m = np.linalg.norm(state.p_enu - view.pose.p_enu, axis=1)
        std_px = dict(zip(state.system_id.tolist(), (std_m / away_m * view.intrinsics.fx).tolist(), strict=True))
        expected = self._expected_px(state, view) or {}
        return {i: (*uv, std_px[i]) for i, uv in expected.items() if np.isfinite((*uv, std_px[i])).all()}

    def expected_pixels(self, t_us: int) -> tuple[tuple[int, int], FloatArray] | None:
        """Places in the frame where the vehicles' reports put them, at a time of the video's clock.

        Returns:
            Width and height of that frame, pixels (k, 2) of those that can be placed; None: the pose is unknown.
        """
        state = self.fleet.at(self.telemetry_time(t_us))
        view = self._frame_camera(state, None)
        if view is None:
            return None
        places = np.array(list(reported_pixels(state, view).values())).reshape(-1, 2)
        return (view.intrinsics.width, view.intrinsics.height), places

    def add_frame(
        self,
        index: int,
        t_us: int,
        *,
        image: NDArray[np.uint8] | None = None,
        size: tuple[int, int] | None = None,
        detections: Detections | None = None,
        motion: ImageMotion | None = None,
        health: Health | None = None,
        heard_us: int = 0,
    ) -> Snapshot:
        """Take in one frame and the boxes found in it: track, identify.

        Boxes are held for ``HELD_US`` over frames that were not looked at, and where there is no frame.

        Args:
            index: Place in the video, or ``NO_FRAME``: a moment at which no new one has come.
            t_us: When it was taken, Unix µs on the video's clock.
            image: (H, W, 3) BGR, only passed on.
            size: Width and height, px, of a frame that is not there; None: as the last one.
            detections: Boxes found, weak ones too; None: the detector did not run, and tracks are left as they are.
            motion: How the camera moved since the last frame that was looked at, by the pixels; None: not known.
            health: How the program is doing, passed on.
            heard_us: All telemetry that came before this Unix time was added: ages are as of then where that is
                earlier, so that a fold that is late makes no vehicle silent. 0: whatever came before the frame.
        """
        if detections is not None and len(detections) > MAX_BOXES:
            self._report_crowd(t_us, len(detections.at_least(self._score)))
            detections = detections.select(np.sort(np.argsort(-detections.score, kind="stable")[:MAX_BOXES]))
        self._follow_changes(t_us, index)
        state = self.fleet.at(self.telemetry_time(t_us), heard_us)
        self._notices.follow(state)
        self._follow_origin()
        self._follow_steps(state)
        self._events += self._cameras.follow_ground(state, self.fleet.origin)
        if self._cameras.ground_step_m:
            self._identifier.raise_ground(self._cameras.ground_step_m)
            self._begin_evidence()
        view = self._frame_camera(state, size if image is None else _size_of(image))
        reports = reports_of(self.fleet.take_reports(), self.mission.ugv_ids, view, state)
        self._identifier.add_reports(reports)
        if self.evidence is not None:
            self.evidence.add_reports(reports)
        if detections is None:
            return self._snapshot(index, t_us, state, view, image, self._names_held(state), health)
        if view is not None:
            moved, yaw_error = motion if self._view else None, float(self._identifier.pose_correction[YAW])
            view = self._cameras.zoomed(t_us, view, detections.at_least(self._score))
            view = self._cameras.predicted(state, view, self.fleet, moved, yaw_error=yaw_error)
        warp = ground_warp(self._view, view) if motion is None else motion.H
        joined = self._join_parts(t_us, detections, view)
        if self._tracker is None:
            self._tracker = Tracker(TrackerParams(new_score=self._score, frame_size=self._cameras.size))
        stitch, known, focal_px = self._stitch(t_us, view), self._known(state), view.intrinsics.fx if view else None
        expected = self._expected_px(state, view) or {}
        expected_px = np.array(list(expected.values())).reshape(-1, 2)
        tracks = self._tracker.update(
            *(joined.boxes, t_us), warp=warp, stitch=stitch, known=known, focal_px=focal_px, reported_px=expected_px
        )
        self._events += self._statements.apply(t_us, index, tracks, self._identifier)
        restarts, events = self._cameras.find(state, joined.boxes, tracks, view)
        self._events += events
        if restarts:
            self._forget_evidence()
            view = None
        view = self._cameras.seen(state.t_us, view, joined.boxes, tracks) if view else None
        self._view = view
        self._look = _Look(
            t_us=t_us,
            detections=detections,
            joined=joined,
            tracks=tracks,
            found=self._identify(
                *(index, t_us, joined.boxes, tracks, view), self._unlooked_s(t_us, expected, detections)
            ),
            view=view,
            uv=reported_pixels(state, view),
        )
        seen = set(tracks.track_id[tracks.detection >= 0].tolist())
        stated = set(self._statements.by_track.values())
        self._contradictions.update(t_us, self._look.found, state, seen, stated)
        identities, suspected = self._names_held(state), self._contradictions.suspected
        self._events += self._names.update(t_us, identities, state, tracks, self._cameras.size, suspected)
        self._events += self._statements.review(t_us, identities, state, self._identifier, self._tracker.living)
        return self._snapshot(index, t_us, state, view, image, identities, health)

    def between_frames(self, t_us: int, health: Health | None = None) -> Snapshot:
        """A moment of a recording between two frames: no evidence is taken in, so that names rest on frames alone.

        Args:
            t_us: When, Unix µs on the video's clock.
            health: How the program was doing, passed on.
        """
        self._follow_changes(t_us, NO_FRAME)
        state = self.fleet.at(self.telemetry_time(t_us))
        self._notices.follow(state)
        self._follow_origin()
        view = self._frame_camera(state, None)
        return self._snapshot(NO_FRAME, t_us, state, view, None, self._names_held(state), health)

    def _follow_changes(self, t_us: int, frame: int) -> None:
        """Name the fleet as the operator changed it; who stays is named on by the same frames and reports."""
        frame, before = max(frame, self._frame), self.mission
        self.mission, events = self._changes.next_due(before, t_us, frame, self._clock_us)
        self._events += events
        if self.mission is before:
            return
        for part in (self._names, self._statements, self._notices):
            part.mission = self.mission
        self._fences = Fences(self.mission)
        if self.mission.ugv_ids != before.ugv_ids:
            self.fleet.set_ugvs(self.mission.ugv_ids)
            self._identifier.change_fleet(self.mission.ugv_ids)
            self._begin_evidence()
            self._statements.count_again(self._identifier)
            self._names.evidence_forgotten = True
            if self._look:
                self._look = replace(self._look, found=None)

    def _names_held(self, state: FleetState) -> Identities | None:
        """Names of the last frame that was looked at, without those that the fleet's state forbids now."""
        found = self._look.found if self._look else None
        known = limit_doubted(found, state, self.mission.identity.threshold)
        return withhold_names(known, state, self._contradictions.withheld, self._contradictions.left)

    def _report_crowd(self, t_us: int, boxes: int) -> None:
        if boxes > MAX_BOXES and not self._crowded:
            text = f"{boxes} boxes in a frame, only the {MAX_BOXES} best count: the detector sees what is not there"
            self.add_event(Event(t_us=t_us, level="warning", kind="video", text=text))
            self._crowded = True

    def _follow_origin(self) -> None:
        """Begin the names again when places are given in another frame: all evidence was in the one before."""
        if self._origin is not None and self.fleet.origin is not self._origin:
            self._forget_evidence()
            self._cameras.forget_places()
        self._origin = self.fleet.origin

    def _forget_evidence(self) -> None:
        """Forget all evidence."""
        self._identifier = Identifier(self.mission.ugv_ids, self._params)
        self._begin_evidence()
        self._statements.count_again(self._identifier)
        self._view = None
        self._names.evidence_forgotten = True
        if self._look:
            self._look = replace(self._look, found=None, view=None, uv={})

    def _begin_evidence(self) -> None:
        if self.evidence is not None:
            self.evidence.begin_anew(self.mission.ugv_ids)

    def _follow_steps(self, state: FleetState) -> None:
        """Names begin again after a step of the UAV's position that cannot be taken out."""
        restarts, events = self._cameras.follow_steps(state, sure=self._identifier.locked)
        if restarts:
            self._forget_evidence()
        self._events += events

    def telemetry_time(self, t_us: int) -> int:
        """Telemetry's time, Unix µs, at a time of the video's clock, by the offset that the mission declares."""
        return t_us - self._offset_us

    def _frame_camera(self, state: FleetState, size: tuple[int, int] | None) -> FrameCamera | None:
        """The camera as the UAV reports it, None without a position or a camera."""
        camera, events = self._cameras.at(state, size)
        self._events += events
        return camera

    def _join_parts(self, t_us: int, detections: Detections, view: FrameCamera | None) -> JoinedBoxes:
        """The boxes of a frame, one for each vehicle where it has two."""
        if view is None:
            pixel_m = np.tile(np.eye(2), (len(detections), 1, 1))
        else:
            pixel_m = pixels_on_ground(view.intrinsics.rays(detections.centre), view)
        return self._parts.join(t_us, detections, pixel_m, self._score)

    def _stitch(self, t_us: int, view: FrameCamera | None) -> Stitch | None:
        """Algorithm 1, lines 15-22: a lost track goes on where its vehicle reports to be."""
        if view is None:
            return None
        camera = self._camera(view)

        def stitch(track_id: IntArray, centres: FloatArray) -> IntArray:
            return self._identifier.stitch(self.telemetry_time(t_us), track_id, view.intrinsics.rays(centres), camera)

        return stitch

    def _expected_px(self, state: FleetState, view: FrameCamera | None) -> dict[int, tuple[float, float]] | None:
        """Places where the vehicles' reports put them, by system id; None while the camera's pose is unknown."""
        return expected_pixels(state, view, lambda p, by: self._identifier.expected_rays(p, self._camera(by)))

    def _known(self, state: FleetState) -> list[int]:
        """Tracks that carry a name whose vehicle reports a position."""
        positioned = set(state.system_id[state.valid].tolist())
        return [track for track, vehicle in self._names.by_track.items() if vehicle in positioned]

    def _unlooked_s(
        self, t_us: int, expected: dict[int, tuple[float, float]], detections: Detections
    ) -> dict[int, float]:
        """Seconds for which nobody looked where vehicles report to be, by system id."""
        if detections.looked is None:
            return {}
        looked = detections.looked_at(list(expected.values())).tolist()
        self._looked_us |= dict.fromkeys((i for i, seen in zip(expected, looked, strict=True) if seen), t_us)
        return {i: (t_us - self._looked_us.get(i, 0)) * 1e-6 for i in expected}

    def _identify(
        self,
        index: int,
        t_us: int,
        detections: Detections,
        tracks: Tracks,
        view: FrameCamera | None,
        unlooked_s: Mapping[int, float],
    ) -> Identities | None:
        if view is None:
            return None
        observation = observation_of(self.telemetry_time(t_us), detections, tracks, view.intrinsics, view)
        heard = None
        if self.exchange and self.fleet.origin:
            heard = partial(self.exchange.answers, index, self.fleet.origin, tuple(self.mission.ugv_ids))
        camera = self._camera(view)
        found = self._identifier.update(observation, camera, heard=heard, unlooked_s=unlooked_s)
        if self.evidence is not None and self._identifier.by_course:
            self.evidence.add_frame(t_us, observation, camera, self._identifier.pose_correction)
        if self._identifier.height_error is not None:
            self._cameras.compare_with_film(*self._identifier.height_error)
        return found

    def _number_of(self, track_id: int) -> int:
        """Number of what a track is: no two cameras of the flight give the same one to two objects; of one camera 0."""
        if not self._elsewhere:
            return 0
        camera, track = self.exchange.first_seen(track_id) if self.exchange else (self.mission.uav.system_id, track_id)
        return (track - 1) * len(self._films) + self._films.index(camera) + 1

    def _camera(self, view: FrameCamera) -> CameraState:
        if self._state_of is None or self._state_of[0] is not view:
            self._state_of = view, camera_of(view, self._cameras.stabilized)
        return self._state_of[1]

    def _snapshot(
        self,
        index: int,
        t_us: int,
        state: FleetState,
        view: FrameCamera | None,
        image: NDArray[np.uint8] | None,
        identities: Identities | None,
        health: Health | None,
    ) -> Snapshot:
        if index != NO_FRAME:
            self._frame, self._frame_us = index, t_us
        self._clock_us = max(t_us, self._clock_us) if t_us > self._clock_us - CLOCK_SET_US else t_us
        look, boxes = self._look, tuple[Box, ...]()
        if look is not None and t_us - look.t_us <= HELD_US:
            boxes = boxes_of(
                *(look.detections, look.joined, look.tracks, identities, look.uv, look.view, self.fleet.origin),
                candidates=self._candidates.of(identities, state, self._contradictions.standing),
                named_since=partial(self._named_since.update, t_us),
                stated=self._statements.by_track,
                number_of=self._number_of,
                score=self._score,
            )
        expected_px = self._expected_px(state, view)
        width, height = self._cameras.size or ((view.intrinsics.width, view.intrinsics.height) if view else (0, 0))
        looked_share = look.detections.looked_share((width, height)) if look and width else 1.0
        self._fences.set_origin(self.fleet.origin)
        lapsed = bool(self._frame_us) and t_us - self._frame_us > HELD_US
        suspected = self._contradictions.suspected
        rows = vehicle_rows(self.mission, state, boxes, expected_px, (width, height), suspected=suspected)
        snapshot = Snapshot(
            t_us=t_us,
            frame=self._frame,
            frame_us=self._frame_us,
            seen_us=look.t_us if look else 0,
            clock_us=self._clock_us,
            width=width,
            height=height,
            image=image,
            vehicles=self._fences.compare(rows),
            boxes=boxes,
            footprint_enu=footprint(view.intrinsics, view.pose, view.ground_z) if view else None,
            uav_enu=state.uav.p_enu,
            uav_heading=state.uav.yaw,
            health=with_camera_errors(
                self._link_rates.with_rates(t_us, health or Health()),
                *(self._identifier, self._offset_s),
                looked_share=looked_share,
                guessed=self._cameras.guessed,
                differ=self.exchange.contradictions(self.mission) if self.exchange else "",
            ),
            camera=camera_aim(view, state.uav) if view else None,
            pose="unknown" if view is None else "known" if view.attitude_known else "no attitude",
            conflicts=self._contradictions.standing,
            origin=self.fleet.origin,
            limits=self.mission.limits,
            fence_enu=self._fences.outlines,
        )
        alarms, changes = self._alarms.update(snapshot)
        events = (*self._events, *self._throttle.overdue(t_us), *changes)
        self._events = []
        since = partial(self._standing_since.update, t_us)
        rows = with_standings(snapshot, doubted_by(alarms), since, lapsed=lapsed)
        return replace(snapshot, alarms=alarms, events=events, vehicles=rows)


def _size_of(image: NDArray[np.uint8] | None) -> tuple[int, int] | None:
    """Width and height, px."""
    return None if image is None else (image.shape[1], image.shape[0])
