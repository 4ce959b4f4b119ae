"""Camera geometry against OpenCV, against itself backwards, and against what the words of the mount say."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vision.camera.camera import (
    R_ENU_NED,
    CameraPose,
    Mount,
    camera_pose,
    footprint,
    ground,
    ground_sampling,
    image_warp,
    project,
)
from vision.camera.intrinsics import Intrinsics
from vision.camera.lens import distort, fold_radius
from vision.errors import CameraError

MODEST = settings(max_examples=40, deadline=None)
SMALL = st.floats(-0.12, 0.12)
SKEW = st.floats(-0.005, 0.005)
LENS = st.tuples(st.floats(-0.3, 0.3), SMALL, SKEW, SKEW, st.floats(-0.03, 0.03))
TILT = st.floats(-0.6, 0.6)


def camera(lens=(0.0,) * 5):
    return Intrinsics(width=1920, height=1080, fx=1200.0, fy=1190.0, cx=955.0, cy=548.0, distortion=np.array(lens))


def body(roll=0.0, pitch=0.0, yaw=0.0):
    """R_enu_body by OpenCV's rotation vectors, independent of the code under test."""
    R = [cv2.Rodrigues(np.array(v, dtype=float))[0] for v in ((0, 0, yaw), (0, pitch, 0), (roll, 0, 0))]
    return R_ENU_NED @ R[0] @ R[1] @ R[2]


def nadir(yaw=0.0, height=40.0):
    return camera_pose(Mount(), [0.0, 0.0, height], body(yaw=yaw))


def one_to_one(lens):
    """Whether the lens model is usable over the whole test image."""
    return fold_radius(np.array(lens)) > 1.15


@MODEST
@given(LENS, TILT, TILT, st.floats(-3, 3))
def test_project_agrees_with_opencv(lens, roll, pitch, yaw):
    seen = camera(lens)
    pose = camera_pose(Mount(kind="fixed"), [3.0, -2.0, 40.0], body(roll, pitch, yaw))
    points = ground(camera(), pose, np.random.default_rng(0).uniform((0, 0), (1920, 1080), (20, 2)), 0.0)
    points = points[np.isfinite(points).all(axis=-1)]
    uv, in_front = project(seen, pose, points)
    R_cam_enu = pose.R_enu_cam.T
    expected, _ = cv2.projectPoints(points, R_cam_enu, -R_cam_enu @ pose.p_enu, seen.K, seen.distortion)
    np.testing.assert_allclose(uv[in_front], expected[:, 0][in_front], atol=1e-6)
    if one_to_one(lens):
        assert in_front.all()


@MODEST
@given(LENS.filter(one_to_one))
def test_rays_undo_the_lens_over_the_whole_image(lens):
    seen = camera(lens)
    u, v = np.meshgrid(np.linspace(0, 1920, 25), np.linspace(0, 1080, 15))
    ideal = (np.stack([u, v], axis=-1) - (seen.cx, seen.cy)) / (seen.fx, seen.fy)
    shown = distort(ideal, seen.distortion) * (seen.fx, seen.fy) + (seen.cx, seen.cy)
    ray = seen.rays(shown)
    np.testing.assert_allclose(np.linalg.norm(ray, axis=-1), 1.0, atol=1e-12)
    back, in_front = seen.pixels(7.0 * ray)
    assert in_front.all()
    np.testing.assert_allclose(back, shown, atol=1e-6)
    np.testing.assert_allclose(ray[..., :2] / ray[..., 2:], ideal, atol=1e-8)


@MODEST
@given(TILT, TILT, st.floats(-3, 3), st.floats(-5, 5))
def test_ground_and_project_are_inverse(roll, pitch, yaw, z):
    seen = camera((-0.1, 0.02, 0.001, -0.001, 0.0))
    pose = camera_pose(Mount(kind="fixed", pitch=-1.2), [10.0, 20.0, 45.0], body(roll, pitch, yaw))
    uv = np.random.default_rng(1).uniform((0, 0), (1920, 1080), (30, 2))
    p = ground(seen, pose, uv, z)
    below = np.isfinite(p).all(axis=-1)
    np.testing.assert_allclose(p[below, 2], z, atol=1e-6)
    back, in_front = project(seen, pose, p[below])
    assert in_front.all()
    np.testing.assert_allclose(back, uv[below], atol=1e-5)


def test_nadir_camera_has_the_nose_up_in_the_image():
    pose = nadir(yaw=np.pi / 2)  # nose east
    uv, _ = project(camera(), pose, [[0.0, 0.0, 0.0], [5.0, 0.0, 0.0], [0.0, -5.0, 0.0]])
    np.testing.assert_allclose(uv[0], [955.0, 548.0], atol=1e-9)
    assert uv[1, 1] < uv[0, 1]  # east of the vehicle is up
    assert uv[2, 0] > uv[0, 0]  # south of it is right


def test_mount_yaw_turns_image_up_from_the_nose():
    pose = camera_pose(Mount(yaw=np.pi / 2), [0.0, 0.0, 40.0], body(yaw=0.0))
    uv, _ = project(camera(), pose, [5.0, 0.0, 0.0])
    np.testing.assert_allclose(uv, [955.0, 548.0 - 5 / 40 * 1190.0], atol=1e-9)


def test_level_camera_looks_along_the_nose_with_the_horizon_level():
    pose = camera_pose(Mount(pitch=0.0), [0.0, 0.0, 40.0], body(yaw=0.0))
    np.testing.assert_allclose(pose.R_enu_cam[:, 2], [0, 1, 0], atol=1e-12)  # forward is north
    np.testing.assert_allclose(pose.R_enu_cam[:, 0], [1, 0, 0], atol=1e-12)  # right is east
    assert np.isnan(ground(camera(), pose, [955.0, 100.0], 0.0)).all()
    assert footprint(camera(), pose, 0.0) is None


