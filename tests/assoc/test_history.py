"""What was seen, and which sightings belong to one unbroken track."""

from __future__ import annotations

import numpy as np
import pytest

from assoc.history import TrackHistory
from assoc.records import Observation
from tests.support.assoc_scene import camera


def observation(track_id, unseen=()):
    m = len(track_id)
    gap = np.array([0.1 if key in unseen else 0.0 for key in track_id])
    ray = np.tile([0.0, 0.0, 1.0], (m, 1))
    return Observation(
        t_us=0, track_id=np.array(track_id, np.int64), ray_cam=ray, front_cam=ray, gap_s=gap, score=np.ones(m)
    )


def seen_at(times, unseen_at=(), track_id=(1, 2)):
    """A history of frames; track 1 is not seen in some."""
    kept = TrackHistory(20.0, 0.09, 0.6)
    for t in times:
        kept.append(t, observation(track_id, unseen=(1,) if t in unseen_at else ()), camera())
    return kept


TENTHS = tuple(k / 10 for k in range(8))


def test_a_track_has_one_column_while_it_is_seen():
    kept = seen_at(TENTHS)
    assert kept.track_id[:2].tolist() == [1, 2]
    assert np.isfinite(kept.ray[: kept.n, :2]).all()


@pytest.mark.parametrize("hole", ["nobody looked", "looked and not seen"])
def test_after_a_hole_that_is_not_bridged_a_track_begins_anew(hole):
    looks = (0.8, 0.9, 1.0, 1.1, 1.2, 1.3) if hole == "looked and not seen" else ()
    kept = seen_at((*TENTHS, *looks, 1.4), unseen_at=looks)
    column = int(np.flatnonzero(kept.track_id == 1)[0])
    assert kept.first_s[column] == 1.4
    assert kept.track_id[0] == -1
    assert kept.before[column] == 0
    assert kept.last_s[0] == 0.7
    assert np.isnan(kept.ray[: kept.n - 1, column]).all()


@pytest.mark.parametrize("looks", [(0.8, 0.9, 1.0, 1.1), ()])
def test_a_short_hole_is_no_end(looks):
    kept = seen_at((*TENTHS, *looks, 1.2), unseen_at=looks)
    assert kept.track_id[:2].tolist() == [1, 2]


def test_where_looks_are_far_apart_nobody_was_out_of_sight():
    kept = seen_at(range(8))
    assert kept.track_id[:2].tolist() == [1, 2]


@pytest.mark.parametrize("step_s", [0.5, 1.0])
def test_where_looks_are_far_apart_a_missed_one_is_a_hole(step_s):
    times = [step_s * k for k in range(8)]
    assert seen_at(times, unseen_at=times[6:7]).track_id[0] == -1


def test_columns_of_broken_tracks_are_freed_in_time():
    kept = seen_at((*TENTHS, 1.4))
    assert kept.release(1.0).tolist() == [0, 1]
    assert sorted(kept.track_id.tolist())[-2:] == [1, 2]
    assert kept.append(1.5, observation((1, 2, 3)), camera()).tolist() == [0]
    assert kept.before[0] == -1
