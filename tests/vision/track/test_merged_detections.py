"""Boxes round several vehicles: the tracks that they hold stay apart, and nobody else is moved."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.support.snapshots import STEP, boxes
from vision.track.tracker import Tracker


def in_one_box(places, w=40.0, h=20.0):
    """The box round vehicles that all look along +x."""
    half = np.array([w, h]) / 2
    low, high = places.min(axis=0) - half, places.max(axis=0) + half
    return boxes([(low + high) / 2], w=high[0] - low[0], h=high[1] - low[1])


@pytest.mark.parametrize("apart", [18.0, 26.0])
@pytest.mark.parametrize("speed", [(60.0, 60.0), (60.0, -60.0)], ids=["side by side", "passing"])
def test_vehicles_in_one_box_keep_their_ids(speed, apart):
    tracker = Tracker()
    start, speed = np.array([[200.0, 100.0], [200.0, 100.0 + apart]]), np.array(speed)
    start[:, 0] -= 1.2 * speed
    for k in range(25):
        places = start + np.stack([speed, 0 * speed], axis=1) * k * 0.1
        merged = 9 <= k < 16
        tracks = tracker.update(in_one_box(places) if merged else boxes(places), k * STEP)
        assert tracks.track_id.tolist() == [1, 2], "the common box begins no track and ends none"
        if merged:
            assert (tracks.detection < 0).all()
            assert (tracks.gap_s > 0).all()
        else:
            assert tracks.detection.tolist() == [0, 1]


def test_a_larger_box_round_one_track_goes_on_with_it():
    tracker = Tracker()
    for k in range(5):
        tracker.update(boxes([(100, 100), (300, 100)]), k * STEP)
    tracks = tracker.update(boxes([(100, 100), (300, 100)], w=np.array([60.0, 40.0])), 5 * STEP)
    assert tracks.detection.tolist() == [0, 1]


def test_a_large_box_over_vehicles_that_have_boxes_of_their_own_changes_nothing():
    tracker, other = Tracker(), Tracker()
    for k in range(5):
        tracker.update(boxes([(100, 100), (160, 100)]), k * STEP)
        other.update(boxes([(100, 100), (160, 100)]), k * STEP)
    large = boxes([(100, 100), (160, 100), (150, 120)], w=np.array([40.0, 40, 200]), h=np.array([20.0, 20, 120]))
    tracks, plain = tracker.update(large, 5 * STEP), other.update(boxes([(100, 100), (160, 100)]), 5 * STEP)
    assert tracks.detection[:2].tolist() == [0, 1]
    np.testing.assert_allclose(tracks.boxes[:2], plain.boxes)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10_000))
def test_common_boxes_do_not_depend_on_the_order(seed):
    rng = np.random.default_rng(seed)
    start = rng.uniform(0, 120, (5, 2))
    one, other = Tracker(), Tracker()
    for k in range(3):
        one.update(boxes(start), k * STEP)
        other.update(boxes(start), k * STEP)
    centre, w = rng.uniform(0, 120, (4, 2)), rng.uniform(30, 140, 4)
    order = rng.permutation(4)
    a = one.update(boxes(centre, w=w, h=w), 3 * STEP)
    b = other.update(boxes(centre[order], w=w[order], h=w[order]), 3 * STEP)
    np.testing.assert_allclose(a.boxes, b.boxes, atol=1e-6)
