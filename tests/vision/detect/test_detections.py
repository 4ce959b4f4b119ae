"""Boxes by what their scores are worth."""

import numpy as np

from tests.support.snapshots import boxes
from vision.detect.detections import MAX_WEAK


def test_of_many_weak_boxes_the_best_are_kept():
    score = np.random.default_rng(2).permutation(np.linspace(0.1, 0.9, 200))
    found = boxes(np.arange(400.0).reshape(-1, 2), score=score)
    useful = found.useful(0.5)
    strong = score[score >= 0.5]
    np.testing.assert_array_equal(useful.at_least(0.5).score, strong)
    weak = np.sort(useful.score[useful.score < 0.5])
    np.testing.assert_array_equal(weak, np.sort(score[score < 0.5])[-MAX_WEAK:])
    # in the order in which they came
    assert (np.diff(useful.cx) > 0).all()


def test_few_boxes_stay_as_they_are():
    found = boxes([[1.0, 2.0], [3.0, 4.0]], score=[0.9, 0.2])
    assert found.useful(0.5) is found and found.at_least(0.1) is found
    assert found.at_least(0.5).score.tolist() == [0.9]
