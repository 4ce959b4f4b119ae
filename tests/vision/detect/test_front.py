from __future__ import annotations

import hashlib

import cv2
import numpy as np
import pytest

from sim.render.ground import GroundStyle
from sim.render.render import Renderer, Style
from sim.world.boxes import true_boxes
from sim.world.view import OTHER_VEHICLE, UGV, Bodies, CameraView, Scene
from tests.support.onnx_models import FLOAT16, brightest_side, classifier
from vision.detect.boxes import wrap
from vision.detect.detections import Detections
from vision.detect.front import BUNDLED_FRONT, FrontedDetector, open_front_classifier
from vision.errors import ModelError

SIDE = 16
GAIN = 6.0


def opened(tmp_path, classes=2, sure=0.8, **options):
    weights = GAIN * brightest_side(SIDE, classes)
    return open_front_classifier(classifier(tmp_path / "front.onnx", weights, SIDE, **options), sure=sure)


def vehicle(image, cx, cy, length, width, heading):
    """Grey, with a white nose: the fifth of it that is at the heading, clockwise from image up."""
    along = np.array([np.sin(heading), -np.cos(heading)])
    for middle, part, colour in ((0.0, 1.0, 90), (0.4, 0.2, 255)):
        x, y = np.array([cx, cy]) + middle * length * along - 0.5
        corners = cv2.boxPoints(((x, y), (part * length, width), np.degrees(heading) - 90.0))
        cv2.fillConvexPoly(image, np.rint(corners * 16).astype(np.int32), (colour,) * 3, cv2.LINE_AA, 4)


