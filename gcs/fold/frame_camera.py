"""The camera at one frame, and where it should see the vehicles by their reports."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs.fold.ground.surface import GroundSurface
from mavlink.state import FleetState
from vision.camera.camera import CameraPose, image_warp, project
from vision.camera.intrinsics import Intrinsics

__all__ = ["FrameCamera", "expected_pixels", "ground_warp", "reported_pixels"]

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameCamera:
    """The camera at one frame."""

    intrinsics: Intrinsics
    pose: CameraPose
    ground: GroundSurface
    attitude_known: bool
    position_sure: bool
    """False: the UAV doubts its own position."""
    position_std_m: float = math.nan
    """1σ of its position per axis, level, where that is known to be coarse; else NaN."""
    of_image_time: bool = False
    """The rotation is that of the frame's own moment, as its boxes show; else telemetry's, by telemetry's clock."""

    @property
    def ground_z(self) -> float:
        """Height of the level plane on which tracks and reports are compared, ENU metres."""
        return self.ground.z


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
    """Where the vehicles' reports put them in the image plane, with the errors of the camera's pose taken out.

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
