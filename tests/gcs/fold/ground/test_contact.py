"""Boxes of bodies that stand on the ground: a ray through a box's middle is led to the place below it."""

from __future__ import annotations

import numpy as np
import pytest

from gcs.fold.camera.frame_camera import FrameCamera
from gcs.fold.ground.contact import box_lengths, contact_rays, pixels_on_ground
from gcs.fold.ground.surface import GroundSurface
from sim.world.boxes import true_boxes
from sim.world.view import Bodies, CameraView
from vision.camera.camera import CameraPose, Mount, camera_pose
from vision.camera.intrinsics import Intrinsics

LEVEL = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
BODIES = {"small": (2.2, 1.4, 0.9), "car": (4.5, 1.9, 1.6)}


def seen(pitch_deg, height_m, body):
    """A camera, the places of bodies in its view (n, 2), rays through the middles of their boxes, and box sizes."""
    lens = Intrinsics(width=1920, height=1080, fx=1400.0, fy=1400.0, cx=960.0, cy=540.0)
    pose: CameraPose = camera_pose(Mount(kind="stabilized", pitch=np.radians(pitch_deg)), (0.0, 0.0, height_m), LEVEL)
    ahead = height_m / np.tan(np.radians(-pitch_deg)) if pitch_deg > -89 else 0.0
    place = np.array([(x, ahead + y) for x in (-8.0, 0.0, 8.0) for y in (-6.0, 0.0, 6.0)])
    n = len(place)
    length, width, height = (np.full(n, side) for side in body)
    bodies = Bodies(
        kind=np.zeros(n, np.int8),
        x=place[:, 0],
        y=place[:, 1],
        heading=np.linspace(0.0, 6.0, n),
        length=length,
        width=width,
        height=height,
        color=np.zeros((n, 3), np.uint8),
    )
    view = CameraView(
        width=1920,
        height=1080,
        fx=1400.0,
        fy=1400.0,
        cx=960.0,
        cy=540.0,
        distortion=np.zeros(5),
        R_enu_cam=pose.R_enu_cam,
        p_enu=pose.p_enu,
    )
    boxes = true_boxes(view, bodies)
    camera = FrameCamera(
        intrinsics=lens,
        pose=pose,
        ground=GroundSurface(at=np.zeros(2), z=0.0, slope=np.zeros(2), std_m=1.0),
        attitude_known=True,
        position_sure=True,
    )
    return camera, place, lens.rays(np.column_stack([boxes.cx, boxes.cy])), np.sqrt(boxes.w * boxes.h)


def off(camera, place, rays):
    """(n,) metres from places to where rays meet the ground."""
    d = rays @ camera.pose.R_enu_cam.T
    p = camera.pose.p_enu + d * (-camera.pose.p_enu[2] / d[:, 2])[:, None]
    return np.hypot(*(p[:, :2] - place).T)


@pytest.mark.parametrize("body", BODIES)
@pytest.mark.parametrize(("pitch_deg", "height_m"), [(-25.0, 25.0), (-35.0, 35.0), (-50.0, 40.0)])
def test_the_place_below_a_box_is_nearer_to_the_vehicle_than_its_middle(pitch_deg, height_m, body):
    camera, place, rays, size_px = seen(pitch_deg, height_m, BODIES[body])
    middle, contact = (off(camera, place, r) for r in (rays, contact_rays(rays, size_px, camera)))
    assert contact.mean() < 0.35 * middle.mean()
    assert contact.max() < 0.45 * middle.max()


def test_straight_below_a_box_is_where_it_seems():
    camera, _, _, _ = seen(-90.0, 40.0, BODIES["car"])
    down = np.array([[0.0, 0.0, 1.0]])
    np.testing.assert_allclose(np.cross(contact_rays(down, np.array([60.0]), camera), down), 0.0, atol=1e-9)


def test_rays_near_the_horizon_are_left_as_they_are():
    camera, _, _, _ = seen(-25.0, 25.0, BODIES["car"])
    flat = camera.intrinsics.rays(np.array([[960.0, 0.0]]))
    np.testing.assert_array_equal(contact_rays(flat, np.array([20.0]), camera), flat)


def test_a_box_is_as_long_as_its_body_wherever_it_is_in_a_view_straight_down():
    camera, _, _, _ = seen(-90.0, 40.0, BODIES["small"])
    rays = np.array([[0.0, 0.0, 1.0], [0.3, 0.2, 1.0], [0.0, 0.0, -1.0]])
    length_m = box_lengths(rays, np.full(3, 2.2 * 1400.0 / 40.0), camera)
    assert length_m[:2] == pytest.approx(2.2)
    assert np.isnan(length_m[2])


def test_from_the_side_a_box_does_not_tell_how_long_its_vehicle_is():
    camera, _, rays, _ = seen(-30.0, 40.0, BODIES["car"])
    assert np.isnan(box_lengths(rays, np.full(len(rays), 100.0), camera)).all()


@pytest.mark.parametrize("pitch_deg", [-90.0, -60.0, -30.0])
def test_a_step_in_the_picture_is_as_long_on_the_ground_as_its_ends_are_apart(pitch_deg):
    camera, _, _, _ = seen(pitch_deg, 40.0, BODIES["small"])
    px = np.array([(700.0, 300.0), (960.0, 540.0), (1400.0, 800.0)])
    A = pixels_on_ground(camera.intrinsics.rays(px), camera)

    def on_ground(uv):
        rays = camera.intrinsics.rays(uv) @ camera.pose.R_enu_cam.T
        return camera.pose.p_enu[:2] - 40.0 * rays[:, :2] / rays[:, 2:]

    for step in np.array([(1.0, 0.0), (0.0, 1.0), (0.6, -0.8)]):
        apart = np.hypot(*(on_ground(px + step) - on_ground(px - step)).T) / 2.0
        told = np.hypot(*(A @ step).T)
        # off the middle of the picture a pixel is seen askew, which R/f does not know
        np.testing.assert_allclose(told, apart, rtol=0.12)
        assert told[1] == pytest.approx(apart[1], rel=1e-3)
