"""Suppression, class names, layouts and rows of YOLO-OBB models, against plain definitions."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vision.detect.boxes import nms, prob_iou
from vision.detect.decode_yolo import Rule, decode_boxes, decode_raw, fast_nms
from vision.detect.yolo_classes import class_names, vehicle_classes
from vision.detect.yolo_layout import anchor_counts, output_form


def by_definition(boxes, score, overlap, rival):
    """Fast NMS as it is defined: dropped by any better box, be that dropped itself or not."""
    order = np.argsort(-score, kind="stable")
    overlaps = prob_iou(boxes, boxes) > overlap
    return [j for k, j in enumerate(order) if not any(overlaps[i, j] and rival(i, j) for i in order[:k])]


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(0, 60), st.sampled_from([0.0, 0.2, 0.45, 0.9, 1.0]))
def test_suppression_is_that_of_its_definition(seed, n, overlap):
    rng = np.random.default_rng(seed)
    boxes = rng.uniform((0, 0, 1, 1, -2), (60, 60, 30, 15, 2), (n, 5))
    score, kind = rng.permutation(n) / 100.0, rng.integers(0, 3, n)
    assert fast_nms(boxes, score, overlap).tolist() == by_definition(boxes, score, overlap, lambda i, j: True)
    same = by_definition(boxes, score, overlap, lambda i, j: kind[i] == kind[j])
    assert fast_nms(boxes, score, overlap, kind, "same").tolist() == same
    other = by_definition(boxes, score, overlap, lambda i, j: kind[i] != kind[j])
    assert fast_nms(boxes, score, overlap, kind, "other").tolist() == other


def test_many_boxes_are_suppressed_in_parts(monkeypatch):
    rng = np.random.default_rng(3)
    boxes = rng.uniform((0, 0, 5, 5, -2), (200, 200, 30, 15, 2), (300, 5))
    score = rng.random(300)
    whole = fast_nms(boxes, score, 0.3)
    monkeypatch.setattr("vision.detect.decode_yolo.PAIRS", 1000)
    assert fast_nms(boxes, score, 0.3).tolist() == whole.tolist()


def test_a_chain_leaves_only_its_best():
    # each over the next, the first not over the third: greedy suppression brings the third back
    boxes = np.array([[0, 0, 40, 20, 0], [12, 0, 40, 20, 0], [24, 0, 40, 20, 0]], dtype=float)
    score = np.array([0.9, 0.8, 0.7])
    assert prob_iou(boxes, boxes)[0, 1] > 0.45 > prob_iou(boxes, boxes)[0, 2]
    assert fast_nms(boxes, score, 0.45).tolist() == [0]
    assert nms(boxes, score, 0.45).tolist() == [0, 2]


def rule(*classes, score=0.3, **change):
    return Rule(classes=np.array(classes), score=score, **change)


def test_an_anchor_is_of_its_best_class():
    rows = np.zeros((8, 2))
    rows[:4] = [[10, 50], [10, 50], [8, 8], [4, 4]]
    rows[4:7, 0] = (0.9, 0.5, 0.0)  # rather a plane than a vehicle
    rows[4:7, 1] = (0.4, 0.5, 0.0)
    found, _ = decode_raw(rows, rule(1))
    assert found.cx.tolist() == [50.0]


def test_no_more_boxes_than_asked_for_are_told_and_the_rest_is_counted():
    rows = np.zeros((6, 9))
    rows[:4], rows[4] = [np.arange(9) * 100, [5] * 9, [8] * 9, [4] * 9], np.linspace(0.9, 0.5, 9)
    found, dropped = decode_raw(rows, rule(0, most=4))
    assert found.score.tolist() == pytest.approx([0.9, 0.85, 0.8, 0.75])
    assert dropped.surplus == 5


def test_rows_that_are_no_boxes_are_counted():
    table = np.array([
        [10, 10, 8, 4, 0.9, 1, 0.2],
        [50, 10, 8, 4, 0.9, 1.5, 0.2],  # of no class
        [50, 10, 8, 4, 0.9, -1, 0.2],
        [50, 10, 8, 4, np.nan, 1, 0.2],
        [50, 10, np.inf, 4, 0.9, 1, 0.2],
        [50, 10, -8, 4, 0.9, 1, 0.2],
        [90, 10, 8, 4, 0.9, 0, 0.2],  # of a class that does not count
        [90, 10, 8, 4, 0.3, 1, 0.2],  # not above the score
        [0, 0, 0, 0, 0, 0, 0],
    ])  # fmt: skip
    found, dropped = decode_boxes(table, 3, rule(1))
    np.testing.assert_allclose(found.boxes, [[10, 10, 8, 4, 0.2]])
    assert (dropped.damaged, dropped.flat) == (4, 1)
    assert len(decode_boxes(np.zeros((300, 7)), 3, rule(1, score=0.0))[0]) == 0


def test_boxes_of_one_class_are_as_the_model_left_them():
    near = np.array([[10, 10, 8, 4, 0.9, 1, 0.0], [10.5, 10, 8, 4, 0.8, 1, 0.0], [10, 10, 8, 4, 0.7, 0, 0.0]])
    assert decode_boxes(near, 3, rule(0, 1))[0].score.tolist() == pytest.approx([0.9, 0.8])
    assert len(decode_boxes(near, 3, rule(0, 1, per_class=True))[0]) == 3


FORMS = {
    "raw": ([1, 20, 8400], 15, False, "raw"),
    "turned": ([1, 8400, 20], 15, False, "turned"),
    "suppressed": ([1, 300, 7], 15, True, "boxes"),
    "suppressed, without notes": ([1, 300, 7], 15, False, "boxes"),
    "two classes, raw": ([1, 7, 8400], 2, False, "raw"),
    "two classes, turned": ([1, 8400, 7], 2, False, "turned"),
    "two classes, suppressed": ([1, 300, 7], 2, False, "boxes"),
    "two classes, as many boxes as anchors": ([1, 8400, 7], 2, True, "boxes"),
    "without names, raw": ([1, 20, 8400], 0, False, "raw"),
    "without names, turned": ([1, 8400, 20], 0, False, "turned"),
    "without names, suppressed": ([1, 300, 7], 0, False, "boxes"),
    "without names, unusual grid": ([1, 20, 9000], 0, False, "raw"),
    "a finer level": ([1, 7, 34000], 2, False, "raw"),
    "as many classes as boxes": ([1, 300, 7], 295, False, "boxes"),
}


@pytest.mark.parametrize(("shape", "classes", "suppressed", "form"), FORMS.values(), ids=FORMS.keys())
def test_the_form_of_an_output(shape, classes, suppressed, form):
    names = {k: f"car {k}" for k in range(classes)}
    assert output_form(tuple(shape), names, anchor_counts(640, 640), suppressed) == form


def test_anchors_of_a_canvas():
    assert {8400, 34000, 8500} == anchor_counts(640, 640)
    assert 5040 in anchor_counts(384, 640)


@pytest.mark.parametrize(
    ("name", "counts"),
    [
        ("small vehicle", True),  # DOTA
        ("large vehicle", True),
        ("storage tank", False),
        ("car", True),  # COCO, VisDrone
        ("Bus", True),
        ("van", True),
        ("truck", True),
        ("people", False),
        ("bicycle", False),
        ("pick-up", True),  # VEDAI
        ("Pick up", True),
        ("camping car", True),
        ("Small-Vehicles", True),
        ("buses", True),
        ("dump_truck", True),
        ("scarf", False),
        ("car park", False),
        ("Railway Vehicle", False),
        ("license plate of car", False),
    ],
)
def test_names_that_sound_like_vehicles(name, counts):
    names = {0: name, 1: "lorry"}
    assert (0 in vehicle_classes(names, 2)) == counts


def test_a_single_class_counts_whatever_its_name():
    assert vehicle_classes({0: "husky"}, 1).tolist() == [0]
    with pytest.raises(ValueError, match="the numbers 0 to 3"):
        vehicle_classes({}, 4, ["car"])


def test_names_as_they_are_written_into_models():
    assert class_names({"names": "{0: 'plane', 1: 'ship'}"}) == class_names({"names": "['plane', 'ship']"})
    assert class_names({}) == {}
    for garbled in ("{0: oops", "7", "{'a': 'b'}"):
        with pytest.raises(ValueError, match="cannot be read"):
            class_names({"names": garbled})
