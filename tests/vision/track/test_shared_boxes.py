"""Two tracks and one box for both: nothing is taken from either until they can be told apart again."""

from __future__ import annotations

import numpy as np
import pytest

from tests.support.snapshots import STEP, boxes
from vision.track.tracker import Tracker

APART_PX = 34.0
"""Vehicles nearer than this have one box between them."""


def crossing(seed, step_s, speed=90.0):
    """Places of two vehicles, (k, 2, 2), whose ways cross at a right angle, and the boxes that a detector sees."""
    rng = np.random.default_rng(seed)
    for t in np.arange(-2.0, 2.0, step_s):
        places = np.array([[300 + speed * t, 200.0], [300.0, 206 + speed * t]])
        jitter = rng.normal(0, 1.0, (2, 2))
        if np.linalg.norm(places[0] - places[1]) < APART_PX:
            share = rng.uniform()
            between = share * places[0] + (1 - share) * places[1]
            yield places, boxes([between + jitter[0]], w=rng.uniform(34, 46), h=rng.uniform(20, 30))
        else:
            yield places, boxes(places + jitter)


@pytest.mark.slow_but_first
@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("step_s", [0.1, 0.17, 0.25])
def test_vehicles_that_cross_in_one_box_keep_their_ids(step_s, seed):
    tracker = Tracker()
    flight = list(crossing(seed, step_s))
    for k, (_, seen) in enumerate(flight):
        tracks = tracker.update(seen, round(k * step_s * 1e6))
    places = flight[-1][0]
    away = np.linalg.norm(np.stack([tracks.cx, tracks.cy], axis=1)[:, None] - places, axis=2)
    assert tracks.track_id.tolist() == [1, 2]
    assert away.argmin(axis=1).tolist() == [0, 1]


def test_a_box_between_two_tracks_is_of_neither_and_begins_none():
    tracker = Tracker()
    for k in range(6):
        tracker.update(boxes([(200, 100), (260 - 6 * k, 100)]), k * STEP)
    tracks = tracker.update(boxes([(212, 100)]), 6 * STEP)
    assert tracks.track_id.tolist() == [1, 2]
    assert (tracks.detection < 0).all()


def test_a_box_where_one_track_is_expected_is_of_that_one():
    tracker = Tracker()
    for k in range(20):
        tracker.update(boxes([(200, 100), (226, 100)]), k * STEP)
    assert tracker.update(boxes([(200, 100)]), 20 * STEP).detection.tolist() == [0, -1]


def test_tracks_that_cannot_be_told_apart_do_not_share_for_ever():
    tracker = Tracker()
    for k in range(10):
        tracker.update(boxes([(190, 100), (210, 100)], w=40.0), k * STEP)
    for k in range(10, 60):
        tracks = tracker.update(boxes([(200, 100)], w=44.0), k * STEP)
    assert tracks.detection.tolist() == [0]
