"""The fold: packets and frames in time order go in, one snapshot a frame comes out.

The only place where telemetry, vision and association meet, in three stages: what is seen (``gcs.fold.seeing``), who
that is (``gcs.fold.naming``) and what is shown of it (``gcs.fold.showing``). A flight, a replay and a test run this
same code.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gcs.fold.camera.frame_camera import FrameCamera, reported_pixels
from gcs.fold.fleet_changes import FleetChanges
from gcs.fold.turn import Look, Turn
from gcs.mission.mission import Camera, Mission
from gcs.session.fold_order import NO_FRAME
from gcs.snapshot import Event, FleetChange, Health, Snapshot, Statement
from mavlink.estimation.gimbal import turns_camera
from mavlink.geodesy import LocalFrame
from mavlink.protocol.packet import Auth, Packet
from mavlink.state import FleetState
from vision.camera.camera import ground_sampling
from vision.detect.detections import Detections
from vision.motion.image_motion import ImageMotion

FloatArray = NDArray[np.float64]
WAIT_US, MAX_WAIT_US = 150_000, 1_000_000
"""Time that a frame waits for the attitude after its own time, and the most over a slow radio: names that come as much
later are better than names by a pose that is extrapolated."""
REPORT_INTERVAL_US = 100_000
"""Usual time from one report of the UAV's position to the next."""


