"""The camera at each frame, from the UAV's telemetry: optics, direction, and its position without steps."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gcs.errors import ConfigError
from gcs.fold.camera.direction import CameraDirection
from gcs.fold.camera.finder import CameraFinder
from gcs.fold.camera.frame_camera import FrameCamera, identifier_params
from gcs.fold.camera.optics import Optics
from gcs.fold.camera.position_steps import StepFilter
from gcs.fold.camera.silent_zoom import SilentZoom, magnified
from gcs.fold.ground.height import FOOT, TAKEOFF, GroundHeight
from gcs.fold.ground.surface import Relief
from gcs.mission.mission import Camera, Mission
from gcs.snapshot import Event
from mavlink.fleet.fleet import Fleet
from mavlink.geodesy import LocalFrame
from mavlink.state import FleetState, UavAttitude
from vision.camera.camera import CameraPose
from vision.detect.detections import Detections
from vision.motion.attitude_fusion import AttitudeFusion
from vision.motion.fused_evidence import ReportedRotation, SeenTracks
from vision.motion.image_motion import ImageMotion
from vision.motion.lag_search import LagSearch
from vision.motion.rotation import CameraTurn, GroundShift, rotation_of
from vision.track.tracks import Tracks

if TYPE_CHECKING:
    from gcs.mission.terrain_file import TerrainFile

MIN_HEIGHT_M = 2.0
"""Least height above the ground, m; lower down nothing is level enough."""
SPEED_STD, UNKNOWN_SPEED_STD = 0.3, 8.0
"""1σ per axis of the UAV's reported velocity, m/s, and of one that reports none."""
COARSE_M = 2.5
"""1σ of a position from which on it is coarse: rounded, or of few satellites; a receiver with a view of the sky has
less."""
BOX_NOISE, MIN_NOISE_PX = 0.04, 1.0
"""1σ of a box's centre, in box sizes, and at least, px: as the tracker has it."""


