"""How often a vehicle in view has a box, learnt from the flight."""

import numpy as np
import pytest

from assoc.identification.found_share import FoundShare, own_boxes

ALL_IN_VIEW = np.ones(6)


def watched(share, seconds=60.0, view=ALL_IN_VIEW, seed=1):
    """What is learnt where each vehicle has a box for this share of the time."""
    found, rng = FoundShare(6), np.random.default_rng(seed)
    for t in np.arange(0.0, seconds, 0.25):
        found.update(float(t), view, np.flatnonzero(rng.random(len(view)) < share))
    return found


def test_nothing_is_lost_before_anything_was_seen():
    assert FoundShare(6).log_odds_lost == 0.0 and FoundShare(6).trust == 1.0


@pytest.mark.parametrize("share", [0.6, 0.7, 0.8, 0.9])
def test_the_share_is_learnt_within_a_minute(share):
    assert watched(share).share == pytest.approx(share, abs=0.06)


def test_odds_and_trust_fall_with_the_share():
    lost = [watched(share).log_odds_lost for share in (1.0, 0.9, 0.8, 0.7)]
    assert lost[0] == 0.0 and np.all(np.diff(lost) > 0.5)
    assert watched(1.0).trust == 1.0 and watched(0.6).trust < 0.1


def test_vehicles_out_of_view_are_not_missed():
    assert watched(0.0, view=np.full(6, 0.4)).log_odds_lost == 0.0


def test_a_bad_minute_is_forgotten():
    found = watched(0.6)
    bad = found.share
    for t in np.arange(60.0, 240.0, 0.25):
        found.update(float(t), ALL_IN_VIEW, np.arange(6))
    assert bad < 0.7 and found.share > 0.95


def test_one_that_is_never_found_says_nothing_of_the_others():
    found = FoundShare(6)
    for t in np.arange(0.0, 60.0, 0.25):
        found.update(float(t), ALL_IN_VIEW, np.arange(1, 6))
    assert found.log_odds_lost == 0.0 and found.trust == 1.0


def test_a_stranger_far_off_is_no_vehicles_own_box() -> None:
    vehicle, bias = np.array([0, 1, -1]), np.zeros((3, 2, 2))
    bias[1, 1] = 3.0, 4.0
    assert own_boxes(vehicle, bias, 1.5, strangers=True).tolist() == [True, False, False]
    # among ours alone it is a receiver that errs more than others
    assert own_boxes(vehicle, bias, 1.5, strangers=False).tolist() == [True, True, False]
    assert own_boxes(vehicle, bias, 2.0, strangers=True).tolist() == [True, True, False]
