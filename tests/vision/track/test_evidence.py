"""Which tracks are reported: by their scores, and by what is usual in the film."""

import numpy as np
import pytest

from tests.support.snapshots import STEP, boxes
from vision.track.tracker import Tracker
from vision.track.tracks import TrackerParams

CLEAR = [[100.0 + 60.0 * i, 50.0] for i in range(5)]
OTHER = [100.0, 400.0]


def film(usual, other, *, params=None, reported_px=None):
    """In which of the frames a track far from the rest is reported: ``other`` its scores, NaN unseen."""
    tracker, found = Tracker(params), []
    for k in range(30 + len(other)):
        place, score = list(CLEAR), [usual] * len(CLEAR)
        if k >= 30 and np.isfinite(other[k - 30]):
            place, score = [*place, OTHER], [*score, other[k - 30]]
        tracks = tracker.update(boxes(place, score=score), k * STEP, reported_px=reported_px)
        found.append(bool((tracks.cy > 300.0).any()))
    assert not any(found[:30])
    return found[30:]


@pytest.mark.parametrize(
    ("usual", "score", "first"),
    [
        (0.8, 0.9, 0),  # clearly one
        (0.8, 0.75, 2),
        (0.8, 0.7, 5),  # a dark one among bright ones takes longer
        (0.8, 0.5, 12),
        (0.8, 0.33, 12),
        (0.34, 0.33, 2),  # where all are hardly seen, it is like the others
    ],
)
def test_it_takes_as_many_boxes_as_its_scores_are_unusual(usual, score, first):
    assert film(usual, [score] * 16) == [False] * first + [True] * (16 - first)


def test_what_is_seen_now_and_then_with_a_low_score_is_nothing():
    assert not any(film(0.7, [0.33, np.nan, np.nan, 0.35, np.nan] * 8))


def test_a_box_where_a_vehicle_reports_to_be_is_one():
    assert film(0.8, [0.33] * 3, reported_px=np.array([[110.0, 410.0], [900.0, 900.0]])) == [True] * 3
    assert not film(0.8, [0.33] * 3, reported_px=np.array([[900.0, 900.0]]))[0]


def test_it_is_relative_to_the_score_from_which_boxes_count():
    """A detector with low scores throughout needs as many boxes."""
    params = TrackerParams(new_score=0.05)
    assert film(0.06, [0.06] * 3, params=params) == film(0.34, [0.34] * 3) == [False, False, True]


def small(score, *, usual=0.8, row=50.0, reported_px=None):
    """After how many frames a vehicle of a third of the others' size is reported, at most 40."""
    tracker = Tracker()
    for k in range(70):
        place, size = list(CLEAR), [40.0] * len(CLEAR)
        if k >= 30:
            place, size = [*place, [900.0, row]], [*size, 14.0]
        seen = boxes(place, score=[usual] * len(CLEAR) + [score] * (k >= 30), w=size, h=np.multiply(size, 0.5))
        tracks = tracker.update(seen, k * STEP, reported_px=reported_px)
        if (tracks.cx > 800.0).any():
            return k - 30
    return 40


def test_what_is_smaller_than_the_vehicles_beside_it_needs_higher_scores():
    assert [small(score) for score in (0.9, 0.8, 0.35)] == [1, 5, 40]


def test_far_up_the_picture_vehicles_are_smaller():
    assert small(0.35, row=850.0) == 13


def test_small_vehicles_among_large_ones_are_tracked_where_they_report_to_be():
    assert small(0.35, reported_px=np.array([[880.0, 60.0]])) == 0
