"""Motion of the camera that nothing told of: seen from all boxes at once, and no track breaks by it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.support.snapshots import STEP, boxes
from vision.detect.boxes import wrap
from vision.track.alignment import BoxShapes, Lens, align
from vision.track.tracker import Tracker
from vision.track.tracks import TrackerParams

MODEST = settings(max_examples=20, deadline=None)
SEED = st.integers(0, 10_000)
SIZE = (1920, 1080)
MIDDLE = np.array([960.0, 540.0])
W, H = 36.0, 24.0
LENGTH = np.sqrt(W * H)


def rows(centre, angle=0.0, w=W, h=H):
    return np.column_stack([centre, np.broadcast_to([w, h], (len(centre), 2)), np.broadcast_to(angle, len(centre))])


def aligned(tracks, seen, *, usual_px=20.0, focal_px=np.inf, reach=120.0):
    n = len(tracks)
    return align(
        BoxShapes.of(tracks),
        np.full(n, 4.0),
        BoxShapes.of(seen),
        worth=np.full(n, 22.0),
        reach=np.full(n, reach),
        usual_px=usual_px,
        lens=Lens(middle=MIDDLE, focal_px=focal_px),
    )


def mapped(H, points):
    x, y, w = H @ np.column_stack([points, np.ones(len(points))]).T
    return np.column_stack([x / w, y / w])


def about_middle(turn, zoom, shift):
    """(3, 3) similarity about the middle of the image."""
    c, s = zoom * np.cos(turn), zoom * np.sin(turn)
    A = np.array([[c, -s], [s, c]])
    out = np.eye(3)
    out[:2, :2], out[:2, 2] = A, MIDDLE - A @ MIDDLE + shift
    return out


@MODEST
@given(SEED)
def test_shift_turn_and_scale_are_found_among_missed_and_foreign_boxes(seed):
    rng = np.random.default_rng(seed)
    place = rng.uniform((300, 200), (1600, 900), (12, 2))
    turn, zoom, shift = rng.normal(0, 0.03), np.exp(rng.normal(0, 0.01)), rng.uniform(-50, 50, 2)
    true = about_middle(turn, zoom, shift)
    seen = mapped(true, place) + rng.normal(0, 1.0, place.shape)
    keep = rng.permutation(12)[:9]
    foreign = rng.uniform((0, 0), SIZE, (3, 2))
    found = aligned(rows(place), rows(np.vstack([seen[keep], foreign]), turn))
    np.testing.assert_allclose(mapped(found.H, place), mapped(true, place), atol=6.0)


@MODEST
@given(SEED)
def test_a_camera_that_turns_up_and_sideways_moves_the_image_by_its_perspective(seed):
    """Places far apart, and a turn whose perspective is far beyond the noise: found where the focal length is known."""
    rng = np.random.default_rng(seed)
    focal, tilt = 1400.0, np.radians(rng.uniform(-3, 3, 2))
    K = np.array([[focal, 0, MIDDLE[0]], [0, focal, MIDDLE[1]], [0, 0, 1]])
    a, b = tilt
    Rx = np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])
    Ry = np.array([[np.cos(b), 0, np.sin(b)], [0, 1, 0], [-np.sin(b), 0, np.cos(b)]])
    true = K @ Rx @ Ry @ np.linalg.inv(K)
    place = rng.uniform((100, 100), (1820, 980), (15, 2))
    seen = mapped(true, place) + rng.normal(0, 0.5, place.shape)
    found = aligned(rows(place), rows(seen), focal_px=focal)
    np.testing.assert_allclose(mapped(found.H, place), mapped(true, place), atol=4.5)


@pytest.mark.parametrize("missed", [None, 0, 8])
def test_a_regular_formation_is_not_shifted_by_one_place(missed):
    grid = MIDDLE + 70.0 * np.array([(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1)])
    # it moved by a fifth of the spacing
    seen = np.delete(np.add(grid, (14.0, -6.0)), [] if missed is None else [missed], axis=0)
    found = aligned(rows(grid), rows(seen))
    np.testing.assert_allclose(mapped(found.H, grid), np.add(grid, (14.0, -6.0)), atol=2.0)


def test_a_column_whose_end_is_missed_is_not_shifted_by_one_place():
    column = MIDDLE + 60.0 * np.array([(i, 0.0) for i in range(-3, 4)])
    for missed in (0, 6):
        found = aligned(rows(column), rows(np.delete(np.add(column, (4.0, 4.0)), missed, axis=0)))
        np.testing.assert_allclose(mapped(found.H, column), np.add(column, (4.0, 4.0)), atol=2.0)


def test_vehicles_that_drive_their_own_ways_show_no_motion_of_the_camera():
    rng = np.random.default_rng(2)
    place = rng.uniform((300, 200), (1600, 900), (9, 2))
    seen = place + 1.5 * np.column_stack([np.cos(np.arange(9.0)), np.sin(np.arange(9.0))])
    np.testing.assert_array_equal(aligned(rows(place), rows(seen)).H, np.eye(3))
    strangers = rng.uniform((300, 200), (1600, 900), (2, 2))
    np.testing.assert_array_equal(aligned(rows(place), rows(strangers), usual_px=7.0).H, np.eye(3))


def test_boxes_of_another_size_or_direction_are_no_evidence():
    place = MIDDLE + np.array([(0.0, 0.0), (200.0, 10.0), (90.0, 150.0)])
    assert aligned(rows(place), rows(np.add(place, (50.0, 0.0)))).moved_px == pytest.approx(50.0, abs=0.5)
    assert aligned(rows(place), rows(np.add(place, (50.0, 0.0)), w=3 * W, h=3 * H)).moved_px == 0.0
    assert aligned(rows(place), rows(np.add(place, (50.0, 0.0)), angle=np.pi / 2)).moved_px == 0.0


def test_two_tracks_show_a_shift_and_nothing_else():
    place = MIDDLE + np.array([(-100.0, 0.0), (100.0, 0.0)])
    found = aligned(rows(place), rows(np.add(place, (0.0, 45.0))))
    np.testing.assert_allclose(found.H, [[1, 0, 0], [0, 1, 45], [0, 0, 1]], atol=1e-6)
    turned = MIDDLE + np.array([(-100.0, -40.0), (100.0, 40.0)])
    assert aligned(rows(place), rows(turned)).moved_px < 1.0


def shaken(seed, jump_px, n=7, frames=40, turn=0.01, miss=0.03, fps=10.0):
    """A camera that is thrown to and fro each frame above vehicles with ways of their own; boxes and who they are."""
    rng = np.random.default_rng(seed)
    place = MIDDLE + np.stack([rng.uniform(-500, 500, n), 110.0 * (np.arange(n) - n / 2)], axis=1)
    speed = np.stack([rng.uniform(-60, 60, n), rng.uniform(-8, 8, n)], axis=1)
    course = np.arctan2(speed[:, 1], speed[:, 0])
    for k in range(frames):
        t = k / fps
        camera = about_middle(rng.normal(0, turn), 1.0, rng.normal(0, jump_px / 2, 2))
        at = mapped(camera, place + speed * t) + rng.normal(0, 1.0, (n, 2))
        who = np.flatnonzero(rng.random(n) > miss)
        foreign = rng.uniform((0, 0), SIZE, (rng.poisson(0.3), 2))
        turned = wrap(course + np.arctan2(camera[1, 0], camera[0, 0]))
        angle = np.concatenate([turned[who], rng.uniform(-3, 3, len(foreign))])
        centre = np.vstack([at[who], foreign])
        yield boxes(centre, angle, w=W, h=H), np.concatenate([who, np.full(len(foreign), -1)])


def broken(film, **given):
    """Times that a vehicle's track was another than its last one."""
    tracker, last, count = Tracker(TrackerParams(frame_size=SIZE)), {}, 0
    for k, (seen, who) in enumerate(film):
        tracks = tracker.update(seen, k * STEP, **given)
        for track, detection in zip(tracks.track_id.tolist(), tracks.detection.tolist(), strict=True):
            vehicle = int(who[detection]) if detection >= 0 else -1
            if vehicle >= 0:
                # the first two frames show no velocity yet
                count += last.get(vehicle, track) != track and k > 2
                last[vehicle] = track
    return count


@pytest.mark.slow
@MODEST
@given(SEED)
def test_jumps_of_twice_the_vehicles_size_break_no_track(seed):
    """1σ of the difference of two frames is 0.8 sizes in each axis: one jump of twenty is twice as large."""
    assert broken(shaken(seed, jump_px=1.1 * LENGTH)) <= 1


@pytest.mark.slow
@MODEST
@given(SEED)
def test_a_wrong_warp_is_left_out(seed):
    wrong = about_middle(0.02, 1.0, (60.0, -40.0))
    assert broken(shaken(seed, jump_px=0.1 * LENGTH, turn=0.0), warp=wrong) <= 1
