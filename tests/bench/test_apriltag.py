"""Tags on roofs: drawn where the geometry says, read from near, not from afar, and counted rightly."""

from __future__ import annotations

import csv
from dataclasses import replace

import cv2
import numpy as np
import pytest

from bench.apriltag.case import TagCase, TagCount, TagOutcome
from bench.apriltag.flight import CAMERAS, DIAGONAL_DEG, SIDES_M, camera_of, render_frame, scenario_of, tags_of
from bench.apriltag.suite import cases
from bench.apriltag.tables import METHODS, report, shares, write_csv
from bench.apriltag.tags import Tag, draw_tags, read_image, read_tags, tag_corners
from sim.render.ground import GroundStyle
from sim.render.render import Renderer, Style
from sim.world.boxes import in_image, true_boxes
from sim.world.view import UGV, Bodies, CameraView, project
from sim.world.world import World

DOWN = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]])


def straight_down(height_m, f=1200.0):
    return CameraView(
        width=640, height=480, fx=f, fy=f, cx=320.0, cy=240.0, distortion=np.zeros(5), R_enu_cam=DOWN,
        p_enu=np.array([0.0, 0.0, height_m]),
    )  # fmt: skip


def one_rover(heading=0.7, x=0.4, y=-0.3):
    return Bodies(
        kind=np.array([UGV], np.int8),
        x=np.array([x]),
        y=np.array([y]),
        heading=np.array([heading]),
        length=np.array([2.2]),
        width=np.array([1.4]),
        height=np.array([0.9]),
        color=np.full((1, 3), 90, np.uint8),
    )


def seen_by_opencv(image):
    """Corners (4, 2) by number, in continuous pixels."""
    family = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    settings = cv2.aruco.DetectorParameters()
    settings.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    corners, numbers, _ = cv2.aruco.ArucoDetector(family, settings).detectMarkers(image)
    return {int(n): c[0] + 0.5 for n, c in zip([] if numbers is None else numbers.ravel(), corners, strict=True)}


@pytest.mark.parametrize("heading", [0.0, 0.7, 3.0, 5.1])
def test_opencv_finds_the_corners_where_they_are_projected(heading):
    view, bodies, tag = straight_down(9.0), one_rover(heading), Tag(body=0, number=77, side_m=0.5)
    image = draw_tags(np.full((480, 640, 3), 110, np.uint8), view, bodies, [tag])
    expected, _ = project(view, tag_corners(bodies, tag, 0.5))
    # front left, front right, rear right, rear left: as the tag is printed with its upper edge to the front
    np.testing.assert_allclose(seen_by_opencv(image)[77], expected, atol=0.6)


def test_a_tag_covers_its_plate_and_nothing_else():
    view, bodies, tag = straight_down(20.0), one_rover(), Tag(body=0, number=5, side_m=0.3)
    before = np.full((480, 640, 3), 110, np.uint8)
    after = draw_tags(before, view, bodies, [tag])
    changed = (after != before).any(axis=-1)
    # side of the plate with its rim: 10/8 of 0.3 m, 19.1 m below the camera
    side = 0.375 * 1200.0 / 19.1
    assert changed.sum() == pytest.approx(side**2, rel=0.15)
    assert (before == 110).all()
    v, u = np.nonzero(changed)
    (middle,), _ = project(view, [[0.4, -0.3, 0.9]])
    assert np.hypot(u + 0.5 - middle[0], v + 0.5 - middle[1]).max() <= side / np.sqrt(2) + 1.5


def test_a_tag_that_is_not_wholly_in_the_image_is_left_out():
    view = straight_down(9.0)
    before = np.full((480, 640, 3), 110, np.uint8)
    after = draw_tags(before, view, one_rover(x=2.15, y=0.0), [Tag(body=0, number=5, side_m=0.5)])
    np.testing.assert_array_equal(after, before)


