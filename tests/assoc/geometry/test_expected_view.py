import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from assoc.geometry.expected_view import chance_in_view
from assoc.geometry.ground import HEIGHT, NORTH, PITCH, ROLL, THETA, YAW, ground_to_rays, rays_to_ground
from assoc.records import CameraState
from tests.support.assoc_scene import camera

HALF = (0.8, 0.45)


def seen_by(view, half=HALF):
    return CameraState(
        R_enu_cam=view.R_enu_cam,
        p_enu=view.p_enu,
        ground_z=view.ground_z,
        px_rad=view.px_rad,
        attitude_known=True,
        position_known=True,
        stabilized=True,
        half_view=half,
    )


@given(st.floats(-3.0, 3.0), st.floats(-0.02, 0.02), st.floats(-0.02, 0.02), st.floats(-3.0, 3.0))
def test_places_and_rays_are_each_others_inverse(yaw, pitch, roll, north):
    view, theta = camera(yaw=0.4), np.zeros(THETA)
    theta[[YAW, PITCH, ROLL, NORTH, HEIGHT]] = yaw, pitch, roll, north, 0.7
    rays = np.array([[0.3, -0.2, 1.0], [-0.5, 0.1, 1.0]])
    places = rays_to_ground(rays, view.R_enu_cam, view.p_enu, view.ground_z, theta)
    back = ground_to_rays(places, view.R_enu_cam, view.p_enu, view.ground_z, theta)
    np.testing.assert_allclose(back[:, :2] / back[:, 2:], rays[:, :2], atol=2e-3)


def test_chance_falls_at_the_edge_of_the_image():
    view = seen_by(camera())
    east = np.array([0.0, 30.0, 32.0, 34.0, 60.0])  # the edge is at 0.8 · 40 m
    places = np.column_stack([east, np.zeros(5)])
    chance = chance_in_view(places, np.zeros(5), 1.0, view, np.zeros(THETA))
    assert chance[0] > 0.999
    assert chance[2] == pytest.approx(0.5, abs=0.01)
    assert chance[4] < 1e-6
    assert np.all(np.diff(chance) < 0.0)


def test_silent_and_unheard_vehicles_are_not_expected():
    places = np.array([[0.0, 0.0], [0.0, 0.0], [np.nan, np.nan]])
    chance = chance_in_view(places, np.array([0.0, 30.0, np.inf]), 1.0, seen_by(camera()), np.zeros(THETA))
    assert chance[0] > 0.99
    assert chance[1] < 1e-3
    assert chance[2] == 0.0


def test_unknown_view_says_nothing_either_way():
    view = seen_by(camera(), (np.nan, np.nan))
    assert chance_in_view(np.zeros((1, 2)), np.zeros(1), 1.0, view, np.zeros(THETA)) == 0.5
