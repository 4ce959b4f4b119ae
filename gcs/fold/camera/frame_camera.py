"""The camera at one frame, and where it should see the vehicles by their reports."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from assoc.params import IdentifierParams
from gcs.camera_aim import CameraAim
from gcs.fold.ground.surface import GroundSurface
from gcs.mission.mission import Mission
from mavlink.state import FleetState, UavState
from vision.camera.camera import CameraPose, image_warp, project
from vision.camera.intrinsics import Intrinsics

FloatArray = NDArray[np.float64]
PRIOR = IdentifierParams()


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameCamera:
    """The camera at one frame."""

    intrinsics: Intrinsics
    pose: CameraPose
    ground: GroundSurface
    attitude_known: bool
    position_sure: bool
    """False while the UAV doubts its own position."""
    stabilized: bool = False
    """True if a gimbal keeps its horizon level."""
    position_std_m: float = math.nan
    """1σ of its position per axis, level, where that is known to be coarse; else NaN."""
    R_reported: FloatArray | None = None
    """(3, 3) rotation by telemetry, where the pose has another; None: the same."""
    of_image_time: bool = False
    """True if the boxes gave the rotation at the frame's own moment; else it is telemetry's, by telemetry's clock."""
    usual: IdentifierParams = PRIOR
    """Parameters of the identifier, with the usual errors of the camera's pose."""

    @property
    def ground_z(self) -> float:
        """Height of the level plane on which tracks and reports are compared, ENU metres."""
        return self.ground.z

    def place_std_m(self, p_enu: FloatArray) -> FloatArray:
        """Uncertainty of places (k, 3) that were worked out from pixels, before any vehicle's report is compared.

        Returns:
            (k,) 1σ per level axis, m, of the reported pose's usual errors, to first order; NaN where
            the place, or the camera's attitude or position, is unknown.
        """
        reach = p_enu - self.pose.p_enu
        d2, h2 = np.square(reach[..., :2]).sum(axis=-1), np.square(reach[..., 2])
        s2, f2 = d2 + h2, self.intrinsics.fx * self.intrinsics.fy
        with np.errstate(divide="ignore", invalid="ignore"):
            # an angle ε of the ray moves the place along it by s²/h·ε, across it by h·ε (tilt), s·ε (pixel), d·ε (yaw);
            # σ² is the mean of both
            along2 = s2**2 / h2
            tilt2 = (along2 + h2) / 2 * np.radians(self.usual.tilt_std_deg) ** 2
            yaw2 = d2 / 2 * np.radians(self.usual.yaw_std_deg) ** 2
            pixel2 = (along2 + s2) / 2 * self.usual.pixel_std**2 / f2
            height2 = d2 / h2 / 2 * self.usual.height_std_m**2
        level = self.position_std_m if math.isfinite(self.position_std_m) else self.usual.position_std_m
        std_m = np.sqrt(level**2 + tilt2 + yaw2 + pixel2 + height2)
        return np.where(self.attitude_known and self.position_sure, std_m, np.nan)


def identifier_params(mission: Mission) -> IdentifierParams:
    """Return the identifier's parameters for a mission's first camera: for one on a mast with the stated errors."""
    usual = replace(PRIOR, threshold=mission.identity.threshold)
    if mission.mast is None:
        return usual
    return replace(usual, yaw_std_deg=mission.mast.heading_std_deg, tilt_std_deg=mission.mast.pitch_std_deg)


def camera_aim(view: FrameCamera, uav: UavState) -> CameraAim:
    """Aim of the camera, as snapshots tell it."""
    lens = view.intrinsics
    return CameraAim(
        R_enu_cam=view.pose.R_enu_cam,
        R_enu_body=uav.R_enu_body,
        hfov=lens.hfov,
        vfov=float(np.arctan(lens.cy / lens.fy) + np.arctan((lens.height - lens.cy) / lens.fy)),
        ground_z=view.ground_z,
    )


def reported_pixels(state: FleetState, view: FrameCamera | None) -> dict[int, FloatArray]:
    """Pixel (2,) of each vehicle's reported place, by system id; only vehicles that are usable now."""
    if view is None:
        return {}
    places = state.p_enu.copy()
    places[:, 2] = view.ground.height_at(places) + view.ground.bumps_under(state.system_id)
    uv, ahead = project(view.intrinsics, view.pose, places)
    usable = ahead & state.valid
    return {int(i): uv[k] for k, i in enumerate(state.system_id) if usable[k]}


def expected_pixels(
    state: FleetState, view: FrameCamera | None, rays: Callable[[FloatArray, FrameCamera], FloatArray | None]
) -> dict[int, tuple[float, float]] | None:
    """Places in the image plane where the vehicles' reports put them, with the errors of the camera's pose taken out.

    Args:
        state: the fleet.
        view: the camera as reported, None unknown.
        rays: from the corrected camera to places (k, 3) on the ground, (k, 3) in its frame; None unknown.

    Returns:
        Pixels by system id, without those behind the camera; None while the camera's pose is unknown.
    """
    if view is None:
        return None
    directions = rays(view.ground.seen_on_level(state.p_enu, state.system_id, view.pose.p_enu), view)
    if directions is None:
        return None
    uv, ahead = view.intrinsics.pixels(directions)
    return {i: (x, y) for i, (x, y), seen in zip(state.system_id.tolist(), uv.tolist(), ahead, strict=True) if seen}


def ground_warp(before: FrameCamera | None, now: FrameCamera | None) -> FloatArray | None:
    """(3, 3) how the ground moved in the image from one frame to the next, known where both poses are."""
    if before is None or now is None or not (before.attitude_known and now.attitude_known):
        return None
    return image_warp(before.intrinsics, before.pose, now.pose, now.ground_z, intrinsics_to=now.intrinsics)
