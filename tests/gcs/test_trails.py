from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gcs.trails import MAX_POINTS, Trails
from mavlink.geodesy import LocalFrame
from tests.support.fake_station import START_US, make_snapshot

BASE = make_snapshot()
S = 1_000_000
HERE, ELSEWHERE = LocalFrame(47.0, 8.0), LocalFrame(48.0, 8.0)


def at(seconds, east, origin=HERE, state="ok"):
    """Vehicle 11 alone, somewhere on a line."""
    row = replace(BASE.vehicles[1], p_enu=np.array([east, 5.0, 0.0]), position_state=state)
    return replace(BASE, t_us=START_US + round(seconds * S), vehicles=(row,), origin=origin)


def trail(trails, seconds, span_s=30.0, origin=HERE):
    found = trails.before(START_US + round(seconds * S), span_s, origin)
    return found[0].p_enu[:, 0].tolist() if found else []


def pieces(line):
    """Without its interruptions: each uninterrupted part."""
    parts = [[]]
    for east in line:
        if np.isnan(east):
            parts.append([])
        else:
            parts[-1].append(east)
    return [part for part in parts if part]


def test_a_trail_is_where_the_vehicle_was():
    trails = Trails()
    for n in range(20):
        trails.add(at(n, 2.0 * n))
    assert trail(trails, 10, span_s=5.0) == [10, 12, 14, 16, 18, 20]
    assert trail(trails, 10, span_s=0.1) == [20]
    assert trails.before(START_US - S, 30.0, HERE) == ()


def test_it_is_the_same_in_whatever_order_the_moments_came():
    """Trails of a replay: first where the operator looks, then from the start."""
    moments = [at(n, 2.0 * n) for n in range(20)]
    forwards, mixed = Trails(), Trails()
    for moment in moments:
        forwards.add(moment)
    for moment in (*moments[12:], *moments[:12], *moments[5:9]):
        mixed.add(moment)
    assert trail(forwards, 15) == trail(mixed, 15) and len(trail(mixed, 15)) == 16


@pytest.mark.parametrize("jump", ["place", "time", "lost"])
def test_no_line_over_what_nobody_knows(jump):
    trails = Trails()
    for n in range(10):
        trails.add(at(n, 2.0 * n))
    if jump == "lost":
        trails.add(at(10, 20.0, state="lost"))
    for n in range(11, 20):
        trails.add(at(n + (20 if jump == "time" else 0), 2.0 * n + (900.0 if jump == "place" else 0.0)))
    first, second = pieces(trail(trails, 60, span_s=120.0))
    assert first[-1] == 18.0 and second[0] == 22.0 + (900.0 if jump == "place" else 0.0)


def test_nothing_about_another_origin_is_drawn():
    trails = Trails()
    trails.add(at(0, 0.0))
    trails.add(at(1, 70_000.0, origin=ELSEWHERE))
    assert trail(trails, 1) == [0.0]
    assert trail(trails, 1, origin=ELSEWHERE) == [70_000.0]


@pytest.mark.slow
def test_a_long_trail_has_few_points_and_two_hours_are_kept_in_little():
    trails = Trails()
    for n in range(40_000):
        trails.add(at(0.5 * n, 1.0 * n))
    assert len(trail(trails, 20_000, span_s=600.0)) <= MAX_POINTS + 1
    assert len(trail(trails, 20_000, span_s=20_000.0)) <= MAX_POINTS + 1
    assert len(pieces(trail(trails, 20_000, span_s=600.0))) == 1


def test_a_place_that_was_not_analysed_counts_for_nothing():
    trails = Trails()
    trails.add(replace(at(0, 0.0), analysed=False))
    assert trail(trails, 1) == []
