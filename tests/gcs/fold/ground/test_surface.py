"""A sloping ground as a camera sees it that takes it for level."""

import tomllib
from dataclasses import replace

import numpy as np
import pytest

from gcs.fold.camera.frame_cameras import FrameCameras
from gcs.fold.ground.surface import GroundSurface
from gcs.mission.mission import parse_mission
from tests.support.films.board_video import write_geotiff
from tests.support.flights import World
from vision.camera.camera import CameraPose, Mount, camera_pose, ground, project
from vision.camera.intrinsics import Intrinsics

LENS = Intrinsics(width=1920, height=1080, fx=1400, fy=1400, cx=960, cy=540, distortion=np.zeros(5))
IDS = np.array([11, 12, 13])
SLOPE = GroundSurface(at=np.array([10.0, 40.0]), z=3.0, slope=np.array([0.08, -0.05]), std_m=1.0)
NORTH = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])


def camera(pitch_deg) -> CameraPose:
    mount = Mount(kind="stabilized", roll=0.0, pitch=np.radians(pitch_deg), yaw=0.0)
    return camera_pose(mount, np.array([5.0, -3.0, 50.0]), NORTH)


@pytest.mark.parametrize("pitch_deg", [-90.0, -45.0, -30.0])
def test_a_place_on_a_slope_appears_where_its_pixel_meets_the_level_plane(pitch_deg):
    pose = camera(pitch_deg)
    centre = ground(LENS, pose, np.array([[960.0, 540.0]]), SLOPE.z)[0, :2]
    p = centre + np.array([[0.0, 0.0], [8.0, 5.0], [-10.0, 9.0]])
    places = np.column_stack([p, SLOPE.height_at(p)])
    uv, ahead = project(LENS, pose, places)
    level = ground(LENS, pose, uv, SLOPE.z)
    assert ahead.all()
    np.testing.assert_allclose(SLOPE.seen_on_level(places, IDS, pose.p_enu), level, atol=1e-6)
    np.testing.assert_allclose(SLOPE.below_level(level, pose.p_enu), places, atol=1e-4)


def test_each_report_is_seen_from_where_the_camera_was():
    cameras = np.array([[0.0, 0.0, 50.0], [20.0, 0.0, 60.0]])
    places = np.array([[30.0, 10.0, 99.0], [30.0, 10.0, -99.0]])
    both = SLOPE.seen_on_level(places, IDS[:2], cameras)
    for k in range(2):
        np.testing.assert_allclose(both[k], SLOPE.seen_on_level(places[k : k + 1], IDS[:1], cameras[k])[0])


def test_a_vehicle_on_a_bump_appears_farther_away():
    bumpy = replace(SLOPE, slope=np.zeros(2), bumps={12: 5.0})
    places = np.array([[30.0, 0.0, 0.0], [30.0, 0.0, 0.0]])
    seen = bumpy.seen_on_level(places, IDS[:2], np.array([0.0, 0.0, 53.0]))
    # 50 m above the level, 45 m above the bump
    np.testing.assert_allclose(seen[:, 0], [30.0, 30.0 * 50.0 / 45.0])


def test_level_ground_is_where_it_is():
    level = GroundSurface(at=np.zeros(2), z=3.0, slope=np.zeros(2), std_m=1.0)
    places = np.array([[30.0, 10.0, 3.0], [-5.0, 90.0, 3.0]])
    np.testing.assert_allclose(level.seen_on_level(places, IDS[:2], np.array([0.0, 0.0, 40.0])), places)
    np.testing.assert_allclose(level.below_level(places, np.array([0.0, 0.0, 40.0])), places)


def cameras_with(terrain):
    lens = "{width = 1920, height = 1080, fx = 1400.0, fy = 1400.0, cx = 960.0, cy = 540.0}"
    text = f'uav.system_id = 1\nmap.terrain = "{terrain}"\ncamera = {lens}\n[[ugv]]\nsystem_id = 11'
    world = World(rovers=1)
    return FrameCameras(parse_mission(tomllib.loads(text), "")), world.fleet.at(world.run(2)), world.fleet.origin


def test_a_terrain_file_that_cannot_be_read_is_told_once_and_done_without(tmp_path):
    cameras, state, frame = cameras_with(tmp_path / "gone.tif")
    (event,) = cameras.follow_ground(state, frame)
    assert event.level == "warning" and event.text == (
        f"{tmp_path}/gone.tif: no such file; [map] terrain needs a GeoTIFF of elevations; "
        "the ground's height is found without it"
    )
    assert not cameras.follow_ground(state, frame)


def test_the_missions_terrain_file_shapes_the_ground(tmp_path):
    rows = 528.0 + 0.1 * 11.1 * np.arange(100, 0, -1)[:, None] * np.ones((1, 100))  # 10 % up to the north
    path = write_geotiff(tmp_path / "a.tif", rows.astype(np.float32), (149.16, -35.358), (0.0001, 0.0001))
    cameras, state, frame = cameras_with(path)
    assert not cameras.follow_ground(state, frame)
    view, _ = cameras.at(state, None)
    up, down = view.ground.height_at(np.array([[0.0, 50.0], [0.0, -50.0]]))
    assert up - down == pytest.approx(10.0, abs=0.1)
