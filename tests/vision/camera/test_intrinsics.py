"""Intrinsics for other sizes and zooms, from fields of view, and out of files; OpenCV is the oracle."""

import math
import os
import re

import cv2
import numpy as np
import pytest

from vision.camera.camera import Mount, camera_pose, ground, image_warp, project
from vision.camera.intrinsics import Intrinsics, from_field_of_view, resized, zoomed
from vision.camera.lens_file import lens_text, read_lens
from vision.errors import CameraError

LENS = np.array([-0.21, 0.06, 0.0011, -0.0007, -0.008])
CAMERA = Intrinsics(width=1920, height=1080, fx=1310.0, fy=1304.0, cx=948.5, cy=551.0, distortion=LENS)
POINTS = np.random.default_rng(5).uniform((-1, -0.5, 2), (1, 0.5, 3), (50, 3))


def opencv_pixels(camera, points):
    """In our pixels, which count from the corner of the first one."""
    K = camera.K
    K[:2, 2] -= 0.5
    return cv2.projectPoints(points, np.zeros(3), np.zeros(3), K, camera.distortion)[0][:, 0] + 0.5


def test_resized_image_shows_the_same_at_the_same_share_of_it():
    half = resized(CAMERA, 960, 540)
    np.testing.assert_allclose(opencv_pixels(half, POINTS), opencv_pixels(CAMERA, POINTS) / 2, atol=1e-9)
    np.testing.assert_allclose(half.pixels(POINTS)[0], CAMERA.pixels(POINTS)[0] / 2, atol=1e-9)
    assert resized(CAMERA, 1920, 1080) is CAMERA
    assert resized(CAMERA, 854, 480).width == 854  # rounded to whole pixels by the codec


@pytest.mark.parametrize("size", [(1440, 1080), (1080, 1920), (1920, 1200)])
def test_image_of_another_aspect_is_refused(size):
    with pytest.raises(CameraError, match=f"images of 1920×1080, these are {size[0]}×{size[1]}.*calibrate"):
        resized(CAMERA, *size)


def test_digital_zoom_is_the_middle_of_the_image_enlarged():
    """Cut the middle half out of a drawn image, enlarge it, and look where its points are."""
    near = CAMERA.pixels(POINTS)[0]
    cut = (near - (480.0, 270.0)) * 2.0
    np.testing.assert_allclose(zoomed(CAMERA, 2.0).pixels(POINTS)[0], cut, atol=1e-9)
    np.testing.assert_allclose(opencv_pixels(zoomed(CAMERA, 2.0), POINTS), cut, atol=1e-9)
    assert zoomed(CAMERA, 1.0) is CAMERA


def test_zoom_between_two_images_moves_the_ground_as_projection_does():
    pose = camera_pose(Mount(), [0.0, 0.0, 40.0], np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1.0]]))
    plain = Intrinsics(width=1920, height=1080, fx=1200, fy=1200, cx=950, cy=545)
    later = zoomed(plain, 1.7)
    uv = np.random.default_rng(1).uniform((600, 300), (1300, 800), (9, 2))
    moved = np.c_[uv, np.ones(9)] @ image_warp(plain, pose, pose, 0.0, intrinsics_to=later).T
    expected, _ = project(later, pose, ground(plain, pose, uv, 0.0))
    np.testing.assert_allclose(moved[:, :2] / moved[:, 2:], expected, atol=1e-6)


def test_fields_of_view_make_the_focal_lengths():
    camera, both = from_field_of_view(1920, 1080, math.radians(62.0), math.radians(37.4))
    assert both
    np.testing.assert_allclose(camera.rays([[0.0, 540.0], [960.0, 0.0]])[:, 2], np.cos(np.radians([31.0, 18.7])))
    assert camera.hfov == pytest.approx(math.radians(62.0))


@pytest.mark.parametrize(
    ("hfov", "vfov"),
    [(62.0, 48.5), (62.0, math.nan), (math.nan, 2 * math.degrees(math.atan(540 / 960 * math.tan(math.radians(31.0)))))],
    ids=["height of a photograph", "no height", "no width"],
)
def test_one_field_of_view_makes_square_pixels(hfov, vfov):
    camera, both = from_field_of_view(1920, 1080, math.radians(hfov), math.radians(vfov))
    assert not both
    assert camera.fx == camera.fy == pytest.approx(960 / math.tan(math.radians(31.0)), rel=1e-4)


def test_own_file_reads_back_exactly(tmp_path):
    (tmp_path / "lens.toml").write_text(lens_text(CAMERA, {"rms_px": 0.2}))
    again = read_lens(tmp_path / "lens.toml")
    assert (again.width, again.height, again.fx, again.fy, again.cx, again.cy) == (1920, 1080, 1310, 1304, 948.5, 551)
    np.testing.assert_array_equal(again.distortion, LENS)


def test_file_that_opencv_wrote_is_the_same_camera(tmp_path):
    K = CAMERA.K
    K[:2, 2] -= 0.5
    storage = cv2.FileStorage(str(tmp_path / "lens.yml"), cv2.FILE_STORAGE_WRITE)
    for name, value in {
        "image_width": 1920,
        "image_height": 1080,
        "camera_matrix": K,
        "distortion_coefficients": LENS,
    }.items():
        storage.write(name, value)
    storage.release()
    again = read_lens(tmp_path / "lens.yml")
    np.testing.assert_allclose(again.pixels(POINTS)[0], CAMERA.pixels(POINTS)[0], atol=1e-9)