def parade(shape=(40.0, 18.0), n=24):
    """An image of n vehicles with headings all round, and their true rows cx, cy, length, width, heading."""
    image = np.full((480, 720, 3), 40, np.uint8)
    rows = []
    for k in range(n):
        row = (60.3 + 120 * (k % 6), 60.7 + 120 * (k // 6), *shape, 2 * np.pi * k / n + 0.05)
        vehicle(image, *row)
        rows.append(row)
    return image, np.array(rows)


class Axes:
    """A detector that knows where vehicles lie but no fronts; the ends are told by chance."""

    def __init__(self, rows, seed=0, across=False, heading=np.nan):
        rng = np.random.default_rng(seed)
        n = len(rows)
        turn = rng.integers(2, size=n) * np.pi + (rng.integers(2, size=n) * np.pi / 2 if across else 0.0)
        swapped = np.abs(np.sin(turn)) > 0.5
        w, h = np.where(swapped, rows[:, 3], rows[:, 2]), np.where(swapped, rows[:, 2], rows[:, 3])
        angle = wrap(rows[:, 4] - np.pi / 2 + turn)
        self.found = Detections(
            cx=rows[:, 0], cy=rows[:, 1], w=w, h=h, angle=angle, score=np.full(n, 0.9), heading=np.full(n, heading)
        )
        self.gsd_m = None

    def detect(self, image, *, gsd_m=None):
        self.gsd_m = gsd_m
        return self.found


@pytest.mark.parametrize("options", [{}, {"batch": 1}, {"batch": 5}, {"kind": FLOAT16}, {"classes": 4}])
def test_every_heading_is_told_whatever_the_batch_and_the_kind_of_number(tmp_path, options):
    image, rows = parade()
    inner = Axes(rows)
    found = FrontedDetector(inner, opened(tmp_path, **options)).detect(image, gsd_m=0.05)
    np.testing.assert_allclose(wrap(found.heading - rows[:, 4]), 0.0, atol=1e-9)
    np.testing.assert_allclose(wrap(found.heading - found.angle - np.pi / 2), 0.0, atol=1e-9)
    np.testing.assert_allclose(found.boxes[:, :4], rows[:, :4])
    assert inner.gsd_m == 0.05


def test_a_square_vehicle_whose_box_lies_across_is_turned_to_its_front(tmp_path):
    image, rows = parade(shape=(34.0, 30.0))
    found = FrontedDetector(Axes(rows, across=True), opened(tmp_path, classes=4)).detect(image)
    np.testing.assert_allclose(wrap(found.heading - rows[:, 4]), 0.0, atol=1e-9)
    np.testing.assert_allclose(wrap(found.angle + np.pi / 2 - rows[:, 4]), 0.0, atol=1e-9)
    np.testing.assert_allclose(found.boxes[:, 2:4], rows[:, 2:4])


def test_a_slim_box_never_has_its_front_at_a_longer_side(tmp_path):
    image = np.full((100, 100, 3), 40, np.uint8)
    image[30:50, 20:80] = 255  # the upper half of a box that lies along x is bright
    told = opened(tmp_path, classes=4, sure=0.0).classify(image, [[50.0, 50.0, 60.0, 40.0, 0.0]])
    assert abs(np.sin(told.heading[0])) == pytest.approx(1.0)
    told = opened(tmp_path, classes=4, sure=0.0).classify(image, [[50.0, 50.0, 44.0, 40.0, 0.0]])
    assert told.heading[0] == pytest.approx(0.0)


def test_a_front_in_doubt_is_not_told_and_the_box_stays_as_it_was(tmp_path):
    image, rows = np.full((480, 720, 3), 90, np.uint8), parade()[1]
    inner = Axes(rows)
    found = FrontedDetector(inner, opened(tmp_path)).detect(image)
    assert np.isnan(found.heading).all()
    np.testing.assert_array_equal(found.boxes, inner.found.boxes)
    told = opened(tmp_path).classify(image, rows[:, [0, 1, 2, 3, 4]])
    np.testing.assert_allclose(told.confidence, 0.5, atol=1e-3)


def test_confidence_decides(tmp_path):
    image, rows = parade(n=6)
    boxes = Axes(rows).found.boxes
    confidence = opened(tmp_path, sure=0.0).classify(image, boxes).confidence
    level = float(np.median(confidence))
    told = opened(tmp_path, sure=level).classify(image, boxes)
    np.testing.assert_array_equal(np.isfinite(told.heading), told.confidence >= level)


def test_a_class_without_a_front_tells_none(tmp_path):
    weights = np.column_stack([GAIN * brightest_side(SIDE, 2), np.full(3 * SIDE * SIDE, 1.0)])
    path = classifier(tmp_path / "f.onnx", weights, SIDE, metadata={"front_deg": "0, 180, nan", "mean": "0 0 0"})
    image, rows = parade(n=3)
    told = open_front_classifier(path).classify(image, rows)
    assert np.isnan(told.heading).all()
    assert (told.confidence == 0.0).all()


def test_classes_in_another_order(tmp_path):
    weights = GAIN * brightest_side(SIDE, 2)[:, ::-1]
    path = classifier(tmp_path / "f.onnx", weights, SIDE, metadata={"front_deg": "[180, 0]"})
    image, rows = parade()
    told = open_front_classifier(path).classify(image, Axes(rows).found.boxes)
    np.testing.assert_allclose(wrap(told.heading - rows[:, 4]), 0.0, atol=1e-9)


def test_fronts_that_the_detector_tells_are_kept(tmp_path):
    image, rows = parade()
    inner = Axes(rows, heading=1.25)
    assert FrontedDetector(inner, opened(tmp_path)).detect(image) is inner.found


def test_nothing_found_and_very_many_found(tmp_path):
    image, rows = parade()
    model = opened(tmp_path)
    assert len(FrontedDetector(Axes(rows[:0]), model).detect(image)) == 0
    assert model.classify(image, np.empty((0, 5))).heading.shape == (0,)
    many = np.tile(rows, (7, 1))
    found = FrontedDetector(Axes(many), model).detect(image)
    np.testing.assert_allclose(wrap(found.heading - many[:, 4]), 0.0, atol=1e-9)


def test_damaged_numbers_tell_no_front(tmp_path):
    weights = np.full((3 * SIDE * SIDE, 2), np.nan)
    told = open_front_classifier(classifier(tmp_path / "f.onnx", weights, SIDE)).classify(*parade())
    assert np.isnan(told.heading).all()
    assert (told.confidence == 0.0).all()


def test_margin_and_normalisation_are_as_the_model_says(tmp_path):
    """A model that sums up red alone sees the margin and its own mean and deviation."""
    weights = np.zeros((3 * SIDE * SIDE, 2))
    weights[: SIDE * SIDE, 0] = 1.0 / SIDE**2
    image = np.zeros((60, 60, 3), np.uint8)
    image[:, :, 2] = 51  # red: 0.2
    image[20:40, 20:40, 2] = 204  # the box: 0.8
    said = {"mean": "0.5,0.5,0.5", "std": "0.1 0.1 0.1", "margin": "1.0"}
    told = open_front_classifier(classifier(tmp_path / "f.onnx", weights, SIDE, metadata=said), sure=0.0)
    confidence = told.classify(image, [[30.0, 30.0, 20.0, 20.0, 0.0]]).confidence[0]
    # a quarter of the crop is the box: mean 0.35, logit (0.35 − 0.5) / 0.1 against 0
    assert confidence == pytest.approx(1.0 / (1.0 + np.exp(-1.5)), abs=2e-3)


SHAPES = {
    "three classes": ({"classes": 3}, "3 classes"),
    "one front too many": ({"classes": 2, "metadata": {"front_deg": "0 90 180"}}, "2 classes"),
    "a front at a corner": ({"classes": 2, "metadata": {"front_deg": "45 225"}}, "at a side"),
    "no numbers": ({"classes": 2, "metadata": {"front_deg": "left right"}}, "numbers are needed"),
    "two means": ({"classes": 2, "metadata": {"mean": "0.5 0.5"}}, "'mean' is [0.5, 0.5]"),
    "no such margin": ({"classes": 2, "metadata": {"margin": "-1"}}, "'margin' is [-1.0]"),
    "a size that is none": ({"classes": 2, "metadata": {"size": "nan"}}, "'size' is [nan]"),
    "half open": ({"classes": 2, "crop": [3, "s", 16]}, "crops [n, 3, s, 16]"),
    "a map": ({"classes": 2, "plain": True}, "logits [n, 3, 16, 16]"),
    "not square": ({"classes": 2, "crop": [3, 16, 24]}, "crops [n, 3, 16, 24]"),
    "grey": ({"classes": 2, "crop": [1, 16, 16]}, "crops [n, 1, 16, 16]"),
}


@pytest.mark.parametrize(("options", "told"), SHAPES.values(), ids=SHAPES.keys())
def test_a_model_of_another_shape_is_refused_with_what_was_found(tmp_path, options, told):
    options = dict(options)
    weights = np.zeros((np.prod([n for n in options.get("crop", [3, SIDE, SIDE]) if n != "s"]), options.pop("classes")))
    with pytest.raises(ModelError) as caught:
        open_front_classifier(classifier(tmp_path / "other.onnx", weights, SIDE, **options))
    assert told in str(caught.value)
    assert "other.onnx" in str(caught.value)


def test_files_that_are_no_models_are_refused(tmp_path):
    with pytest.raises(ModelError, match="no such model file"):
        open_front_classifier(tmp_path / "missing.onnx")
    (tmp_path / "text.onnx").write_text("hello")
    with pytest.raises(ModelError, match="cannot be loaded"):
        open_front_classifier(tmp_path / "text.onnx")


def test_the_bundled_model_tells_rendered_vehicles_both_ways():
    """The renderer's own vehicles, found with the wrong end first as often as with the right one."""
    view = CameraView(
        width=1280, height=720, fx=1200.0, fy=1200.0, cx=640.0, cy=360.0, distortion=np.zeros(5),
        R_enu_cam=np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]]), p_enu=np.array([0.0, 0.0, 40.0]),
    )  # fmt: skip
    n = 30
    x, y = np.meshgrid(np.linspace(-18, 18, 6), np.linspace(-9, 9, 5))
    kind = np.where(np.arange(n) % 3 == 2, OTHER_VEHICLE, UGV).astype(np.int8)
    size = np.where(kind[:, None] == UGV, [[2.2, 1.4, 0.9]], [[4.5, 1.8, 1.5]])
    things = Bodies(
        kind=kind,
        x=x.ravel(),
        y=y.ravel(),
        heading=np.linspace(0.0, 12.0, n),
        length=size[:, 0],
        width=size[:, 1],
        height=size[:, 2],
        color=np.random.default_rng(0).integers(20, 240, (n, 3)).astype(np.uint8),
    )
    boxes = true_boxes(view, things)
    rows = np.stack([boxes.cx, boxes.cy, boxes.w, boxes.h, boxes.angle + np.pi / 2], axis=1)
    image = Renderer(Scene(roads=()), Style(ground=GroundStyle(side_px=2048)), seed=3).draw(view, things)
    found = FrontedDetector(Axes(rows), open_front_classifier()).detect(image)
    told = np.isfinite(found.heading)
    assert told.mean() >= 0.9
    assert np.abs(wrap(found.heading - rows[:, 4]))[told].max() < 0.01


def test_the_bundled_model_is_small_and_its_page_names_this_very_file():
    page = (BUNDLED_FRONT.parent / "FRONT.md").read_text()
    assert BUNDLED_FRONT.stat().st_size < 12_000_000
    assert hashlib.sha256(BUNDLED_FRONT.read_bytes()).hexdigest() in page
    assert BUNDLED_FRONT.name in page
