"""Boxes of too low a score to count: they continue confirmed tracks, and nothing else."""

import numpy as np
import pytest

from tests.support.snapshots import STEP, boxes
from vision.track.tracker import Tracker
from vision.track.tracks import TrackerParams


def places(k):
    return [[100.0 + 4.0 * k, 50.0], [100.0 + 4.0 * k, 250.0]]


def run(scores, tracker=None):
    """The tracks after each frame in which the first of two vehicles has these scores; the second is always clear."""
    tracker = tracker or Tracker()
    return [tracker.update(boxes(places(k), score=[s, 0.9]), k * STEP) for k, s in enumerate(scores)]


def test_a_confirmed_track_goes_on_with_weak_boxes():
    tracks = run([0.9] * 5 + [0.15] * 40)[-1]
    assert tracks.track_id.tolist() == [1, 2] and tracks.detection.tolist() == [0, 1]
    assert tracks.gap_s.tolist() == [0.0, 0.0]
    np.testing.assert_allclose(tracks.cx, 100.0 + 4.0 * 44, atol=2.0)


def test_weak_boxes_begin_and_confirm_nothing():
    assert all(t.detection.tolist() == [1] for t in run([0.29] * 10))
    # a track that was seen once ends as if nothing had come after
    tracks = run([0.9] + [0.29] * 6)
    assert tracks[1].detection.tolist() == [-1, 1] and tracks[-1].detection.tolist() == [1]


def test_boxes_below_the_weakest_are_nothing():
    assert run([0.9] * 5 + [0.09])[-1].detection.tolist() == [-1, 1]
    assert run([0.09] * 3, Tracker(TrackerParams(low_score=0.05, new_score=0.05)))[-1].hits.tolist() == [3, 3]


def test_strong_boxes_choose_first():
    tracker = Tracker()
    for k in range(5):
        tracker.update(boxes([[100.0, 50.0]]), k * STEP)
    # the weak box lies nearer, and comes first
    tracks = tracker.update(boxes([[100.0, 50.0], [106.0, 50.0]], score=[0.25, 0.8]), 5 * STEP)
    assert tracks.detection.tolist() == [1]


def test_nothing_but_confirmed_tracks_depends_on_weak_boxes():
    rng = np.random.default_rng(4)
    plain, crowded = Tracker(), Tracker()
    for k in range(60):
        clear = boxes(np.vstack([places(k), rng.uniform(0, 400, (2, 2))]), score=[0.9, 0.8, 0.6, 0.4])
        # far from all that is confirmed
        weak = np.add(rng.uniform(0, 400, (30, 2)), (2000.0, 0.0))
        seen = boxes(np.vstack([weak, clear.centre]), score=np.append(rng.uniform(0.1, 0.3, 30), clear.score))
        a, b = plain.update(clear, k * STEP), crowded.update(seen, k * STEP)
        np.testing.assert_array_equal(a.track_id, b.track_id)
        np.testing.assert_array_equal(a.boxes, b.boxes)
        np.testing.assert_array_equal(np.where(a.detection >= 0, a.detection + 30, -1), b.detection)


@pytest.mark.parametrize("score", [0.9, 0.2])
def test_known_vehicles_out_of_sight_wait_for_their_report(score):
    """A box that comes where a named track was lost a while ago is not taken for it, weak or strong."""
    tracker = Tracker()
    for k in range(10):
        tracker.update(boxes([[100.0, 50.0]]), k * STEP)
    none = np.empty((0, 2), dtype=np.intp)
    for k in range(10, 16):
        tracker.update(boxes([]), k * STEP, stitch=lambda *_: none, known=(1,))
    tracks = tracker.update(boxes([[100.0, 50.0]], score=score), 16 * STEP, stitch=lambda *_: none, known=(1,))
    assert tracks.detection[0] == -1


def test_tracks_in_a_common_box_take_no_weak_one():
    """Which of them it would be cannot be told."""
    tracker = Tracker()
    for k in range(10):
        tracker.update(boxes([[100.0, 50.0], [150.0, 50.0]]), k * STEP)
    both = boxes([[125.0, 50.0], [104.0, 50.0]], score=[0.9, 0.2], w=[90.0, 40.0])
    assert tracker.update(both, 10 * STEP).detection.tolist() == [-1, -1]
