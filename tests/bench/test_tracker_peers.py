"""The comparison of trackers: its scores, its scenes, its peers."""

from __future__ import annotations

import numpy as np
import pytest

from bench.tracker.entrants import OURS, WITH_IDENTITIES, WITH_WARP
from bench.tracker.scene import film
from bench.tracker.scores import TrackingScore
from bench.tracker.sort import OcSort, Sort
from bench.video.tracker_speed import compare, verdict
from vision.detect.detections import Detections


def boxes(*centres):
    x, same = np.array(centres, float).reshape(-1, 2), np.ones(len(centres))
    return Detections(
        cx=x[:, 0], cy=x[:, 1], w=40 * same, h=24 * same, angle=0 * same, score=0.9 * same, heading=np.nan * same
    )


def scored(*frames):
    score = TrackingScore()
    for vehicle, track in frames:
        score.add(np.array(vehicle), np.array(track))
    return score.switches, score.fragments, pytest.approx(score.idf1)


@pytest.mark.parametrize(
    ("frames", "expected"),
    [
        ([([0, 1], [5, 6]), ([1, 0], [6, 5])], (0, 0, 1.0)),  # all right
        ([([0], [5]), ([0], [6])], (1, 0, 0.5)),  # another track
        ([([0], [5]), ([0], [-1]), ([0], [5])], (0, 1, 0.8)),  # a gap
        ([([0], [-1]), ([0], [5])], (0, 0, 2 / 3)),  # late, not broken
        ([([-1], [5])], (0, 0, 0.0)),  # a track of nothing
    ],
)
def test_scores_of_known_answers(frames, expected):
    assert scored(*frames) == expected


def test_the_truth_scores_best():
    score = TrackingScore()
    for frame in film(6, 1, 60):
        score.add(frame.vehicle, frame.vehicle)
    assert (score.switches, score.fragments, score.idf1) == (0, 0, 1.0)


def test_a_scene_is_the_same_again_and_its_warps_lead_on():
    one, again = film(5, 2, 30), film(5, 2, 30)
    for a, b in zip(one, again, strict=True):
        np.testing.assert_array_equal(a.boxes.table, b.boxes.table)
        np.testing.assert_array_equal(a.reported, b.reported)
    off = np.array([p.reported[v] - c for p in one for v, c in zip(p.vehicle, p.boxes.centre, strict=True) if v >= 0])
    assert np.sqrt(np.square(off).mean()) == pytest.approx(8.7, abs=4.0)
    assert np.abs(one[20].warp - np.eye(3)).max() > 0.1


@pytest.mark.parametrize("make", [Sort, OcSort])
def test_peers_follow_and_bridge_a_gap(make):
    tracker = make()
    for k in range(8):
        said = tracker.update(boxes((100 + 5 * k, 100), (300, 300)))
    assert said.tolist() == [1, 2]
    for _ in range(4):
        assert tracker.update(boxes((300, 300))).tolist() == [2]
    assert tracker.update(boxes((300, 300), (160, 100))).tolist() == [2, 1]


def test_the_last_observation_recovers_what_the_filter_lost():
    """A vehicle stops in hiding: SORT looks ahead of it, OC-SORT also where it was."""
    plain, centric = Sort(), OcSort()
    for k in range(10):
        for tracker in (plain, centric):
            tracker.update(boxes((100 + 8 * k, 100)))
    for _ in range(8):
        for tracker in (plain, centric):
            tracker.update(boxes())
    last = boxes((174, 100))
    assert plain.update(last).tolist() == [-1]
    assert centric.update(last).tolist() == [1]


def test_all_run_side_by_side():
    lines, _ = compare(4, 1, 60)
    names = [line.tracker for line in lines]
    assert names[:6] == [OURS, WITH_WARP, WITH_IDENTITIES, "SORT", "ByteTrack", "OC-SORT"]
    assert all(line.median_ms > 0 for line in lines)
    assert "fewest of a peer" in verdict(lines)
