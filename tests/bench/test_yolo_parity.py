"""Our boxes against those that Ultralytics gave for the same anchors, and the measure of their parity."""

from __future__ import annotations

import json

import numpy as np
import pytest

from bench.video.yolo_parity import compared
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
    line = compared("", "", "", theirs[:, :5], ours.boxes)
    assert line.parity
    assert line.theirs > 50
    assert line.worst_px <= 0.2  # of sides; they stretch a turned box by the image's x and y, we by their mean
    assert line.worst_deg <= 0.01
    np.testing.assert_allclose(ours.score, theirs[:, 5], atol=1e-4)


def test_the_measure_of_parity():
    box = np.array([[10.0, 20.0, 8.0, 4.0, 0.3]])
    turned = np.array([[10.0, 20.0, 4.0, 8.0, 0.3 - np.pi / 2]])
    assert compared("", "", "", box, turned).parity
    off = compared("", "", "", box, box + np.array([0.6, 0.0, 0.0, 0.0, 0.0]))
    assert (off.same, off.parity) == (0, False)
    assert off.worst_px == pytest.approx(0.6)
    assert not compared("", "", "", box, box + np.array([0.0, 0.0, 0.0, 0.0, 0.01])).parity
    assert not compared("", "", "", box, np.empty((0, 5))).parity
    assert compared("", "", "", np.empty((0, 5)), np.empty((0, 5))).parity