@pytest.fixture(scope="module")
def looks():
    """Tags in view, what is read of each and in the whole image, by height; one moment, JPEG for H.264."""
    rows = {}
    for height_m in (10.0, 120.0):
        scenario = scenario_of("1080p", height_m, 1.0, 2.0)
        world = World(scenario)
        # a smaller sheet of ground than films have is painted sooner
        renderer = Renderer(world.scene, Style(ground=GroundStyle(side_px=1024)))
        image = render_frame(world, renderer, 0.5, 0)
        image = cv2.imdecode(cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 85])[1], cv2.IMREAD_COLOR)
        view, bodies = world.view(0.5), world.bodies(0.5)
        boxes = true_boxes(view, bodies)
        table = np.column_stack([boxes.cx, boxes.cy, boxes.w, boxes.h])
        whole = in_image(view, boxes) & (np.minimum(boxes.cx, view.width - boxes.cx) > boxes.w / 2)
        whole &= np.minimum(boxes.cy, view.height - boxes.cy) > boxes.w / 2
        tags = [tag for tag in tags_of(scenario) if whole[tag.body]]
        rows[height_m] = (tags, read_tags(image, table[[tag.body for tag in tags]]), read_image(image))
    return rows


def test_from_ten_metres_every_tag_is_read_with_its_number(looks):
    tags, read, whole = looks[10.0]
    assert {tag.side_m for tag in tags} == set(SIDES_M)
    assert [set(numbers) for numbers in read] == [{tag.number} for tag in tags]
    assert {tag.number for tag in tags} <= whole


def test_from_a_hundred_and_twenty_metres_none_is(looks):
    tags, read, whole = looks[120.0]
    assert len(tags) == 7
    assert not any(read)
    assert not whole


@pytest.mark.parametrize("name", CAMERAS)
def test_cameras_have_the_field_of_view_they_claim(name):
    camera = camera_of(name)
    half = np.arctan(np.hypot(camera.width / 2, camera.height / 2) / camera.fx)
    assert np.degrees(2 * half) == pytest.approx(DIAGONAL_DEG)


def outcome(height_m=40.0, camera="1080p", **change):
    tags = tuple(
        TagCount(side_m=s, boxes=10, plain=r // 2, read=r, known=10, wrong=0)
        for s, r in zip(SIDES_M, (2, 8), strict=True)
    )
    base = TagOutcome(
        case=TagCase(camera=camera, height_m=height_m, duration_s=5.0, fps=4.0), vehicle_px=70.0, tags=tags,
        boxes=20, right=18, named=20, late_boxes=10, late_right=10,
    )  # fmt: skip
    return replace(base, **change)


def test_shares_are_of_the_boxes_in_view(tmp_path):
    got = shares(outcome())
    assert [got[name] for name in METHODS] == [0.1, 0.2, 1.0, 0.4, 0.8, 1.0, 0.9, 1.0]
    write_csv([outcome()], tmp_path / "a.csv")
    with (tmp_path / "a.csv").open() as file:
        (row,) = csv.DictReader(file)
    assert (row["camera"], row["height_m"], float(row["product"]), float(row["wrong of names"])) == (
        "1080p",
        "40",
        0.9,
        0.1,
    )


def test_the_report_says_up_to_where_tags_are_read():
    far = outcome(120.0, tags=tuple(TagCount(side_m=s, boxes=10, plain=0, read=0, known=0, wrong=0) for s in SIDES_M))
    text = report([outcome(), far], quick=False)
    start = "are read in at least half of the frames plain at none of these heights, in crops"
    assert f"Tags of 0.3 m {start} at none of these heights." in text
    assert f"Tags of 0.5 m {start} up to 40 m." in text
    nobody = outcome(tags=tuple(TagCount(side_m=s, boxes=0, plain=0, read=0, known=0, wrong=0) for s in SIDES_M))
    assert "| – | – | – | – | – | – | 90.0 |" in report([nobody], quick=True)


def test_a_quick_run_is_a_part_of_the_whole():
    whole, quick = cases(False), cases(True)
    assert {(c.camera, c.height_m) for c in quick} < {(c.camera, c.height_m) for c in whole}
    assert {c.camera for c in whole} == set(CAMERAS)
    assert (min(c.height_m for c in whole), max(c.height_m for c in whole)) == (10.0, 120.0)
