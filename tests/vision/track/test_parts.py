"""Vehicles that are two boxes now and then: the parts are put together, and two vehicles never are."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vision.detect.detections import Detections
from vision.track.parts import PartJoiner

LENGTH, WIDTH = 60.0, 22.0


def boxes(rows, heading=True, score=0.9):
    """Detections at (cx, cy, length, angle); the front is along the angle."""
    cx, cy, w, angle = np.array(rows, np.float64).reshape(-1, 4).T
    n = len(cx)
    return Detections(
        cx=cx,
        cy=cy,
        w=w,
        h=np.full(n, WIDTH),
        angle=angle,
        score=np.full(n, score),
        heading=(angle + np.pi / 2) % (2 * np.pi) if heading else np.full(n, np.nan),
    )


def halves(cx, cy, angle, share=0.5):
    """Front and rear of a vehicle, each a box of its own."""
    along = np.array([np.cos(angle), np.sin(angle)])
    front, rear = share * LENGTH, (1.0 - share) * LENGTH
    a = np.array([cx, cy]) + along * 0.5 * (LENGTH - front)
    b = np.array([cx, cy]) - along * 0.5 * (LENGTH - rear)
    return [(*a, front, angle), (*b, rear, angle)]


def fleet(n, angle=0.3):
    return [(200.0 + 150.0 * k, 400.0 + 40.0 * (k % 3), LENGTH, angle + 0.4 * k) for k in range(n)]


def joined(parts, rows, t_us=0, **more):
    found = boxes(rows, **more)
    return parts.join(t_us, found, np.tile(0.03 * np.eye(2), (len(found), 1, 1)), 0.3), found


@given(angle=st.floats(-3.1, 3.1), share=st.floats(0.38, 0.62), k=st.integers(0, 4))
def test_front_and_rear_among_whole_vehicles_become_one_box(angle, share, k):
    rows = fleet(5)
    place = rows.pop(k)[:2]
    result, _ = joined(PartJoiner(), [*rows, *halves(*place, angle, share)])
    assert len(result.boxes) == 5 and result.second.tolist() == [-1] * 4 + [5]
    assert result.first.tolist() == [0, 1, 2, 3, 4]
    np.testing.assert_allclose(result.boxes.centre[4], place, atol=1e-6)
    assert max(result.boxes.w[4], result.boxes.h[4]) == pytest.approx(LENGTH)
    # its front is where that of its parts is
    assert np.cos(result.boxes.heading[4] - angle - np.pi / 2) == pytest.approx(1.0, abs=1e-6)


def test_a_front_that_nobody_knows_stays_unknown():
    result, _ = joined(PartJoiner(), [*fleet(4), *halves(900.0, 500.0, 0.2)], heading=False)
    assert len(result.boxes) == 5 and np.isnan(result.boxes.heading).all()


@pytest.mark.parametrize("gap", [0.0, 3.0, 8.0])
def test_two_vehicles_bumper_to_bumper_stay_two(gap):
    rows = [*fleet(4), (900.0, 500.0, LENGTH, 0.0), (900.0 + LENGTH + gap, 500.0, LENGTH, 0.0)]
    parts = PartJoiner()
    for frame in range(50):
        result, found = joined(parts, rows, frame * 100_000)
        assert result.boxes is found, "their common length is nobody's"


def test_two_side_by_side_or_at_an_angle_stay_two():
    beside = [(900.0, 500.0, LENGTH / 2, 0.0), (900.0, 500.0 + WIDTH, LENGTH / 2, 0.0)]
    turned = [(1200.0, 500.0, LENGTH / 2, 0.0), (1200.0 + LENGTH / 2, 500.0, LENGTH / 2, np.pi / 3)]
    result, found = joined(PartJoiner(), [*fleet(5), *beside, *turned])
    assert result.boxes is found


def test_small_vehicles_in_a_queue_stay_apart_where_nothing_is_as_long_as_two():
    queue = [(200.0 + 32.0 * k, 300.0, 30.0, 0.0) for k in range(6)]
    parts = PartJoiner()
    for frame in range(20):
        result, _ = joined(parts, queue, frame * 100_000)
    assert len(result.boxes) == 6


def test_what_was_seen_is_remembered_while_all_are_in_two():
    parts = PartJoiner()
    for frame in range(30):
        joined(parts, fleet(4), frame * 100_000)
    split = [half for cx, cy, _, angle in fleet(4) for half in halves(cx, cy, angle)]
    result, _ = joined(parts, split, 3_000_000)
    assert len(result.boxes) == 4
    np.testing.assert_allclose(np.sort(result.boxes.cx), [row[0] for row in fleet(4)], atol=1e-6)


def test_weak_boxes_are_left_alone():
    rows = [*fleet(4), *halves(900.0, 500.0, 0.2)]
    result, found = joined(PartJoiner(), rows, score=0.2)
    assert result.boxes is found


def test_a_vehicle_that_drives_away_from_the_camera_is_as_long_as_one_that_drives_across():
    """Seen from 30° above half as many pixels: only on the ground it is seen to be as long."""
    ground, half = np.diag([0.03, 0.06]), 0.25 * LENGTH
    across = [(200.0 + 150.0 * k, 400.0, LENGTH, 0.0) for k in range(4)]
    found = boxes([*across, *((900.0, 500.0 + side * half / 2, half, np.pi / 2) for side in (-1.0, 1.0))])
    found = replace(found, h=np.where(np.arange(6) < 4, 11.0, 14.0))
    for metres, parts in ((ground, 1), (0.03 * np.eye(2), 2)):
        result = PartJoiner().join(0, found, np.tile(metres, (6, 1, 1)), 0.3)
        assert len(result.boxes) == 4 + parts
