"""No name of a box round two vehicles is sure, and one of a vehicle that is longer than the others is, in the end."""

import numpy as np
import pytest

from assoc.identification.common_boxes import CommonBoxes
from assoc.records import Observation

LENGTHS_M = np.array([2.2, 2.3, 2.1, 2.2])
SURE = np.pad(0.99 * np.eye(4), ((0, 0), (0, 1))) + 0.01 * np.eye(5)[4]


def seen(length_m):
    ray = np.tile([0.0, 0.0, 1.0], (4, 1))
    none = np.zeros(4)
    return Observation(
        t_us=0, track_id=np.arange(1, 5), ray_cam=ray, front_cam=ray, gap_s=none, score=none, length_m=length_m
    )


def watched(boxes, seconds, length_m, start_s=0.0, stated=(False,) * 4):
    """Certainties of the four names after seconds with boxes of such lengths."""
    for t in np.arange(start_s, start_s + seconds, 0.1):
        p = boxes.limited(float(t), seen(length_m), SURE, np.array(stated))
    np.testing.assert_allclose(p.sum(axis=1), 1.0)
    return p[np.arange(4), np.arange(4)]


def test_a_box_that_grows_round_another_vehicle_is_not_sure_until_it_is_as_long_as_usual_again():
    boxes = CommonBoxes(4)
    assert watched(boxes, 2.0, LENGTHS_M).min() == pytest.approx(0.99)
    two = LENGTHS_M * np.array([1.7, 1.0, 1.0, 1.0])
    assert watched(boxes, 2.0, two, start_s=2.0).round(2).tolist() == [0.75, 0.99, 0.99, 0.99]
    assert watched(boxes, 0.1, LENGTHS_M, start_s=4.0).min() == pytest.approx(0.99)


def test_a_box_round_two_from_its_first_frame_on_is_told_by_the_others():
    assert watched(CommonBoxes(4), 0.1, LENGTHS_M * np.array([1.7, 1.0, 1.0, 1.0]))[0] == pytest.approx(0.75)


def test_a_longer_vehicle_is_sure_after_some_seconds():
    lorry = LENGTHS_M * np.array([2.0, 1.0, 1.0, 1.0])
    boxes = CommonBoxes(4)
    assert watched(boxes, 1.0, lorry)[0] == pytest.approx(0.75)
    assert watched(boxes, 5.0, lorry, start_s=1.0)[0] == pytest.approx(0.99)


def test_what_the_operator_states_or_nobody_measured_is_left_as_it_is():
    two = LENGTHS_M * np.array([1.7, 1.0, 1.0, 1.0])
    assert watched(CommonBoxes(4), 0.1, two, stated=(True, False, False, False))[0] == pytest.approx(0.99)
    assert watched(CommonBoxes(4), 0.1, None)[0] == pytest.approx(0.99)
    assert watched(CommonBoxes(4), 0.1, np.full(4, np.nan))[0] == pytest.approx(0.99)