ROS = """image_width: 1920
image_height: 1080
camera_name: nadir
camera_matrix:
  rows: 3
  cols: 3
  data: [1310.0, 0.0, 948.0, 0.0, 1304.0, 550.5, 0.0, 0.0, 1.0]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [-0.21, 0.06, 0.0011, -0.0007, -0.008]
"""


def in_blocks(text):
    """The same with a line for each number, not indented, as PyYAML and the tools on it write lists."""
    return re.sub(r"  data: \[(.*)\]", lambda found: "  data:\n  - " + found[1].replace(", ", "\n  - "), text)


@pytest.mark.parametrize("write", [str, in_blocks, "# from a calibration tool\n{}".format, "%YAML 1.1\n---\n{}".format])
def test_camera_info_of_ros_is_the_same_camera(write, tmp_path):
    (tmp_path / "info.yaml").write_text(write(ROS))
    again = read_lens(tmp_path / "info.yaml")
    np.testing.assert_allclose(again.pixels(POINTS)[0], CAMERA.pixels(POINTS)[0], atol=1e-9)


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.toml", "[width", "not valid TOML"),
        ("a.toml", "width = 1920\n", "height is missing"),
        ("a.toml", "width = 1920\nheight = 1080\nfx = 'wide'\nfy = 1\ncx = 1\ncy = 1\n", "fx is 'wide'; a number"),
        ("a.toml", "breadth = 1920\n", "unknown key 'breadth'; known are width"),
        ("a.toml", "width = 10\nheight = 10\nfx = 0\nfy = 1\ncx = 1\ncy = 1\n", "must be positive"),
        ("a.toml", "width = 10\nheight = 10\nfx = 1\nfy = 1\ncx = 1\ncy = 1\ndistortion = [1]\n", "five numbers"),
        ("a.toml", "width = 10\nheight = 10\nfx = 1\nfy = 1\ncx = 1\ncy = 1\ndistortion = 'k'\n", "five numbers"),
        ("a.toml", "width = 9e18\nheight = 10\nfx = 1\nfy = 1\ncx = 1\ncy = 1\n", "number of pixels"),
        ("a.toml", "width = inf\nheight = 10\nfx = 1\nfy = 1\ncx = 1\ncy = 1\n", "width is inf; a number"),
        pytest.param("a.yaml", "a: " + "[" * 100_000, "not YAML", marks=pytest.mark.slow),  # for seconds
        ("a.yaml", "a: " + "]" * 9000 + "[" * 100_000, "not YAML"),
        ("a.yaml", "a: " + "{a: " * 60_000, "not YAML"),
        ("a.yaml", "a:\n  " + "- " * 100_000, "not YAML"),
        ("a.yaml", "a: " * 80_000, "not YAML"),
        ("a.yaml", "just text", "not YAML"),
        ("a.yaml", ROS.replace("plumb_bob", "equidistant"), "'equidistant' is not supported"),
        ("a.yaml", ROS.replace("-0.008]", "-0.008, 0.0, 0.0, 0.3]"), "has 8 distortion coefficients"),
        ("a.yaml", ROS.replace("image_width", "image_breadth"), "needs camera_matrix"),
        ("a.yaml", ROS.replace("948.0, 0.0, 1304.0", ".nan, 0.0, 1304.0"), "cx is nan; a number"),
        ("a.yaml", ROS.replace("948.0, 0.0", "wide, 0.0"), "needs camera_matrix"),
        ("a.yaml", "camera_matrix: [", "not YAML that can be read: while parsing"),
        ("a.yaml", "!!python/object/apply:os.system [true]", "not YAML that can be read: could not determine"),
    ],
)
def test_files_of_no_camera_say_what_is_wrong(tmp_path, name, text, message):
    (tmp_path / name).write_text(text)
    with pytest.raises(CameraError, match=message) as refused:
        read_lens(tmp_path / name)
    assert str(tmp_path / name) in str(refused.value)


def test_missing_and_binary_files(tmp_path):
    os.mkfifo(tmp_path / "p.toml")
    with pytest.raises(CameraError, match="cannot be read"):
        read_lens(tmp_path / "p.toml")
    with pytest.raises(CameraError, match="no such file; gcs calibrate makes one"):
        read_lens(tmp_path / "absent.toml")
    (tmp_path / "b.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(CameraError, match="cannot be read as text"):
        read_lens(tmp_path / "b.toml")


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("lens.yaml", "a: &a [1, 2]\nb: &b [*a, *a]\nimage_width: *b\nimage_height: 3\n"),
        ("lens.yaml", "image_width: &a [*a]\n"),
        ("lens.toml", "width = 1" + "0" * 400 + "\nheight = 1\nfx = 1.0\nfy = 1.0\ncx = 1.0\ncy = 1.0\n"),
        ("lens.toml", "width = 9e18\nheight = 1\nfx = 1.0\nfy = 1.0\ncx = 1.0\ncy = 1.0\n"),
        ("lens.toml", "width = 9\nheight = 1\nfx = 1" + "0" * 400 + "\nfy = 1.0\ncx = 1.0\ncy = 1.0\n"),
    ],
)
def test_values_that_grow_and_numbers_without_end_are_one_line(name, text, tmp_path):
    (tmp_path / name).write_text(text)
    with pytest.raises(CameraError, match=name) as caught:
        read_lens(tmp_path / name)
    assert len(str(caught.value)) < 1000
