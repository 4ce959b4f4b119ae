"""Lost tracks and leftover detections."""

import numpy as np
import pytest

from assoc.methods.reattach import reattach, reattach_gated

PREDICTED = np.array([[0.0, 0.0], [10.0, 0.0], [20.0, 0.0], [np.nan, np.nan]])
STD1 = np.ones(4)


def test_as_printed_takes_the_nearest_however_far():
    pairs = reattach(PREDICTED, np.array([2]), np.array([[500.0, 0.0]]))
    assert pairs.tolist() == [[0, 0]]


@pytest.mark.parametrize(
    ("lost", "centres", "expected"),
    [
        ([1], [[10.5, 0.0]], [[0, 0]]),  # found again
        ([1], [[19.0, 0.0]], []),  # nearest is vehicle 2, which is not lost
        ([1], [[14.0, 0.0]], []),  # nearest but implausibly far
        ([1], [[11.5, 0.0], [10.2, 0.0]], [[0, 1]]),  # the better of two
        ([0, 1], [[10.1, 0.0], [0.2, 0.0]], [[0, 1], [1, 0]]),
        ([1, 1], [[10.1, 0.0]], []),  # two tracks claim the name
        ([-1], [[10.1, 0.0]], []),  # unnamed
        ([3], [[10.1, 0.0]], []),  # vehicle without a report
        ([1], [], []),
        ([], [[10.1, 0.0]], []),
    ],
)
def test_gated_and_mutual(lost, centres, expected):
    pairs = reattach_gated(PREDICTED, STD1, np.array(lost, np.int64), np.array(centres).reshape(-1, 2))
    assert pairs.tolist() == expected


def test_printed_gives_each_track_one_detection():
    pairs = reattach(PREDICTED, np.array([1, 0]), np.array([[10.1, 0.0], [10.2, 0.0], [1.0, 0.0]]))
    assert pairs.tolist() == [[0, 0], [1, 2]]


def test_no_vehicles():
    assert reattach(np.empty((0, 2)), np.array([0]), np.zeros((1, 2))).shape == (0, 2)
    assert reattach_gated(np.empty((0, 2)), np.empty(0), np.array([0]), np.zeros((1, 2))).shape == (0, 2)