class FrameCameras:
    """Finds the camera's intrinsics and pose at one frame after the other.

    Args:
        mission: who flies with which camera.
        sized: whether frames of unknown size are of the size that the camera is described for.
    """

    def __init__(self, mission: Mission, *, sized: bool = True) -> None:
        self._uav_id, self._usual = mission.uav.system_id, identifier_params(mission)
        self._steps = StepFilter()
        home = FOOT if mission.mast else TAKEOFF
        self._new_heights = partial(
            GroundHeight, takeoff_known=mission.map.takeoff_known or bool(mission.mast), home=home
        )
        self._heights = self._new_heights()
        self._terrain, self._terrain_fault = _terrain_of(mission)
        self._optics = Optics(mission.camera, sized=sized)
        self._zoom = SilentZoom()
        self._direction = CameraDirection(mission)
        self._finder = CameraFinder(mission.camera)
        self._fusion = AttitudeFusion()
        self._K: NDArray[np.float64] = np.zeros((3, 3))
        self._reported: ReportedRotation | None = None
        self._asked_us = 0
        self._lags = LagSearch()
        self._found_lag_s: float | None = None

    @property
    def size(self) -> tuple[int, int] | None:
        """Width and height of a frame, px; None while unknown."""
        return self._optics.size

    @property
    def found(self) -> Camera | None:
        """The camera that was found from the film, where nothing described it; None before, and where something
        does."""
        return self._finder.camera

    @property
    def guessed(self) -> bool:
        """True if the direction is a guess that may soon be replaced."""
        return self._finder.guesses

    def find(
        self, state: FleetState, boxes: Detections, tracks: Tracks, camera: FrameCamera | None
    ) -> tuple[bool, Sequence[Event]]:
        """Search for the camera, where nothing describes its lens or its direction.

        Returns:
            Whether names have to start again, since another camera is used from the next frame on; and what an operator
            should know.
        """
        size = self._optics.size
        if size is None or self._finder.describes_lens:
            return False, ()
        focal = camera.intrinsics.fx / size[0] if camera else math.nan
        ground_z = self._heights.below(state.uav).z
        found, events = self._finder.look(state, boxes, tracks, size, ground_z=ground_z, focal=focal)
        if found is None:
            return False, events
        self._optics = Optics(found)
        self._direction.use(found)
        self._zoom.restart()
        self._restart()
        return camera is not None, events

    @property
    def attitude_lag_us(self) -> int:
        """Delay of the attitude that belongs to a frame after the frame's time, by telemetry's clock."""
        return round(self._fusion.lag_s * 1e6)

    def order_given(self, t_us: int) -> None:
        """Note an order that turns the camera."""
        self._direction.order_given(t_us)

    def forget_places(self) -> None:
        """Take positions as they are reported again: they are given in another frame from now on."""
        self._steps, self._heights = StepFilter(), self._new_heights()
        self._zoom.restart()
        self._restart()

    def _restart(self) -> None:
        """Forget all places that the fusion and the search of the lag have."""
        self._fusion.restart()
        self._lags.forget()

    def follow_ground(self, state: FleetState, frame: LocalFrame | None) -> Sequence[Event]:
        """Take in what the fleet reports of the ground's height at a frame.

        Args:
            state: the fleet.
            frame: its local frame, None while no place is known.

        Returns:
            What an operator should know of it.
        """
        relief = Relief(terrain=self._terrain, frame=frame) if self._terrain and frame else None
        events = list(self._heights.update(state, relief))
        if self._heights.step_m:
            self._zoom.restart()
        if self._terrain_fault:
            text, self._terrain_fault = self._terrain_fault, ""
            events.append(Event(t_us=state.t_us, level="warning", kind="camera", text=text, system_id=self._uav_id))
        return events

    @property
    def ground_step_m(self) -> float:
        """Step by which the ground rose at once, with the last frame, since a source of its height was left out."""
        return self._heights.step_m

    def compare_with_film(self, error_m: float, std_m: float) -> None:
        """Leave out sources of the ground's height that the film contradicts.

        Args:
            error_m: by how much the camera is higher above the ground, as the film shows.
            std_m: 1σ of that.
        """
        self._heights.compare_with_film(error_m, std_m)

    def follow_steps(self, state: FleetState, *, sure: bool) -> tuple[bool, Sequence[Event]]:
        """Take out steps of the UAV's position that the video does not show.

        Returns:
            Whether names have to start again, since the step was not taken out, and what happened.
        """
        if not state.uav.position_valid:
            return False, ()
        before = self._steps.shift_enu
        restart_m = self._steps.update(state.t_us, state.uav.p_enu, state.uav.v_enu, sure=sure)
        taken_m = float(np.linalg.norm(self._steps.shift_enu - before))
        if not (restart_m or taken_m):
            return False, ()
        if restart_m:
            self._restart()
        then = "names begin anew" if restart_m else "the camera goes on from where it was"
        text = f"the UAV's position stepped by {restart_m or taken_m:.0f} m: {then}"
        event = Event(t_us=state.t_us, level="warning", kind="vehicle", text=text, system_id=self._uav_id)
        return bool(restart_m), (event,)

    def zoomed(self, t_us: int, camera: FrameCamera, detections: Detections) -> FrameCamera:
        """The camera of a frame, zoomed if its boxes show that it was zoomed at once, which nothing reports."""
        factor = self._zoom.jump(t_us, camera, detections)
        if factor == 1.0:
            return camera
        self._optics.magnify(t_us, factor)
        return magnified(camera, factor)

    def predicted(
        self,
        state: FleetState,
        camera: FrameCamera,
        fleet: Fleet,
        motion: ImageMotion | None,
        *,
        yaw_error: float = 0.0,
    ) -> FrameCamera:
        """The camera as it should be at a frame before its boxes are seen.

        Args:
            state: the fleet at the frame.
            camera: as telemetry has it.
            fleet: asked for the attitude at other times.
            motion: how the camera moved since the last frame, by the pixels; None: not known.
            yaw_error: by how much the camera's heading is off, radians clockwise, as far as known.
        """
        self._reported = self._attitude(state, fleet)
        zoomed = not np.array_equal(self._K, camera.intrinsics.K)
        self._K = camera.intrinsics.K
        if motion is not None and not zoomed:
            turn = self._turn(state, camera, motion, yaw_error)
            self._reported = replace(self._reported, seen_turn=turn)
        return _turned(camera, self._fusion.predicted(state.t_us, self._reported))

    def seen(self, t_us: int, camera: FrameCamera, detections: Detections, tracks: Tracks) -> FrameCamera:
        """The camera after the boxes of the frame that was predicted last."""
        assert self._reported is not None
        found = tracks.detection >= 0
        boxes, track_id = detections.select(tracks.detection[found]), tracks.track_id[found]
        rays = camera.intrinsics.rays(boxes.centre)
        factor = self._zoom.change(t_us, camera, boxes, track_id, rays)
        if factor != 1.0:
            self._optics.magnify(t_us, factor)
            camera = magnified(camera, factor)
            rays = camera.intrinsics.rays(boxes.centre)
        seen = SeenTracks(
            track_id=track_id,
            ray=rays / rays[:, 2:],
            noise=np.maximum(BOX_NOISE * np.sqrt(boxes.w * boxes.h), MIN_NOISE_PX) / camera.intrinsics.fx,
        )
        R_enu_cam = self._fusion.update(t_us, self._reported, camera.pose.p_enu, camera.ground_z, seen)
        if self._reported.known:
            self._lags.add_frame(t_us, camera.pose.p_enu, camera.ground_z, seen)
            self._found_lag_s = self._lags.found(t_us, self._fusion.lag_s)
            if self._found_lag_s is not None:
                self._fusion.begin_at_lag(self._found_lag_s)
        return _turned(camera, R_enu_cam)

    def _turn(self, state: FleetState, camera: FrameCamera, motion: ImageMotion, yaw_error: float) -> CameraTurn | None:
        """Turn of the camera since the last frame by the pixels, with what telemetry knows of its flight."""
        before, v_enu = self._fusion.rotation(state.t_us), state.uav.v_enu
        height = float(camera.pose.p_enu[2]) - camera.ground_z
        if before is None or height < MIN_HEIGHT_M:
            return None
        (R_enu_cam, dt), known = before, bool(np.isfinite(v_enu).all())
        # seen by a camera that is turned clockwise by ψ, Rz(−ψ) R, the UAV flies in the direction Rᵀ Rz(ψ) v
        c, s = math.cos(yaw_error), math.sin(yaw_error)
        flown = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ v_enu
        ground = GroundShift(
            shift=R_enu_cam.T @ flown * dt if known else np.zeros(3),
            shift_std=(SPEED_STD if known else UNKNOWN_SPEED_STD) * dt,
            down=-R_enu_cam[2],
            height=height,
        )
        return rotation_of(motion, camera.intrinsics, ground)

    def _attitude(self, state: FleetState, fleet: Fleet) -> ReportedRotation:
        """Telemetry's rotation at a frame and since the last."""
        t_us, lag_us = state.t_us, self.attitude_lag_us
        gimbal, report = self._direction.follows_gimbal, state.uav.camera
        uav = fleet.attitude_at(t_us + lag_us, gimbal=gimbal) if lag_us else state.uav
        before_us, self._asked_us = self._asked_us, t_us

        def rotation(uav: UavAttitude) -> NDArray[np.float64]:
            return self._direction.rotation(uav, report)

        sampled_us = fleet.attitude_times(before_us + lag_us, t_us + lag_us) if before_us else []
        wanted_us = fleet.attitude_times(*self._lags.samples_wanted(t_us)) if uav.attitude_valid else []
        sampled = {
            sample_us: rotation(fleet.attitude_at(sample_us, gimbal=gimbal)) for sample_us in {*sampled_us, *wanted_us}
        }
        for sample_us in wanted_us:
            self._lags.add_sample(sample_us, sampled[sample_us])
        if not uav.attitude_valid:
            self._lags.forget()
        return ReportedRotation(
            R_enu_cam=rotation(uav),
            known=uav.attitude_valid,
            sample_us=tuple(sample_us - lag_us for sample_us in sampled_us),
            samples_enu_cam=tuple(sampled[sample_us] for sample_us in sampled_us),
        )

    def _lag_news(self, t_us: int) -> list[Event]:
        """News that the attitude is used as of another time from now on, if it is."""
        lag_s, self._found_lag_s = self._found_lag_s, None
        if lag_s is None:
            return []
        when = f"{abs(lag_s):.1f} s {'after' if lag_s > 0.0 else 'before'}"
        text = f"the camera's turns are in telemetry {when} they are in the film: corrected"
        return [Event(t_us=t_us, level="info", kind="camera", text=text, system_id=self._uav_id)]

    def at(self, state: FleetState, size: tuple[int, int] | None) -> tuple[FrameCamera | None, Sequence[Event]]:
        """The camera, and what an operator should know of it.

        Args:
            state: the fleet at the frame.
            size: width and height of the frame, px; None: as the last one.

        Returns:
            None for the camera without a position or intrinsics.
        """
        uav = state.uav
        intrinsics = self._optics.intrinsics(state.t_us, uav.camera, size)
        events = self._optics.take_events() + self._lag_news(state.t_us)
        ground = self._heights.below(uav)
        if intrinsics is None or not uav.position_valid or not np.isfinite(ground.z):
            return None, events
        events += self._direction.check(state.t_us, uav)
        camera = FrameCamera(
            intrinsics=intrinsics,
            pose=self._direction.pose(uav, uav.p_enu + self._steps.shift_enu),
            ground=ground,
            attitude_known=uav.attitude_valid,
            position_sure=not state.vehicles[0].doubted_for,
            stabilized=self._direction.stabilized,
            position_std_m=uav.std_m if uav.std_m >= COARSE_M else math.nan,
            usual=self._usual,
        )
        return camera, events


def _terrain_of(mission: Mission) -> tuple[TerrainFile | None, str]:
    """The mission's terrain file, or why it is not used: recordings replay without it."""
    if mission.terrain is None:
        return None, ""
    from gcs.mission.terrain_file import TerrainFile  # its libraries take their time

    try:
        return TerrainFile(mission.terrain), ""
    except ConfigError as error:
        return None, f"{error}; the ground's height is found without it"


def _turned(camera: FrameCamera, R_enu_cam: NDArray[np.float64]) -> FrameCamera:
    reported = camera.pose.R_enu_cam if camera.R_reported is None else camera.R_reported
    pose = CameraPose(R_enu_cam=R_enu_cam, p_enu=camera.pose.p_enu)
    return replace(camera, pose=pose, R_reported=reported, of_image_time=True)
