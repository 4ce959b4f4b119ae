"""Which tracks may go on with another vehicle."""

import numpy as np
import pytest

from assoc.history import TrackHistory
from assoc.records import Observation
from assoc.tracks.track_handover import exchangeable
from tests.support.assoc_scene import camera


def history(places_px):
    """Tracks 1, 2, … seen at t = 0 and 0.1 s, straight below a camera: rays as they are told, metres at one metre."""
    kept = TrackHistory(20.0, 0.09, 0.6)
    rays = np.array([[x, 0.0, 1.0] for x in places_px])
    m = len(rays)
    for t in (0.0, 0.1):
        kept.append(
            t,
            Observation(
                t_us=0,
                track_id=np.arange(1, m + 1),
                ray_cam=rays / np.linalg.norm(rays, axis=1, keepdims=True),
                front_cam=rays,
                gap_s=np.zeros(m),
                score=np.ones(m),
            ),
            camera(),
        )
    return kept


@pytest.mark.parametrize(("gap_s", "may"), [(0.7, [True, True, False]), (30.0, [True, True, True])])
def test_over_a_gap_tracks_may_change_with_those_that_are_near_for_its_length(gap_s, may):
    kept = history([0.0, 0.05, 0.9])  # 40 m above the ground: 2 m and 36 m apart
    assert exchangeable(0.1 + gap_s, kept, np.array([0, 1, 2]), np.zeros(9)).tolist() == may


def test_one_alone_and_those_that_never_broke_off_change_with_nobody():
    kept = history([0.0, 0.05, 0.9])
    assert not exchangeable(1.0, kept, np.array([0, -1, -1]), np.zeros(9)).any()
    assert exchangeable(1.0, kept, np.array([-1, 1, 0]), np.zeros(9)).tolist() == [False, True, True]