class Pipeline:
    """Folds one mission's packets and frames; owns the fleet and the three stages.

    Args:
        mission: who flies.
        links: names of the links by index.
        address: of a link's index and a sender's number, in words; empty where it is not known.
        sized: whether frames of unknown size are of the size that the camera is described for.

    Attributes:
        mission: the same, as the operator has changed the fleet since.
        fleet: what was heard of the vehicles.
        naming: the second stage, which others may listen to: other cameras, and who looks at the whole flight.
    """

    def __init__(
        self,
        mission: Mission,
        links: Sequence[str] = (),
        address: Callable[[int, int], str] = lambda link, peer: "",
        *,
        sized: bool = True,
    ) -> None:
        # half of what a replay imports, scipy most of it: its screens are there before
        from gcs.fold.naming import NamingStage
        from gcs.fold.seeing import SeeingStage
        from gcs.fold.showing import ShowingStage
        from mavlink.fleet.fleet import Fleet

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
        self.naming = NamingStage(mission)
        self._seeing = SeeingStage(mission, self.fleet, self.naming, sized=sized)
        self._cameras = self._seeing.cameras
        self._showing = ShowingStage(mission, self.naming, self._cameras)
        self._elsewhere = {view.system_id for view in mission.view}
        self._offset_us = round(1e6 * mission.clock.declared_offset_s)
        self._changes = FleetChanges()
        self._origin: LocalFrame | None = None
        self._look: Look | None = None

    def add_packet(self, packet: Packet) -> None:
        """Take in one telemetry packet; those of aircraft with other views are for the folds of these."""
        if packet.system_id in self._elsewhere:
            return
        if turns_camera(packet) and packet.system_id == self.mission.uav.system_id and packet.auth <= Auth.GOOD:
            self._cameras.order_given(packet.t_us)
        if notices := self.fleet.add_packet(packet):
            self._showing.add_notices(notices, packet)

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
        self._showing.add_events([event])

    def add_news(self, t_us: int, text: str) -> None:
        """Add what was found out about the video, one line, empty for nothing."""
        if text:
            self.add_event(Event(t_us=t_us, level="info", kind="video", text=text))

    def state_name(self, statement: Statement) -> None:
        """Take what the operator states about a box; it counts from the next frame that is looked at.

        Raises:
            ValueError: the mission has no such ground vehicle.
        """
        self.naming.statements.make(statement)

    def change_fleet(self, change: FleetChange) -> None:
        """Take what the operator changes about who is named; it counts from the next turn on."""
        self._changes.make(change)

    def follow_ground(self, t_us: int) -> None:
        """Take in how high the ground is at a frame that is measured and not folded."""
        self._cameras.follow_ground(self.fleet.at(self.telemetry_time(t_us)), self.fleet.origin)

    def gsd_m(self, t_us: int, image: NDArray[np.uint8]) -> float | None:
        """Ground metres a pixel in the middle of a frame (H, W, 3), None while the camera's pose or height is open."""
        view = self._camera(self.fleet.at(self.telemetry_time(t_us)), _size_of(image))
        if view is None or view.ground.is_doubtful_below(float(view.pose.p_enu[2])):
            return None
        return ground_sampling(view.intrinsics, view.pose, view.ground_z)

    def reported_px(self, t_us: int, image: NDArray[np.uint8]) -> dict[int, tuple[float, float, float]]:
        """Places in a frame (H, W, 3) that the vehicles report, by system id: x, y and the 1σ of both, px."""
        state = self.fleet.at(self.telemetry_time(t_us))
        view = self._camera(state, _size_of(image))
        if view is None:
            return {}
        std_m = np.hypot(view.place_std_m(state.p_enu), np.nan_to_num(state.std_m))
        away_m = np.linalg.norm(state.p_enu - view.pose.p_enu, axis=1)
        std_px = dict(zip(state.system_id.tolist(), (std_m / away_m * view.intrinsics.fx).tolist(), strict=True))
        expected = self.naming.expected_px(state, view) or {}
        return {i: (*uv, std_px[i]) for i, uv in expected.items() if np.isfinite((*uv, std_px[i])).all()}

    def expected_pixels(self, t_us: int) -> tuple[tuple[int, int], FloatArray] | None:
        """Places in the frame where the vehicles' reports put them, at a time of the video's clock.

        Returns:
            Width and height of that frame, pixels (k, 2) of those that can be placed; None: the pose is unknown.
        """
        state = self.fleet.at(self.telemetry_time(t_us))
        view = self._camera(state, None)
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
        """Take in one frame and the boxes found in it: see, name, show.

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
        if detections is not None:
            detections, events = self._seeing.best_boxes(t_us, detections)
            self._showing.add_events(events)
        state = self._begin_turn(t_us, index, heard_us)
        self._follow_steps(state)
        self._showing.add_events(self._cameras.follow_ground(state, self.fleet.origin))
        if self._cameras.ground_step_m:
            self.naming.raise_ground(self._cameras.ground_step_m)
        view = self._camera(state, size if image is None else _size_of(image))
        self.naming.add_reports(self.fleet.take_reports(), state, view)
        turn = Turn(index=index, t_us=t_us, state=state, view=view)
        if detections is not None:
            self._look = self._looked(turn, detections, motion)
            turn = replace(turn, view=self._look.view)
        return self._showing.show(turn, self._look, self.fleet.origin, image=image, health=health)

    def _looked(self, turn: Turn, detections: Detections, motion: ImageMotion | None) -> Look:
        """See and name the boxes of a frame."""
        look, seen = self._seeing.look(turn, detections, motion, self._look.view if self._look else None)
        self._showing.add_events(self.naming.state_names(turn, look))
        self._showing.add_events(seen)
        if look.begins_anew:
            self.naming.begin_anew()
        look, named = self.naming.name(turn, look, self.fleet.origin)
        self._showing.add_events(named)
        if look.found is not None and self.naming.identifier.height_error is not None:
            self._cameras.compare_with_film(*self.naming.identifier.height_error)
        return look

    def between_frames(self, t_us: int, health: Health | None = None) -> Snapshot:
        """A moment of a recording between two frames: no evidence is taken in, so that names rest on frames alone.

        Args:
            t_us: When, Unix µs on the video's clock.
            health: How the program was doing, passed on.
        """
        state = self._begin_turn(t_us, NO_FRAME)
        turn = Turn(index=NO_FRAME, t_us=t_us, state=state, view=self._camera(state, None))
        return self._showing.show(turn, self._look, self.fleet.origin, image=None, health=health)

    def _begin_turn(self, t_us: int, index: int, heard_us: int = 0) -> FleetState:
        """Change the fleet where that is due; returns its state then."""
        self._follow_changes(t_us, index)
        state = self.fleet.at(self.telemetry_time(t_us), heard_us)
        self._showing.follow(state)
        self._follow_origin()
        return state

    def _follow_changes(self, t_us: int, frame: int) -> None:
        """Name the fleet as the operator changed it; who stays is named on by the same frames and reports."""
        frame, before = max(frame, self._showing.frame), self.mission
        self.mission, events = self._changes.next_due(before, t_us, frame, self._showing.clock_us)
        self._showing.add_events(events)
        if self.mission is before:
            return
        if self.mission.ugv_ids != before.ugv_ids:
            self.fleet.set_ugvs(self.mission.ugv_ids)
            self._look = replace(self._look, found=None) if self._look else None
        self.naming.change_fleet(self.mission)
        self._showing.change_fleet(self.mission)

    def _follow_origin(self) -> None:
        """Begin the names again when places are given in another frame: all evidence was in the one before."""
        if self._origin is not None and self.fleet.origin is not self._origin:
            self._begin_anew()
            self._cameras.forget_places()
        self._origin = self.fleet.origin

    def _follow_steps(self, state: FleetState) -> None:
        """Names begin again after a step of the UAV's position that cannot be taken out."""
        restarts, events = self._cameras.follow_steps(state, sure=self.naming.identifier.locked)
        if restarts:
            self._begin_anew()
        self._showing.add_events(events)

    def _begin_anew(self) -> None:
        """Forget all evidence of who is who."""
        self.naming.begin_anew()
        self._look = replace(self._look, found=None, view=None, uv={}) if self._look else None

    def telemetry_time(self, t_us: int) -> int:
        """Telemetry's time, Unix µs, at a time of the video's clock, by the offset that the mission declares."""
        return t_us - self._offset_us

    def _camera(self, state: FleetState, size: tuple[int, int] | None) -> FrameCamera | None:
        """The camera as the UAV reports it, None without a position or a camera."""
        camera, events = self._cameras.at(state, size)
        self._showing.add_events(events)
        return camera


def _size_of(image: NDArray[np.uint8] | None) -> tuple[int, int] | None:
    """Width and height, px."""
    return None if image is None else (image.shape[1], image.shape[0])
