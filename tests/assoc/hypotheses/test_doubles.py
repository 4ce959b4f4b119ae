"""Vehicles that report one place: their motion says nothing about whose the track there is."""

import numpy as np
import pytest

from assoc.hypotheses.doubles import share_discount, share_evidence, shared_tracks, shares_of_two
from assoc.hypotheses.look_alikes import discount_lookalikes, discounts
from assoc.hypotheses.marginals import exact_marginals

BIAS_STD_M, ODDS = 1.0, 6.5
NEAR, ASIDE, FAR = (0.5, 0.0), (4.0, 0.0), (30.0, 0.0)


def named(score, bias, elsewhere=()):
    """(m, n + 1) marginals of scores once the evidence is shared."""
    score = np.array(score)
    apart = np.zeros(score.shape, np.bool_)
    for row, vehicle in elsewhere:
        apart[row, vehicle] = True
    shared = shared_tracks(score, score - ODDS, np.array(bias), BIAS_STD_M, apart)
    return exact_marginals(share_evidence(score, shared)), shared


def test_the_better_fit_of_two_that_report_one_place_is_no_reason_for_a_name():
    before = exact_marginals(np.array([[40.0, 30.0]]))
    after, (double,) = named([[40.0, 30.0]], [[NEAR, NEAR]])
    assert before[0, 0] > 0.999
    assert after[0] == pytest.approx([0.5, 0.5, 0.0], abs=0.01)
    assert (double.row, double.vehicles) == (0, (0, 1))
    assert np.all(double.lies > 0.9)


def test_three_that_report_one_place_share_it():
    after, _ = named([[40.0, 30.0, 35.0]], [[NEAR, NEAR, NEAR]])
    assert after[0] == pytest.approx([1 / 3, 1 / 3, 1 / 3, 0.0], abs=0.01)


def test_beside_the_track_without_a_box_is_no_lie_and_place_tells():
    after, (double,) = named([[40.0, 30.0]], [[NEAR, ASIDE]])
    assert double.lies[1] < 0.5
    assert after[0, 0] > 0.7


@pytest.mark.parametrize(
    ("score", "bias", "elsewhere"),
    [
        pytest.param([[40.0, 30.0], [20.0, 38.0]], [[NEAR, ASIDE], [ASIDE, NEAR]], (), id="a track of its own"),
        pytest.param([[40.0, 30.0]], [[NEAR, NEAR]], [(0, 1)], id="was another track beside this one"),
        pytest.param([[40.0, 30.0]], [[NEAR, FAR]], (), id="reports another place"),
        pytest.param([[40.0, 4.0]], [[NEAR, NEAR]], (), id="no evidence yet"),
    ],
)
def test_nothing_is_shared_with_one_that_has(score, bias, elsewhere):
    after, shared = named(score, bias, elsewhere)
    assert not shared
    np.testing.assert_array_equal(after, exact_marginals(np.array(score)))


def test_the_box_of_the_one_that_lies_is_not_given_to_the_one_it_copies():
    after, _ = named([[40.0, 30.0], [7.5, 7.0]], [[NEAR, NEAR], [ASIDE, ASIDE]])
    assert after[1, 2] > 0.99


@pytest.mark.parametrize(
    ("evidence", "bias", "least", "most"),
    [
        pytest.param((40.0, 40.0), (NEAR, (0.0, 3.0)), 0.5, 0.7, id="three sigma are a bias as well"),
        pytest.param((40.0, 40.0), (NEAR, (0.0, 7.0)), 0.9, 1.0, id="seven are none"),
        pytest.param((40.0, 33.0), (NEAR, NEAR), 0.5, 0.51, id="errors of its own"),
        pytest.param((60.0, 35.0), (NEAR, NEAR), 0.9, 1.0, id="it brakes later than the track"),
        pytest.param((200.0, 180.0), (NEAR, NEAR), 0.5, 0.6, id="errors of its own for long"),
    ],
)
def test_of_two_at_one_place_a_late_one_is_told_by_offset_or_motion(evidence, bias, least, most):
    shares = shares_of_two(np.array(evidence), np.array(bias), BIAS_STD_M)
    assert least <= shares[0] <= most
    assert np.sum(shares) == pytest.approx(1.0)


def test_the_distance_of_one_that_copies_counts_once():
    """The chance that the other one drives beside the track unseen is not taken from its score a second time."""
    score, bias = np.array([[40.0, 38.0]]), np.array([[NEAR, (3.0, 0.0)]])
    shared = shared_tracks(score, score - ODDS, bias, BIAS_STD_M, np.zeros((1, 2), np.bool_))
    joint = share_evidence(score, shared)
    found = discounts(joint, 0.0 * joint, bias, BIAS_STD_M, 0.01, np.zeros(2), np.ones(1), np.zeros(1, np.int64))
    reduced = discount_lookalikes(joint, found)
    assert exact_marginals(reduced)[0, 0] > 0.95
    assert exact_marginals(share_discount(joint, reduced, shared))[0, 0] < 0.7
