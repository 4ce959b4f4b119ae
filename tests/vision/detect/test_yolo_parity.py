"""Our boxes against those that Ultralytics gave for the same anchors: bench/results/yolo_parity.md has all layouts."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment

from tests.support.bundled import ROOT
from vision.detect.decode_yolo import Rule, decode_raw
from vision.detect.letterbox import Letterbox, undo

RECORDED = json.loads((ROOT / "tests" / "support" / "yolo_boxes.json").read_text())


def anchors(seed, n=400):
    """A crowd of anchors of 15 classes on a canvas of 640 x 640, many of them over each other."""
    rng = np.random.default_rng(seed)
    rows = np.zeros((20, n), np.float32)
    rows[0], rows[1] = rng.uniform(0, 640, n), rng.uniform(136, 504, n)
    rows[2], rows[3] = rng.uniform(20, 120, n), rng.uniform(10, 60, n)
    rows[4:19] = rng.uniform(0, 0.2, (15, n))
    rows[4 + rng.integers(8, 12, n), np.arange(n)] = rng.uniform(0.2, 1.0, n)
    rows[19] = rng.uniform(-np.pi / 4, 3 * np.pi / 4, n)
    return rows


@pytest.mark.parametrize("per_class", [True, False])
def test_the_same_boxes_as_recorded_from_ultralytics(per_class):
    rule = Rule(classes=np.array([9, 10]), score=0.25, per_class=per_class)
    found, _ = decode_raw(anchors(5), rule)
    image = np.zeros((733, 1277, 3), np.uint8)
    ours = undo(found, Letterbox.fit((1277, 733), (640, 640)), image)
    theirs = np.array(RECORDED["boxes"]["per class" if per_class else "any class"])
    theirs = theirs[(theirs[:, 0] <= 1277) & (theirs[:, 1] >= 0) & (theirs[:, 1] <= 733)]
    assert len(ours.boxes) == len(theirs) > 50
    paired = linear_sum_assignment(np.abs(theirs[:, None, :2] - ours.boxes[None, :, :2]).sum(axis=2))[1]
    same = ours.boxes[paired]
    turned = np.abs(same[:, 2] - theirs[:, 2]) > 0.2  # the same box, its other side taken for the first
    same[turned] = same[turned][:, [0, 1, 3, 2, 4]] + [0.0, 0.0, 0.0, 0.0, np.pi / 2]
    # of sides; they stretch a turned box by the image's x and y, we by their mean
    np.testing.assert_allclose(same[:, :4], theirs[:, :4], atol=0.2)
    half_turns = (same[:, 4] - theirs[:, 4]) / np.pi
    assert np.abs(half_turns - half_turns.round()).max() * 180.0 <= 0.01
    np.testing.assert_allclose(ours.score[paired], theirs[:, 5], atol=1e-4)
