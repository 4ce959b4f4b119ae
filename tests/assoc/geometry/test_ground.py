"""Rays on the ground under a correction: exact geometry, and derivatives against differences."""

import numpy as np
import pytest

from assoc.geometry.ground import (
    EAST,
    HEIGHT,
    LAG,
    NORTH,
    OFFSET,
    PITCH,
    ROLL,
    THETA,
    YAW,
    angles_to_places,
    camera_at_frame,
    ground_tracks,
    rays_to_ground,
)
from assoc.history import TrackHistory
from tests.support.assoc_scene import Fleet, camera


def history(frames=30, yaw_rate=0.1):
    fleet, rng = Fleet(), np.random.default_rng(0)
    kept = TrackHistory(20.0, 0.09, 0.6)
    for k in range(frames):
        t = k / 10
        view = camera(p=(1.5 * t, -t, 40.0 + 0.2 * t), yaw=yaw_rate * t)
        kept.append(t, fleet.observation(t, view, [1, 2, 3, 4], rng, pixel=0.0), view)
    return kept, fleet


def test_true_pose_gives_true_places():
    kept, fleet = history()
    tracks = ground_tracks(kept, 0, np.zeros(THETA), np.arange(4))
    for k in (0, 12, 29):
        np.testing.assert_allclose(tracks.p[k], fleet.at(k / 10)[0], atol=1e-9)
        v = fleet.at(k / 10)[1]
        np.testing.assert_allclose(tracks.heading[k], np.arctan2(v[:, 0], v[:, 1]), atol=1e-6)
    np.testing.assert_allclose(tracks.pixel_m[0], 40.0 / 1200.0, rtol=0.5)


@pytest.mark.parametrize("parameter", [YAW, PITCH, ROLL, EAST, NORTH, HEIGHT, OFFSET, LAG])
@pytest.mark.parametrize("at", [0.0, 0.02])
def test_jacobian_is_the_derivative(parameter, at):
    kept, _ = history()
    theta = np.full(THETA, at) * (np.arange(THETA) < OFFSET)
    # δ is a difference over 20 ms by itself
    h = 0.02 if parameter in (OFFSET, LAG) else 1e-5
    step = np.zeros(THETA)
    step[parameter] = h
    low, high = ground_tracks(kept, 0, theta, np.arange(4)), ground_tracks(kept, 0, theta + step, np.arange(4))
    # the camera's speed is known after a moment
    derivative = ((high.p - low.p) / h)[10:]
    np.testing.assert_allclose(derivative, low.jacobian[10:, ..., parameter], rtol=2e-2, atol=0.6)


def test_yaw_turns_clockwise():
    view = camera()
    straight = rays_to_ground(np.array([[0.0, -0.5, 1.0]]), view.R_enu_cam, view.p_enu, 0.0, np.zeros(THETA))
    np.testing.assert_allclose(straight, [[0.0, 20.0]], atol=1e-9)
    theta = np.zeros(THETA)
    theta[YAW] = np.pi / 2
    turned = rays_to_ground(np.array([[0.0, -0.5, 1.0]]), view.R_enu_cam, view.p_enu, 0.0, theta)
    np.testing.assert_allclose(turned, [[20.0, 0.0]], atol=1e-9)


def test_rays_to_the_sky_hit_nothing():
    view = camera()
    up = np.array([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [np.nan, 0.0, 1.0]])
    assert np.isnan(rays_to_ground(up, view.R_enu_cam, view.p_enu, 0.0, np.zeros(THETA))).all()


def test_off_axis_is_zero_on_the_ray():
    view, rays = camera(), np.array([[0.1, 0.2, 1.0], [-0.3, 0.0, 1.0]])
    p = rays_to_ground(rays, view.R_enu_cam, view.p_enu, 0.0, np.zeros(THETA))
    angles = angles_to_places(rays, p, view.R_enu_cam, view.p_enu, 0.0, np.zeros(THETA))
    np.testing.assert_allclose(np.diagonal(angles), 0.0, atol=1e-9)
    assert angles[0, 1] > 0.2


def test_history_keeps_a_window_and_thins():
    kept, fleet = TrackHistory(2.0, 0.09, 0.6), Fleet()
    rng = np.random.default_rng(0)
    for k in range(600):
        t = k / 30
        kept.append(t, fleet.observation(t, camera(), [1, 2, 3, 4], rng), camera())
    t = kept.t[: kept.n]
    assert np.all(np.diff(t) > 0)
    assert t[-1] == pytest.approx(599 / 30) and t[-1] - t[0] >= 2.0
    assert np.median(np.diff(t)) == pytest.approx(0.1, abs=0.01)
    assert kept.release(30.0).tolist() == [0, 1, 2, 3]


def flown(seconds=6.0, speed_mps=6.0):
    """A camera that flies to and fro above vehicles, and is reported half a second late."""
    fleet, rng = Fleet(), np.random.default_rng(0)
    kept = TrackHistory(20.0, 0.09, 0.6)
    for k in range(round(seconds * 10)):
        t = k / 10
        place, late = (speed_mps * (3.0 - abs(3.0 - (s % 6.0))) for s in (t, t - 0.5))
        seen = fleet.observation(t, camera(p=(place, 0.0, 40.0)), [1, 2, 3, 4], rng, pixel=0.0)
        kept.append(t, seen, camera(p=(late, 0.0, 40.0)))
    return kept, fleet


def test_positions_that_are_late_are_moved_on():
    kept, fleet = flown()
    theta = np.zeros(THETA)
    assert np.abs(ground_tracks(kept, 0, theta, np.arange(4)).p[20] - fleet.at(2.0)[0]).max() > 2.5
    theta[LAG] = 0.5
    tracks = ground_tracks(kept, 0, theta, np.arange(4))
    np.testing.assert_allclose(tracks.p[20], fleet.at(2.0)[0], atol=1e-6)
    np.testing.assert_allclose(tracks.p[45], fleet.at(4.5)[0], atol=1e-6)


def test_where_the_camera_was_before_its_first_report_or_will_be_is_not_guessed():
    kept, _ = flown()
    theta = np.zeros(THETA)
    theta[LAG] = 1.2
    ahead = ground_tracks(kept, 0, theta, np.arange(4))
    assert np.isfinite(ahead.p[:45]).all() and np.isnan(ahead.p[-5:]).all()
    theta[LAG], theta[OFFSET] = 0.0, 2.0
    before = ground_tracks(kept, 0, theta, np.arange(4))
    assert np.isnan(before.p[:15]).all() and np.isfinite(before.p[25:]).all()
    assert np.isfinite(before.jacobian[25:]).all()


@pytest.mark.parametrize("offset_s", [0.0, 0.05, 2.0, -0.3])
def test_the_camera_of_a_frame_is_dated_by_the_clock_that_was_found(offset_s):
    kept, _ = history(yaw_rate=0.1)
    t = 2.5
    reported = camera(p=(1.5 * t, -t, 40.0 + 0.2 * t), yaw=0.1 * t)
    found, there_s = camera_at_frame(kept, t, reported, offset_s), t - offset_s
    np.testing.assert_allclose(found.p_enu, (1.5 * there_s, -there_s, 40.0 + 0.2 * there_s), atol=0.12)
    np.testing.assert_allclose(found.R_enu_cam, camera(yaw=0.1 * there_s).R_enu_cam, atol=1e-3)
