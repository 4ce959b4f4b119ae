"""YOLO-OBB exports of every layout, as tiny files that answer with the same boxes whatever they are shown."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from tests.support.onnx_models import ANCHORS, ANY, FIXED, FLOAT, FLOAT16, NAMES, black, model, raw, suppressed, yolo
from vision.detect.detector import YoloDetector, open_detector
from vision.errors import ModelError

# cx, cy, w, h, class, score, angle
SEEN = (
    (32, 32, 10, 5, 1, 0.9, 0.3),  # a vehicle
    (32.5, 32, 10, 5, 1, 0.6, 0.3),  # the same again
    (10, 32, 10, 5, 0, 0.9, 0.3),  # a plane
    (50, 30, 4, 8, 1, 0.5, 0.0),  # its length across: the axis is turned
    (20, 20, 4, 8, 1, 0.2, 0.0),  # too faint
    (20, 2, 4, 8, 1, 0.8, 0.0),  # on the margin
)


ONE_OF_EACH = (SEEN[0], *SEEN[2:])
LAYOUTS = {
    "raw": (raw(*SEEN), {}),
    "turned": (raw(*SEEN).transpose(0, 2, 1), {}),
    "suppressed": (suppressed(*ONE_OF_EACH), {}),
    "raw, any size": (raw(*SEEN), {"shape": ANY, "told": ["batch", "rows", "anchors"], "imgsz": 64}),
    "turned, any size": (
        raw(*SEEN).transpose(0, 2, 1),
        {"shape": ANY, "told": ["batch", "anchors", "rows"], "imgsz": 64},
    ),
    "suppressed, any size": (suppressed(*ONE_OF_EACH), {"shape": ANY, "told": ["batch", 30, 7], "imgsz": 64}),
    "raw, batch of 2": (np.repeat(raw(*SEEN), 2, axis=0), {"shape": [2, 3, 64, 64]}),
    "suppressed, batch of 2": (np.repeat(suppressed(*ONE_OF_EACH), 2, axis=0), {"shape": [2, 3, 64, 64]}),
    "raw, float16": (raw(*SEEN), {"kind": FLOAT16}),
    "suppressed, float16": (suppressed(*ONE_OF_EACH), {"kind": FLOAT16}),
}


@pytest.mark.parametrize(("out", "options"), LAYOUTS.values(), ids=LAYOUTS.keys())
def test_every_layout_is_read_and_brought_back_to_the_image(tmp_path, out, options):
    detector = yolo(tmp_path, out, **options)
    assert isinstance(detector, YoloDetector)
    # drawn at half size; a fixed canvas has margins of 16 px, one of any size keeps the 32 rows that are needed
    top = 0 if "imgsz" in options else 16
    found = detector.detect(black(), gsd_m=0.1)
    rough = 2e-3 if options.get("kind") == FLOAT16 else 1e-6
    np.testing.assert_allclose(found.boxes[0], [64, 2 * (32 - top), 20, 10, 0.3], rtol=rough)
    np.testing.assert_allclose(found.boxes[-1, :4], [100, 2 * (30 - top), 16, 8])
    assert found.score[:1].tolist() == pytest.approx([0.9], rel=rough)
    assert len(found) == (2 if top else 3)  # nothing is on a margin where there is none
    assert np.isnan(found.heading).all()


def test_two_classes_make_seven_rows_that_are_no_seven_columns(tmp_path):
    names = {"names": "['van', 'truck']"}
    anchors = raw((32, 32, 10, 5, 0, 0.9, 0.3), classes=2)
    for out in (anchors, anchors.transpose(0, 2, 1), suppressed((32, 32, 10, 5, 0, 0.9, 0.3))):
        found = yolo(tmp_path, out, names).detect(black(64, 64))
        np.testing.assert_allclose(found.boxes, [[32, 32, 10, 5, 0.3]], rtol=1e-6)
    # as many boxes as there are anchors: only the notes tell
    out = suppressed((32, 32, 10, 5, 0, 0.9, 0.3), most=ANCHORS)
    for notes in ({"end2end": "True"}, {"args": "{'nms': True}"}):
        found = yolo(tmp_path, out, names | notes).detect(black(64, 64))
        np.testing.assert_allclose(found.boxes, [[32, 32, 10, 5, 0.3]], rtol=1e-6)


def test_classes_can_be_chosen(tmp_path):
    out = raw((32, 32, 10, 5, 0, 0.9, 0.0), (10, 32, 10, 5, 2, 0.9, 0.0))
    assert len(yolo(tmp_path, out).detect(black(64, 64))) == 0
    assert len(yolo(tmp_path, out, classes=["Plane"]).detect(black(64, 64))) == 1
    assert len(yolo(tmp_path, out, classes=["0", "storage tank"]).detect(black(64, 64))) == 2
    assert len(yolo(tmp_path, out, metadata={}).detect(black(64, 64))) == 2  # names unknown: every class counts
    with pytest.raises(ModelError, match="none of its classes is called 'boat': plane, small vehicle, storage tank"):
        yolo(tmp_path, out, classes=["plane", "boat"])


def test_a_vehicle_of_two_classes_has_one_box_unless_wanted(tmp_path):
    names = {"names": "{0: 'van', 1: 'lorry', 2: 'tree'}"}
    seen = ((32, 32, 10, 5, 0, 0.9, 0.3), (32, 32, 11, 5, 1, 0.8, 0.3))
    for out in (raw(*seen), suppressed(*seen)):
        assert yolo(tmp_path, out, names).detect(black(64, 64)).score.tolist() == pytest.approx([0.9])
        assert len(yolo(tmp_path, out, names, per_class=True).detect(black(64, 64))) == 2


def test_what_can_be_no_box_costs_only_itself_and_is_counted(tmp_path):
    out = raw((np.nan, 32, 10, 5, 1, 0.9, 0.0), (30, 30, 0, 5, 1, 0.9, 0.0), (10, 32, 10, 5, 1, 0.8, 0.0))
    out[0, 5, 40] = np.nan
    detector = yolo(tmp_path, out)
    for _ in range(2):
        assert detector.detect(black(64, 64)).score.tolist() == pytest.approx([0.8])
    assert (detector.dropped.damaged, detector.dropped.flat, detector.dropped.surplus) == (4, 2, 0)


def test_several_threads_may_ask_at_once(tmp_path):
    detector = yolo(tmp_path, raw(SEEN[0], (10, 32, 0, 5, 1, 0.8, 0.0)))
    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(lambda _: detector.detect(black(64, 64)), range(200)))
    assert {len(f) for f in found} == {1}
    assert detector.dropped.flat == 200


def test_the_canvas_of_a_model_of_any_size(tmp_path):
    centre = raw((32, 16, 10, 5, 1, 0.9, 0.0))
    any_size = {"shape": ANY, "told": ["batch", "rows", "anchors"]}
    # 128 x 40 drawn at half size is 64 x 20; the least canvas with whole steps of 32 has 32 rows, 6 of them above
    found = yolo(tmp_path, centre, imgsz=64, **any_size).detect(black(128, 40))
    np.testing.assert_allclose(found.centre, [[64.0, 20.0]])
    # its notes say 128: as large as drawn, rounded up to a step
    found = yolo(tmp_path, centre, NAMES | {"imgsz": "[100, 100]"}, **any_size).detect(black(128, 40))
    np.testing.assert_allclose(found.centre, [[32.0, 4.0]])
    with pytest.raises(ModelError, match="takes 64 × 64 px only, 640 px cannot be had"):
        yolo(tmp_path, centre, imgsz=640)
    with pytest.raises(ModelError, match="smaller than its step of 32 px"):
        yolo(tmp_path, centre, imgsz=8, **any_size)


def test_small_vehicles_in_a_large_image_are_looked_at_in_tiles(tmp_path):
    out = np.repeat(raw((32, 32, 12, 6, 1, 0.9, 0.0)), 2, axis=0)  # sees a vehicle in the middle of any canvas
    batch = {"shape": [2, 3, 64, 64]}
    seen = {gsd_m: yolo(tmp_path, out, **batch).detect(black(150, 150), gsd_m=gsd_m) for gsd_m in (0.05, 0.2, None)}
    assert len(seen[0.05]) == len(seen[None]) == 1  # 2.5 m are 50 px or unknown: the whole image
    assert len(seen[0.2]) == 16  # 12.5 px, shrunk to 5 as a whole
    middle = np.sort(np.unique(seen[0.2].cx.round(3)))
    np.testing.assert_allclose(middle, 150 - middle[::-1], atol=1.0)
    assert len(yolo(tmp_path, out, tiled=False, **batch).detect(black(150, 150), gsd_m=0.2)) == 1


def test_tiles_are_few_however_large_the_image(tmp_path):
    detector = yolo(tmp_path, raw((32, 32, 12, 6, 1, 0.9, 0.0)))
    for width, height in ((4000, 3000), (6000, 100), (70, 70), (64, 64), (1, 1)):
        assert 1 <= len(detector.detect(black(width, height), gsd_m=5.0)) <= 16


def rows(n):
    return ("output0", FLOAT, [1, n, ANCHORS])


IN = ("images", FLOAT, FIXED)
REFUSED = {
    "another task": (("x", FLOAT, [1, 10]), ("y", FLOAT, [1, 10]), {}, "x [1, 10] float → y [1, 10] float"),
    "its notes": (IN, rows(8), NAMES | {"task": "segment"}, "the task 'segment'"),
    "upright": (IN, rows(7), NAMES, "3 classes, which need 8 rows with the angle; these look like upright boxes"),
    "upright, suppressed": (IN, ("output0", FLOAT, [1, 300, 6]), NAMES, "these look like upright boxes"),
    "another number of classes": (IN, rows(20), NAMES, "[1, 20, 84] does not fit its 3 classes, which need 8 rows"),
    "no vehicles": (IN, rows(7), {"names": "{0: 'a', 1: 'b'}"}, "none of its classes sounds like a vehicle: a, b"),
    "names garbled": (IN, rows(8), {"names": "{0: oops"}, "class names cannot be read"),
    "no room": (IN, rows(5), {}, "no room for x y w h, a score and an angle"),
    "too few images": (("images", FLOAT, [2, 3, 64, 64]), rows(8), NAMES, "for 1 images"),
    "channels last": (("images", FLOAT, [1, 64, 64, 3]), rows(8), NAMES, "not a detector of a known shape"),
    "two outputs deep": (IN, ("output0", FLOAT, [1, 1, 8, ANCHORS]), NAMES, "not a detector of a known shape"),
}


@pytest.mark.parametrize("case", REFUSED.values(), ids=REFUSED.keys())
def test_a_model_of_another_shape_is_refused_with_what_was_found(tmp_path, case):
    image, out, metadata, told = case
    constant = np.zeros(out[2]) if told != "for 1 images" else np.zeros((0, 8, ANCHORS))
    path = model(tmp_path / "other.onnx", image, out, metadata, constant)
    with pytest.raises(ModelError) as caught:
        open_detector(path)
    message = str(caught.value)
    assert told in message
    assert "other.onnx" in message
    assert "YOLO-OBB exports: one input" in message
