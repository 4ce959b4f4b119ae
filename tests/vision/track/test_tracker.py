"""The tracker: what must not depend on order or place, what must survive, what must end."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.support.snapshots import STEP, boxes
from vision.detect.detections import Detections
from vision.track import kalman
from vision.track.matching import Pairs, assign
from vision.track.tracker import Tracker
from vision.track.tracks import TrackerParams

MODEST = settings(max_examples=25, deadline=None)
SEED = st.integers(0, 10_000)


def mapped(H, points):
    """Points (k, 2) through the homography H (3, 3)."""
    x, y, w = H @ np.column_stack([points, np.ones(len(points))]).T
    return np.column_stack([x / w, y / w])


def traffic(seed, n=6, frames=25, noise=1.0, miss=0.05):
    """Vehicles in lanes 80 px apart; per frame the detections and who they are."""
    rng = np.random.default_rng(seed)
    place = np.stack([rng.uniform(100, 500, n), 100 + 80.0 * np.arange(n)], axis=1)
    speed = np.stack([rng.uniform(-120, 120, n), rng.uniform(-5, 5, n)], axis=1)
    for k in range(frames):
        who = np.nonzero(rng.random(n) >= miss)[0]
        at = place[who] + speed[who] * k * 0.1 + rng.normal(0, noise, (len(who), 2))
        yield boxes(at, score=rng.uniform(0.55, 0.95, len(who)), heading=np.full(len(who), np.pi / 2)), who


def identities(tracks, who):
    """vehicle → track id of the detections of one frame."""
    return {int(who[d]): int(i) for i, d in zip(tracks.track_id, tracks.detection, strict=True) if d >= 0}


@MODEST
@given(SEED)
def test_lanes_keep_their_ids(seed):
    tracker, first = Tracker(), {}
    for k, (seen, who) in enumerate(traffic(seed)):
        for vehicle, track_id in identities(tracker.update(seen, k * STEP), who).items():
            assert first.setdefault(vehicle, track_id) == track_id
    assert sorted(first.values()) == list(range(1, len(first) + 1))


@pytest.mark.slow
@MODEST
@given(SEED)
def test_order_of_detections_does_not_matter(seed):
    rng = np.random.default_rng(seed)
    one, other = Tracker(), Tracker()
    for k, (seen, _) in enumerate(traffic(seed, noise=4.0, miss=0.2)):
        order = rng.permutation(len(seen))
        a, b = one.update(seen, k * STEP), other.update(seen.select(order), k * STEP)
        np.testing.assert_array_equal(a.track_id, b.track_id)
        np.testing.assert_allclose(a.boxes, b.boxes, rtol=1e-12)
        # the last entry answers for -1, unseen
        np.testing.assert_array_equal(a.detection, np.append(order, -1)[b.detection])


@pytest.mark.slow
@MODEST
@given(SEED)
def test_any_boxes_are_taken_at_most_once_and_ids_are_never_reused(seed):
    rng = np.random.default_rng(seed)
    tracker, ended, alive, t_us = Tracker(), set(), set(), 0
    for _ in range(40):
        n = int(rng.integers(0, 12))
        t_us += int(rng.integers(0, 900_000))
        heading = np.where(rng.random(n) < 0.5, np.nan, rng.uniform(0, 6, n))
        seen = boxes(
            rng.uniform(0, 300, (n, 2)), rng.uniform(-4, 4, n), rng.uniform(0, 1, n), heading, w=rng.uniform(0, 60, n)
        )
        tracks = tracker.update(seen, t_us)
        used = tracks.detection[tracks.detection >= 0]
        assert len(set(used.tolist())) == len(used) and (used < n).all()
        assert (np.diff(tracks.track_id) > 0).all()
        now = set(tracks.track_id.tolist())
        assert not now & ended
        ended |= alive - now
        alive = now
        assert np.isfinite(tracks.boxes).all() and (tracks.gap_s <= 2.5).all()
        np.testing.assert_array_equal(tracks.detection >= 0, tracks.gap_s == 0)


@MODEST
@given(SEED, st.floats(-3, 3), st.floats(0.7, 1.4))
def test_a_turning_zooming_camera_told_by_warps_changes_nothing(seed, turn, zoom):
    """Tracking in frames that a similarity moved equals moving the tracks."""
    c, s = zoom * np.cos(turn), zoom * np.sin(turn)
    H = np.array([[c, -s, 30.0], [s, c, -20.0], [0.0, 0.0, 1.0]])
    # sizes are relative to the box, so that zooming changes no gate
    params = TrackerParams(centre_noise=0.1)
    still, moving = Tracker(params), Tracker(params)
    for k, (seen, _) in enumerate(traffic(seed, frames=12)):
        a = still.update(seen, k * STEP)
        if k >= 6:
            seen = boxes(
                mapped(H, seen.centre),
                turn,
                seen.score,
                np.mod(seen.heading + turn, 2 * np.pi),
                40 * zoom,
                20 * zoom,
            )
        b = moving.update(seen, k * STEP, warp=H if k == 6 else None)
        np.testing.assert_array_equal(a.track_id, b.track_id)
        np.testing.assert_array_equal(a.detection, b.detection)
    np.testing.assert_allclose(mapped(H, np.stack([a.cx, a.cy], axis=1)), np.stack([b.cx, b.cy], axis=1), atol=1e-6)
    np.testing.assert_allclose(np.stack([a.w, a.h]) * zoom, np.stack([b.w, b.h]), rtol=1e-9)
    np.testing.assert_allclose(np.cos(a.heading + turn - b.heading), 1.0, atol=1e-9)


def test_a_jerk_of_the_camera_is_survived_with_a_warp():
    tracker = Tracker()
    where = np.array([[100.0, 100.0], [170.0, 100.0], [240.0, 100.0]])
    for k in range(5):
        tracks = tracker.update(boxes(where), k * STEP)
    H = np.array([[1.0, 0.0, 70.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    moved = tracker.update(boxes(where + np.array([70, 0])), 5 * STEP, warp=H)
    assert moved.track_id.tolist() == tracks.track_id.tolist() == [1, 2, 3]
    assert moved.detection.tolist() == tracks.detection.tolist()


def test_expected_places_hold_the_tracks_own_motion_and_the_warp_alone():
    tracker, start = Tracker(), np.array([[100.0, 100.0], [300.0, 100.0], [500.0, 100.0], [700.0, 100.0]])
    assert np.isnan(tracker.update(boxes(start), 0).expected).all()
    for k in range(1, 12):
        tracker.update(boxes(np.add(start, (5.0 * k, 0.0))), k * STEP)
    H = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 20.0], [0.0, 0.0, 1.0]])
    # the camera moved by (20, 20) px, and the warp knows half of it; another vehicle comes in
    seen = np.vstack([np.add(start, (80.0, 20.0)), [[900.0, 400.0]]])
    tracks = tracker.update(boxes(seen), 12 * STEP, warp=H)
    assert tracks.detection.tolist() == [0, 1, 2, 3, 4]
    np.testing.assert_allclose(tracks.expected[:4], np.add(start, (60.0, 20.0)), atol=1.0)
    assert np.isnan(tracks.expected[4]).all()


def test_tracks_coast_end_and_begin_anew():
    tracker = Tracker()
    for k in range(30):
        tracks = tracker.update(boxes([100 + 10.0 * k, 50.0]), k * STEP)
    assert (tracks.hits.tolist(), tracks.age_s[0]) == ([30], pytest.approx(2.9))
    assert tracks.vx[0] == pytest.approx(100.0, abs=1.0)
    for k in range(30, 54):
        tracks = tracker.update(Detections.empty(), k * STEP)
        assert tracks.track_id.tolist() == [1] and tracks.detection.tolist() == [-1]
    assert tracks.cx[0] == pytest.approx(100 + 530.0, abs=5.0)
    assert tracks.gap_s[0] == pytest.approx(2.4)
    assert len(tracker.update(Detections.empty(), 56 * STEP)) == 0
    # one that looks nearly as usual is reported with its second box
    found = [tracker.update(boxes([100.0, 50.0]), k * STEP).track_id.tolist() for k in (57, 58)]
    assert found == [[], [2]]


def test_a_single_sighting_ends_soon_and_a_short_track_after_a_second():
    once, short = Tracker(), Tracker()
    once.update(boxes([50.0, 50.0]), 0)
    assert len(once.update(Detections.empty(), 3 * STEP)) == 1
    assert len(once.update(Detections.empty(), 4 * STEP)) == 0
    for k in range(3):
        short.update(boxes([50.0, 50.0]), k * STEP)
    assert len(short.update(Detections.empty(), 12 * STEP)) == 1
    assert len(short.update(Detections.empty(), 13 * STEP)) == 0


def test_dropped_frames_are_bridged_by_their_time():
    tracker = Tracker()
    for k in (0, 1, 2, 3, 4, 10, 11, 19):
        at = np.array([[100 + 15.0 * k, 50.0], [900 - 15.0 * k, 90.0]])
        tracks = tracker.update(boxes(at), k * STEP)
        assert tracks.track_id.tolist() == [1, 2] and tracks.detection.tolist() == [0, 1]


def test_time_that_stands_still_or_goes_back_harms_nothing():
    tracker = Tracker()
    for t_us in (1_000_000, 1_000_000, 500_000, 600_000):
        tracks = tracker.update(boxes([50.0, 50.0]), t_us)
    assert tracks.track_id.tolist() == [1] and tracks.age_s[0] == pytest.approx(0.1)


def test_doubtful_boxes_continue_tracks_but_begin_none():
    tracker = Tracker()
    for k in range(4):
        tracker.update(boxes([50.0, 50.0]), k * STEP)
    tracks = tracker.update(boxes([[51.0, 50.0], [200.0, 200.0]], score=0.2), 4 * STEP)
    assert tracks.track_id.tolist() == [1] and tracks.detection.tolist() == [0]
    begun = Tracker()
    assert [len(begun.update(boxes([50.0, 50.0], score=0.35), k * STEP)) for k in range(3)] == [0, 1, 1]


def test_a_double_box_begins_no_track():
    tracker = Tracker()
    tracker.update(boxes([50.0, 50.0]), 0)
    assert len(tracker.update(boxes([[50.0, 50.0], [51.0, 51.0]], score=np.array([0.9, 0.6])), STEP)) == 1


def test_front_is_voted_and_a_flipped_sighting_is_outvoted():
    tracker = Tracker()
    for k in range(20):
        flipped = k % 4 == 3
        angle = 0.3 + (np.pi if flipped else 0.0)
        tracks = tracker.update(boxes([50.0, 50.0], angle=angle, heading=(angle + np.pi / 2) % (2 * np.pi)), k * STEP)
        assert tracks.heading[0] == pytest.approx(0.3 + np.pi / 2, abs=1e-6)
        assert tracks.angle[0] == pytest.approx(0.3, abs=1e-6)
    for k in range(20, 32):
        tracks = tracker.update(boxes([50.0, 50.0], angle=0.3, heading=0.3 + 1.5 * np.pi), k * STEP)
    assert tracks.heading[0] == pytest.approx(0.3 + 1.5 * np.pi, abs=1e-6)


def test_unknown_front_stays_unknown_and_swapped_sides_of_a_square_are_seen_through():
    tracker = Tracker()
    for k in range(10):
        turned = k % 2 == 1
        w, h = (20.0, 24.0) if turned else (24.0, 20.0)
        tracks = tracker.update(boxes([50.0, 50.0], angle=np.pi / 2 if turned else 0.0, w=w, h=h), k * STEP)
    assert np.isnan(tracks.heading[0])
    assert (tracks.w[0], tracks.h[0]) == (pytest.approx(24.0), pytest.approx(20.0))
    assert np.sin(tracks.angle[0]) == pytest.approx(0.0, abs=1e-9)


def test_a_stitch_continues_a_lost_track_elsewhere():
    asked = []

    def stitch(track_id, centre):
        asked.append((track_id.tolist(), centre.tolist()))
        return np.array([[0, 0], [0, 0], [7, 0]])  # a repeated and an impossible pair are passed over

    tracker = Tracker()
    for k in range(10):
        tracker.update(boxes([50.0, 50.0]), k * STEP, stitch=stitch)
    for k in range(10, 15):
        tracker.update(Detections.empty(), k * STEP, stitch=stitch)
    assert not asked
    tracks = tracker.update(boxes([200.0, 200.0]), 15 * STEP, stitch=stitch)
    assert asked == [([1], [[200.0, 200.0]])]
    assert (tracks.track_id.tolist(), tracks.hits.tolist(), tracks.cx.tolist()) == ([1], [11], [200.0])


@pytest.mark.parametrize(("steps", "place"), [(2, 120.0), (6, 900.0)])
def test_a_stitch_reaches_no_further_than_vehicles_drive(steps, place):
    tracker = Tracker()
    for k in range(10):
        tracker.update(boxes([50.0, 50.0]), k * STEP)
    for k in range(10, 9 + steps):
        tracker.update(Detections.empty(), k * STEP)
    first = np.array([[0, 0]])
    tracks = tracker.update(boxes([place, place]), (9 + steps) * STEP, stitch=lambda *_: first)
    assert tracks.track_id.tolist() == [1, 2]


def test_a_stitch_may_find_nothing():
    tracker = Tracker()
    for k in range(4):
        tracker.update(boxes([50.0, 50.0]), k * STEP)
    nothing = np.empty((0, 2), dtype=int)
    assert tracker.update(boxes([400.0, 400.0]), 5 * STEP, stitch=lambda *_: nothing).track_id.tolist() == [1, 2]


def test_a_track_that_left_the_frame_gives_its_id_to_nobody():
    tracker = Tracker(TrackerParams(frame_size=(640, 480)))
    for k in range(10):
        tracker.update(boxes([100.0 - 10 * k, 50.0]), k * STEP)
    tracker.update(Detections.empty(), 14 * STEP)
    assert tracker.update(boxes([10.0, 60.0]), 25 * STEP).track_id.tolist() == [2]


def test_two_trackers_know_nothing_of_each_other():
    runs = [[Tracker().update(boxes([50.0, 50.0]), 0).track_id.tolist()] for _ in range(2)]
    assert runs == [[[1]], [[1]]]


def test_tracks_cannot_be_written_to():
    tracks = Tracker().update(boxes([50.0, 50.0]), 0)
    with pytest.raises(ValueError, match="read-only"):
        tracks.cx[0] = 1.0


@MODEST
@given(SEED)
def test_assignment_is_the_cheapest(seed):
    rng = np.random.default_rng(seed)
    rows, columns = np.nonzero(rng.random((5, 5)) < 0.4)
    cost = rng.uniform(0, 10, len(rows))
    i, j = assign(rows, columns, cost, 8.0)
    assert len(set(i.tolist())) == len(set(j.tolist())) == len(i)
    table = {(r, c): v for r, c, v in zip(rows.tolist(), columns.tolist(), cost.tolist(), strict=True) if v < 8.0}
    total = sum(table[pair] - 8.0 for pair in zip(i.tolist(), j.tolist(), strict=True))

    def best(row, free):
        if row == 5:
            return 0.0
        return min(
            [best(row + 1, free), *(table[row, c] - 8.0 + best(row + 1, free - {c}) for c in free if (row, c) in table)]
        )

    assert total == pytest.approx(best(0, frozenset(range(5))))


@MODEST
@given(st.floats(0.01, 1.0), st.floats(1.0, 100.0))
def test_prediction_of_two_half_steps_is_that_of_one(dt, wander):
    x, P = kalman.initial(np.array([[3.0, 4.0]]), np.array([2.0]), np.array([50.0]))
    x[0, 2:] = (10.0, -7.0)
    whole = kalman.predict(x, P, dt, np.array([wander]))
    half = kalman.predict(*kalman.predict(x, P, dt / 2, np.array([wander])), dt / 2, np.array([wander]))
    for a, b in zip(whole, half, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-9)


def test_correction_is_the_textbook_one():
    rng = np.random.default_rng(4)
    A = rng.normal(size=(3, 4, 4))
    x, P, z, noise = (
        rng.normal(size=(3, 4)),
        A @ A.transpose(0, 2, 1),
        rng.normal(size=(3, 2)),
        np.array([1.0, 2.0, 3.0]),
    )
    new_x, new_P = kalman.correct(x, P, z, noise)
    H = np.eye(2, 4)
    for k in range(3):
        information = np.linalg.inv(P[k]) + H.T @ H / noise[k] ** 2
        np.testing.assert_allclose(new_P[k], np.linalg.inv(information), atol=1e-9)
        gain = new_P[k] @ H.T / noise[k] ** 2
        np.testing.assert_allclose(new_x[k], x[k] + gain @ (z[k] - x[k, :2]), atol=1e-9)


def test_distances_are_the_textbook_ones():
    rng = np.random.default_rng(5)
    A = rng.normal(size=(4, 4, 4))
    P, offset, noise = A @ A.transpose(0, 2, 1), rng.normal(size=(4, 2)), rng.uniform(0.5, 3.0, 4)
    squared, det = kalman.mahalanobis(offset, P, noise)
    for k in range(4):
        S = P[k, :2, :2] + noise[k] ** 2 * np.eye(2)
        assert squared[k] == pytest.approx(offset[k] @ np.linalg.inv(S) @ offset[k])
        assert det[k] == pytest.approx(np.linalg.det(S))


def test_warping_turns_state_and_covariance_with_the_map_at_their_place():
    H = np.array([[0.9, 0.2, 5.0], [-0.1, 1.1, -3.0], [1e-3, -5e-4, 1.0]])
    rng = np.random.default_rng(6)
    A = rng.normal(size=(3, 4, 4))
    x, P = np.concatenate([rng.uniform(0, 200, (3, 2)), rng.normal(0, 30, (3, 2))], axis=1), A @ A.transpose(0, 2, 1)
    new_x, new_P, _ = kalman.warp(x, P, H)
    step = 1e-4
    for k in range(3):
        p = x[k, :2] + step * np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
        homogeneous = np.column_stack([p, np.ones(3)]) @ H.T
        q = homogeneous[:, :2] / homogeneous[:, 2:]
        T = np.kron(np.eye(2), (q[1:] - q[0]).T / step)
        np.testing.assert_allclose(new_x[k], np.concatenate([q[0], T[:2, :2] @ x[k, 2:]]), atol=1e-3)
        np.testing.assert_allclose(new_P[k], T @ P[k] @ T.T, atol=1e-3)


@MODEST
@given(SEED)
def test_pairs_that_nobody_disputes_are_those_that_the_assignment_takes(seed):
    rng = np.random.default_rng(seed)
    rows, columns = np.nonzero(rng.random((4, 4)) < 0.25)
    pairs = Pairs(rows, columns, rng.uniform(0, 10, len(rows)))
    if pairs.undisputed(9.0):
        assert [x.tolist() for x in assign(*pairs, 9.0)] == [rows.tolist(), columns.tolist()]


def test_importing_brings_no_screen():
    code = "import sys, vision.detect.detector, vision.track.tracker; "
    code += "sys.exit(bool({'textual', 'rich', 'pymavlink'} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.parametrize("pause_us", [STEP, 600_000])
def test_while_no_frame_comes_nobody_loses_its_place_to_a_stranger(pause_us):
    tracker = Tracker()

    def nobody_knows(ids, centres):
        return np.empty((0, 2), int)

    # a vehicle whose owner is known drives on; beside it something flickers twice and is gone
    for k in range(12):
        at = [(100.0 + 4.0 * k, 100.0)] + [(60.0 - 30.0 * (k - 8), 60.0)] * (8 <= k < 10)
        tracker.update(boxes(at), k * STEP, stitch=nobody_knows, known=(1,))
    t_us = 11 * STEP + pause_us
    seen = tracker.update(boxes([(144.0 + 40e-6 * pause_us, 100.0)]), t_us, stitch=nobody_knows, known=(1,))
    assert seen.track_id[seen.detection == 0].tolist() == [1]


@pytest.mark.parametrize("step_us", [500_000, 1_000_000])
def test_where_frames_are_far_apart_a_missed_box_makes_nobody_take_his_neighbours(step_us):
    tracker = Tracker()
    for k in range(8):
        at = [(100.0 + 30.0 * k, 100.0), (100.0 + 30.0 * k, 160.0)]
        # the first vehicle is missed, and then the second
        seen = at[1:] if k == 6 else at[:1] if k == 7 else at
        tracks = tracker.update(boxes(seen), k * step_us, stitch=lambda ids, _: np.empty((0, 2), int), known=(1, 2))
    assert tracks.track_id[tracks.detection == 0].tolist() == [1]


@pytest.mark.parametrize(("looked", "lives"), [(None, False), ([[0, 0, 90, 90]], True), ([[0, 0, 900, 900]], False)])
def test_a_track_where_nobody_looks_is_not_missed(looked, lives):
    tracker = Tracker(TrackerParams(frame_size=(1000, 1000)))
    for k in range(2):
        tracker.update(boxes([[500.0, 500.0]]), k * STEP)
    nothing = replace(Detections.empty(), looked=None if looked is None else np.array(looked, float))
    for k in range(2, 13):
        tracks = tracker.update(nothing, k * STEP)
        if k < 5:
            assert (tracks.missed_s.tolist() == [0.0]) == lives
    assert bool(tracker.living) == lives
