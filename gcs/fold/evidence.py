"""Evidence of the tracker, the fleet and the camera, as the identifier takes it: plain arrays."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from assoc.records import CameraState, Observation, VehicleReports
from gcs.fold.camera.frame_camera import FrameCamera
from gcs.fold.ground.contact import box_lengths, contact_rays
from mavlink.state import FleetState, Reports
from vision.camera.intrinsics import Intrinsics
from vision.detect.detections import Detections
from vision.track.tracks import Tracks

LONGEST_AGO_S = 2.0
"""Reports that are older are late by radio; the camera is taken to have flown straight on for this long."""


def observation_of(
    t_us: int, detections: Detections, tracks: Tracks, lens: Intrinsics, view: FrameCamera | None = None
) -> Observation:
    """Tracks of a frame as rays; a track that is seen is where its box is, not where the filter has it.

    Args:
        t_us: When the frame was taken, on the telemetry's clock.
        detections: The frame's boxes.
        tracks: The tracks after them.
        lens: The camera's.
        view: The camera, where boxes are of bodies; None: they are of places on the ground.
    """
    seen = tracks.detection >= 0
    centre = np.column_stack([tracks.cx, tracks.cy])
    centre[seen] = detections.centre[tracks.detection[seen]]
    reach = 0.5 * np.maximum(tracks.w, tracks.h)[:, None]
    front = centre + reach * np.column_stack([np.sin(tracks.heading), -np.cos(tracks.heading)])
    rays = lens.rays(np.concatenate([centre, front]))
    length_m = None
    if view is not None:
        long_px = np.full(len(tracks), np.nan)
        long_px[seen] = np.maximum(detections.w, detections.h)[tracks.detection[seen]]
        length_m = box_lengths(rays[: len(tracks)], long_px, view)
        rays = contact_rays(rays, np.tile(np.sqrt(tracks.w * tracks.h), 2), view)
    return Observation(
        t_us=t_us,
        track_id=tracks.track_id,
        ray_cam=rays[: len(tracks)],
        front_cam=rays[len(tracks) :],
        gap_s=np.where(seen, 0.0, tracks.gap_s),
        score=tracks.score,
        length_m=length_m,
        extent_rad=_extents(tracks) / np.array([lens.fx, lens.fy]),
    )


def _extents(tracks: Tracks) -> NDArray[np.float64]:
    """(m, 2) how wide and high the tracks' boxes are in the picture, px."""
    c, s = np.abs(np.cos(tracks.angle)), np.abs(np.sin(tracks.angle))
    return np.column_stack([tracks.w * c + tracks.h * s, tracks.w * s + tracks.h * c])


def reports_of(reports: Reports, ugv_ids: Sequence[int], view: FrameCamera | None, state: FleetState) -> VehicleReports:
    """Reports by the vehicles' indices in the mission, where the camera sees them on level ground.

    Args:
        reports: Those that came since the last frame.
        ugv_ids: The mission's vehicles.
        view: The camera, None unknown.
        state: The fleet at the frame.
    """
    p_enu = reports.p_enu
    if view is not None:
        # the camera was elsewhere when a report was made
        ago_s = np.clip((state.t_us - reports.t_us) * 1e-6, -LONGEST_AGO_S, LONGEST_AGO_S)
        v_enu = np.where(np.isfinite(state.uav.v_enu), state.uav.v_enu, 0.0)
        camera = view.pose.p_enu - ago_s[:, None] * v_enu
        p_enu = view.ground.seen_on_level(p_enu, reports.system_id, camera)
    place = {system_id: k for k, system_id in enumerate(ugv_ids)}
    return VehicleReports(
        t_us=reports.t_us,
        vehicle=np.array([place[int(s)] for s in reports.system_id], dtype=np.int64),
        p_enu=p_enu,
        v_enu=reports.v_enu,
        heading=reports.heading,
        std_m=reports.std_m,
    )


def camera_of(view: FrameCamera) -> CameraState:
    """The camera as the identifier has it."""
    lens = view.intrinsics
    return CameraState(
        R_enu_cam=view.pose.R_enu_cam,
        p_enu=view.pose.p_enu,
        ground_z=view.ground_z,
        height_std_m=view.ground.std_m,
        other_heights_m=view.ground.other_heights_m,
        of_image_time=view.of_image_time,
        R_reported=view.R_reported,
        px_rad=1.0 / lens.fx,
        attitude_known=view.attitude_known,
        position_known=view.position_sure,
        position_std_m=view.position_std_m,
        stabilized=view.stabilized,
        half_view=(0.5 * lens.width / lens.fx, 0.5 * lens.height / lens.fy),
    )