def test_stabilized_mount_forgets_tilt_and_fixed_mount_keeps_it():
    tilted, level = body(0.2, -0.1, 1.0), body(yaw=1.0)
    steady = camera_pose(Mount(), [0, 0, 40.0], tilted)
    yaw = np.arctan2(tilted[0, 0], tilted[1, 0])
    np.testing.assert_allclose(steady.R_enu_cam, camera_pose(Mount(), [0, 0, 40.0], body(yaw=yaw)).R_enu_cam)
    bolted = camera_pose(Mount(kind="fixed"), [0, 0, 40.0], tilted)
    np.testing.assert_allclose(bolted.R_enu_cam[:, 2], tilted[:, 2], atol=1e-12)  # along the body's down
    assert np.abs(bolted.R_enu_cam - camera_pose(Mount(), [0, 0, 40.0], level).R_enu_cam).max() > 0.05


def test_reported_gimbal_wins_on_a_stabilized_mount_only():
    gimbal = body(0.0, -1.0, 0.3)
    pose = camera_pose(Mount(), [0, 0, 40.0], body(), gimbal)
    np.testing.assert_allclose(pose.R_enu_cam[:, 2], gimbal[:, 0])  # optical axis
    np.testing.assert_allclose(pose.R_enu_cam[:, 0], gimbal[:, 1])  # image right
    np.testing.assert_allclose(pose.R_enu_cam[:, 1], gimbal[:, 2])  # image down
    fixed = camera_pose(Mount(kind="fixed"), [0, 0, 40.0], body(), gimbal)
    assert np.abs(fixed.R_enu_cam - pose.R_enu_cam).max() > 0.1


def test_mount_angles_equal_the_gimbal_that_reports_them():
    mount = Mount(roll=0.1, pitch=-0.9, yaw=0.4)
    told = camera_pose(mount, [0, 0, 40.0], body(yaw=0.7))
    seen = camera_pose(Mount(), [0, 0, 40.0], body(), body(0.1, -0.9, 0.4 + 0.7))
    np.testing.assert_allclose(told.R_enu_cam, seen.R_enu_cam, atol=1e-12)


@MODEST
@given(st.floats(-0.2, 0.2), st.floats(-0.2, 0.2), st.floats(-0.5, 0.5), st.booleans())
def test_warp_carries_ground_pixels_between_images(roll, pitch, yaw, bent):
    seen = camera((-0.05, 0.01, 0.0005, 0.0, 0.0) if bent else (0.0,) * 5)
    before = camera_pose(Mount(kind="fixed"), [0, 0, 40.0], body(0.05, 0.0, 0.1))
    after = camera_pose(Mount(kind="fixed"), [1.0, -2.0, 41.0], body(0.05 + roll / 10, pitch / 10, 0.1 + yaw / 10))
    uv = np.random.default_rng(2).uniform((100, 100), (1820, 980), (20, 2))
    expected, _ = project(seen, after, ground(seen, before, uv, 0.5))
    H = image_warp(seen, before, after, 0.5)
    moved = np.concatenate([uv, np.ones((20, 1))], axis=1) @ H.T
    np.testing.assert_allclose(moved[:, :2] / moved[:, 2:], expected, atol=2.0 if bent else 1e-6)


def test_warp_without_ground_below_is_the_identity():
    low = CameraPose(R_enu_cam=nadir().R_enu_cam, p_enu=np.array([0.0, 0.0, 0.0]))
    np.testing.assert_array_equal(image_warp(camera(), low, nadir(), 0.0), np.eye(3))


def test_footprint_is_the_image_on_the_ground():
    corners = footprint(Intrinsics(width=1200, height=600, fx=600, fy=600, cx=600, cy=300), nadir(height=30.0), 0.0)
    np.testing.assert_allclose(corners, [[-30, 15], [30, 15], [30, -15], [-30, -15]], atol=1e-9)


def test_ground_sampling_at_nadir_is_height_over_focal_length():
    even = Intrinsics(width=1920, height=1080, fx=1200, fy=1200, cx=960, cy=540)
    assert ground_sampling(even, nadir(height=39.6), 0.0) == pytest.approx(0.033)


def test_points_behind_or_folded_by_the_lens_are_not_seen():
    barrel = camera((-0.4, 0.0, 0.0, 0.0, 0.0))
    uv, in_front = barrel.pixels([[0.0, 0.0, -1.0], [3.0, 0.0, 1.0], [0.1, 0.0, 1.0]])
    assert in_front.tolist() == [False, False, True]
    assert np.isnan(uv[:2]).all() and np.isfinite(uv[2]).all()


@pytest.mark.parametrize(
    "bad",
    [{"fx": 0.0}, {"width": -1}, {"distortion": np.zeros(4)}, {"cx": np.nan}],
    ids=["no focal length", "negative size", "four coefficients", "not a number"],
)
def test_impossible_intrinsics_are_refused(bad):
    good = {"width": 10, "height": 10, "fx": 9.0, "fy": 9.0, "cx": 5.0, "cy": 5.0}
    with pytest.raises(CameraError, match="camera"):
        Intrinsics(**{**good, **bad})


def test_unknown_mount_is_refused():
    with pytest.raises(CameraError, match="stabilized"):
        Mount(kind="glued")  # type: ignore[arg-type]
