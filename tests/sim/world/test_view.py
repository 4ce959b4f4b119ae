import cv2
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from sim.world.camera import body_rotation, view_from
from sim.world.flight import UavTruth
from sim.world.scenario import Scenario, ScenarioAttitude, ScenarioCamera
from sim.world.view import project, ray_ground

BARREL = (-0.12, 0.03, 0.001, -0.0015, 0.002)
angles = st.floats(-180.0, 180.0)
tilts = st.floats(-20.0, 20.0)


def uav(yaw=0.0, pitch=0.0, roll=0.0, p=(3.0, -5.0, 40.0)):
    return UavTruth(
        p_enu=np.array(p), v_enu=np.zeros(3), yaw=np.radians(yaw), pitch=np.radians(pitch), roll=np.radians(roll)
    )


def view(attitude=None, **camera):
    return view_from(Scenario(camera=ScenarioCamera(**camera), attitude=ScenarioAttitude(**(attitude or {}))), uav())


@settings(max_examples=40, deadline=None)
@example(yaw=0.0, pitch=-6.103515625e-05, roll=0.0, mount=-90.0, seed=0)
@given(yaw=angles, pitch=tilts, roll=tilts, mount=st.floats(-90.0, -30.0), seed=st.integers(0, 99))
def test_projection_is_opencvs(yaw, pitch, roll, mount, seed):
    scenario = Scenario(
        camera=ScenarioCamera(mount="fixed", pitch_deg=mount, yaw_deg=10.0, roll_deg=3.0, distortion=BARREL)
    )
    v = view_from(scenario, uav(yaw, pitch, roll))
    rng = np.random.default_rng(seed)
    along = v.R_enu_cam @ np.array([0.0, 0.0, 30.0])
    points = v.p_enu + along + rng.uniform(-8.0, 8.0, (30, 3))
    K = np.array([[v.fx, 0, v.cx], [0, v.fy, v.cy], [0, 0, 1.0]])
    R_cam_enu = v.R_enu_cam.T
    # not by cv2.Rodrigues, which loses digits near half a turn, where cameras that look down are
    turn = Rotation.from_matrix(R_cam_enu).as_rotvec()
    want, _ = cv2.projectPoints(points, turn, -R_cam_enu @ v.p_enu, K, v.distortion)
    got, front = project(v, points)
    assert front.all()
    np.testing.assert_allclose(got, want[:, 0], atol=1e-6)


@settings(max_examples=40, deadline=None)
@given(u=st.floats(0, 1920), v=st.floats(0, 1080), yaw=angles, pitch=st.floats(-90.0, -50.0), z=st.floats(0, 3))
def test_a_pixels_ground_point_projects_back(u, v, yaw, pitch, z):
    camera = view_from(Scenario(camera=ScenarioCamera(pitch_deg=pitch, distortion=BARREL)), uav(yaw))
    ground = ray_ground(camera, [u, v], z)
    assert ground[2] == pytest.approx(z, abs=1e-9)
    uv, front = project(camera, ground)
    assert front
    np.testing.assert_allclose(uv, [u, v], atol=1e-5)


def test_at_nadir_image_up_is_the_nose():
    for yaw, ahead in ((0.0, (0.0, 5.0)), (90.0, (5.0, 0.0))):
        v = view_from(Scenario(), uav(yaw))
        uv, _ = project(v, [3.0 + ahead[0], -5.0 + ahead[1], 0.0])
        np.testing.assert_allclose(uv, [960.0, 540.0 - 1200.0 * 5.0 / 40.0], atol=1e-9)


def test_mount_yaw_turns_image_up_from_the_nose():
    uv, _ = project(view(yaw_deg=90.0), [3.0 + 5.0, -5.0, 0.0])
    np.testing.assert_allclose(uv, [960.0, 390.0], atol=1e-9)


def test_a_stabilized_camera_ignores_tilt_and_a_fixed_one_does_not():
    level, tilted = uav(30.0), uav(30.0, 5.0, -4.0)
    stabilized, fixed = Scenario(), Scenario(camera=ScenarioCamera(mount="fixed"))
    assert np.array_equal(view_from(stabilized, level).R_enu_cam, view_from(stabilized, tilted).R_enu_cam)
    assert np.array_equal(view_from(fixed, level).R_enu_cam, view_from(stabilized, level).R_enu_cam)
    # nose up: the camera looks ahead of the point below
    ahead = ray_ground(view_from(fixed, uav(0.0, 5.0)), [960.0, 540.0])
    np.testing.assert_allclose(ahead, [3.0, -5.0 + 40.0 * np.tan(np.radians(5.0)), 0.0], atol=1e-9)


def test_body_rotation_turns_clockwise_up_and_right():
    np.testing.assert_allclose(body_rotation(np.pi / 2, 0, 0) @ [1, 0, 0], [0, 1, 0], atol=1e-12)
    assert (body_rotation(0, 0.1, 0) @ [1, 0, 0])[2] < 0.0
    assert (body_rotation(0, 0, 0.1) @ [0, 1, 0])[2] > 0.0


def test_behind_and_above_the_horizon_there_is_nothing():
    v = view(pitch_deg=-30.0)
    uv, front = project(v, [[3.0, -100.0, 0.0], [3.0, 60.0, 0.0]])
    assert front.tolist() == [False, True]
    assert np.isnan(uv[0]).all()
    assert np.isnan(ray_ground(v, [960.0, -400.0])).all()


def test_points_that_the_distortion_would_fold_back_are_not_in_front():
    v = view(distortion=(-0.3, 0.0, 0.0, 0.0, 0.0))
    _, front = project(v, [[3.0 + 100.0, -5.0, 0.0], [3.0 + 10.0, -5.0, 0.0]])
    assert front.tolist() == [False, True]
