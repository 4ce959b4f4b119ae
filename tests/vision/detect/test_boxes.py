"""Oriented boxes: overlap against OpenCV, symmetries, suppression, letterbox there and back."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vision.detect.boxes import canonical, corners, hull, nms, prob_iou, rotated_iou, wrap
from vision.detect.detections import Detections
from vision.detect.letterbox import Letterbox, letterbox

MODEST = settings(max_examples=60, deadline=None)
SIDE = st.floats(2.0, 80.0)
BOX = st.tuples(st.floats(0, 60), st.floats(0, 60), SIDE, SIDE, st.floats(-4, 4))
BOXES = st.lists(BOX, min_size=1, max_size=5).map(np.array)


def opencv_iou(a, b):
    ring_a, ring_b = (corners(box).astype(np.float32) for box in (a, b))
    area, _ = cv2.intersectConvexConvex(ring_a, ring_b)
    return area / (a[2] * a[3] + b[2] * b[3] - area)


def row(cx=0.0, cy=0.0, w=40.0, h=20.0, angle=0.0):
    return np.array([[cx, cy, w, h, angle]])


def test_rotated_iou_agrees_with_opencv():
    # drawn at random, so that no edges lie on one line: there OpenCV loses the polygon
    rng = np.random.default_rng(7)
    a, b = (rng.uniform((0, 0, 2, 2, -4), (60, 60, 80, 80, 4), (25, 5)) for _ in range(2))
    expected = [[opencv_iou(x, y) for y in b] for x in a]
    np.testing.assert_allclose(rotated_iou(a, b), expected, atol=1e-5)


@pytest.mark.slow_but_first
@MODEST
@given(BOXES, BOXES)
@pytest.mark.parametrize("measure", [rotated_iou, prob_iou])
def test_overlap_is_bounded_and_symmetric(measure, a, b):
    iou = measure(a, b)
    assert iou.shape == (len(a), len(b))
    assert ((iou >= 0) & (iou <= 1)).all()
    np.testing.assert_allclose(iou, measure(b, a).T, atol=1e-9)
    # a box is itself, also when its sides are named the other way round; square roots near zero cost digits
    np.testing.assert_allclose(np.diag(measure(a, canonical(a))), 1.0, atol=1e-6)


@MODEST
@given(BOXES, BOXES, st.floats(-3, 3), st.floats(-100, 100))
@pytest.mark.parametrize("measure", [rotated_iou, prob_iou])
def test_overlap_does_not_depend_on_where_one_stands(measure, a, b, turn, shift):
    c, s = np.cos(turn), np.sin(turn)

    def moved(rows):
        out = rows.copy()
        out[:, :2] = rows[:, :2] @ np.array([[c, s], [-s, c]]) + shift
        out[:, 4] += turn
        return out

    np.testing.assert_allclose(measure(moved(a), moved(b)), measure(a, b), atol=1e-6)


def test_known_overlaps():
    assert rotated_iou(row(), row(cx=20.0))[0, 0] == pytest.approx(1 / 3)
    assert rotated_iou(row(w=20), row(w=20, angle=np.pi / 2))[0, 0] == pytest.approx(1.0)
    assert rotated_iou(row(w=40, h=40), row(w=20, h=20, angle=0.3))[0, 0] == pytest.approx(0.25)
    assert rotated_iou(row(w=31, h=2, angle=1.0), row(w=2, h=2, angle=1.0))[0, 0] == pytest.approx(4 / 62)
    assert rotated_iou(row(), row(cx=50))[0, 0] == 0.0
    assert rotated_iou(row(w=0, h=0), row(w=0, h=0))[0, 0] == 0.0
    assert prob_iou(row(), row(cx=50))[0, 0] > 0.0


def test_no_boxes_give_empty_matrices():
    none = np.empty((0, 5))
    assert rotated_iou(none, row()).shape == prob_iou(none, row()).shape == (0, 1)
    assert nms(none, []).tolist() == []


def test_boxes_of_a_wrong_shape_are_refused():
    with pytest.raises(ValueError, match=r"\(m, 5\)"):
        rotated_iou(np.zeros((2, 4)), row())


def test_nms_keeps_the_best_and_the_neighbours():
    boxes = np.concatenate([row(), row(cx=2.0, angle=0.05), row(cy=25.0), row(cx=1.0, angle=np.pi)])
    assert nms(boxes, [0.5, 0.9, 0.4, 0.8]).tolist() == [1, 2]


@MODEST
@given(BOXES, st.randoms(use_true_random=False))
def test_nms_leaves_no_overlap_and_ignores_order(boxes, random):
    score = np.linspace(0.3, 0.9, len(boxes))
    kept = nms(boxes, score, 0.3)
    overlap = prob_iou(boxes[kept], boxes[kept]) - np.eye(len(kept))
    assert (overlap <= 0.3 + 1e-9).all()
    order = np.array(random.sample(range(len(boxes)), len(boxes)))
    assert order[nms(boxes[order], score[order], 0.3)].tolist() == kept.tolist()


def test_corners_run_clockwise_from_top_left():
    np.testing.assert_allclose(corners(row())[0], [[-20, -10], [20, -10], [20, 10], [-20, 10]])
    # a quarter turn clockwise on screen brings the top left corner to the top right
    np.testing.assert_allclose(corners(row(angle=np.pi / 2))[0, 0], [10, -20], atol=1e-12)
    np.testing.assert_allclose(hull(row(angle=np.pi / 2))[0], [-10, -20, 10, 20], atol=1e-12)


@MODEST
@given(BOXES)
def test_canonical_is_the_same_rectangle(boxes):
    same = canonical(boxes)
    assert (same[:, 2] >= same[:, 3]).all()
    assert ((same[:, 4] >= -np.pi / 2) & (same[:, 4] < np.pi / 2)).all()
    np.testing.assert_allclose(hull(same), hull(boxes), atol=1e-9)
    np.testing.assert_allclose(canonical(same), same)


def test_wrap_is_half_open():
    np.testing.assert_allclose(wrap([np.pi, -np.pi, 3 * np.pi / 2]), [-np.pi, -np.pi, -np.pi / 2])


@MODEST
@given(st.integers(1, 4000), st.integers(1, 4000), BOXES)
def test_letterbox_is_undone_to_sub_pixel(width, height, boxes):
    fit = Letterbox.fit((width, height), (640, 640))
    canvas = boxes.copy()
    canvas[:, :2] = boxes[:, :2] * (fit.scale_x, fit.scale_y) + (fit.left, fit.top)
    canvas[:, 2:4] *= np.sqrt(fit.scale_x * fit.scale_y)
    np.testing.assert_allclose(fit.undo_boxes(canvas), boxes, atol=1e-9)
    np.testing.assert_allclose(fit.undo_points(canvas[:, :2]), boxes[:, :2], atol=1e-9)


def test_letterbox_shows_a_square_where_it_says():
    image = np.zeros((540, 960, 3), dtype=np.uint8)
    image[200:260, 300:360] = 255
    image = cv2.GaussianBlur(image, (0, 0), 3.0)
    canvas, fit = letterbox(image, (640, 640))
    assert canvas.shape == (640, 640, 3) and canvas[0, 0, 0] == 114
    weight = (canvas[fit.top : 640 - fit.top, :, 0]).astype(float)
    y, x = np.mgrid[0 : weight.shape[0], 0 : weight.shape[1]]
    centre = np.array([(weight * (x + 0.5)).sum(), (weight * (y + fit.top + 0.5)).sum()]) / weight.sum()
    np.testing.assert_allclose(fit.undo_points(centre), [330.0, 230.0], atol=0.05)


def test_letterbox_leaves_a_fitting_image_alone():
    image = np.arange(64 * 64 * 3, dtype=np.uint8).reshape(64, 64, 3)
    canvas, fit = letterbox(image, (64, 64))
    np.testing.assert_array_equal(canvas, image)
    assert (fit.scale_x, fit.scale_y, fit.left, fit.top) == (1.0, 1.0, 0, 0)


def sample(**change):
    columns = {name: np.array([1.0, 2.0]) for name in ("cx", "cy", "w", "h", "angle", "score", "heading")}
    return {**columns, **change}


def test_detections_are_read_only_copies():
    cx = np.array([1.0, 2.0])
    boxes = Detections(**sample(cx=cx))
    cx[0] = 99.0
    assert boxes.cx[0] == 1.0
    with pytest.raises(ValueError, match="read-only"):
        boxes.cx[0] = 5.0


def test_detections_take_by_index_and_by_mask():
    boxes = Detections(**sample(heading=np.array([np.nan, 1.0])))
    assert boxes.select([1]).heading.tolist() == [1.0]
    assert len(boxes.select(np.array([True, False]))) == 1
    assert len(boxes.select([])) == len(Detections.empty()) == 0
    assert Detections.empty().corners().shape == (0, 4, 2)
    assert boxes.centre.shape == (2, 2)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"w": np.array([1.0])}, "one length"),
        ({"w": np.ones((2, 1))}, r"shape \(m,\)"),
        ({"cy": np.array([np.inf, 0.0])}, "finite"),
        ({"h": np.array([-1.0, 1.0])}, "negative"),
    ],
)
def test_broken_detections_are_refused(change, message):
    with pytest.raises(ValueError, match=message):
        Detections(**sample(**change))
