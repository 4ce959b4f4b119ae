"""Lost tracks and those that were seen beside them."""

from __future__ import annotations

import numpy as np
import pytest

from assoc.tracks.co_visibility import CoVisibility

COLUMNS = np.arange(3)
FAR = np.array([(0.0, 0.0), (5.0, 0.0), (10.0, 0.0)])
BELIEF = np.array([(0.9, 0.0), (0.05, 0.6), (0.0, 0.2)])


def seen_together(place=FAR, belief=BELIEF):
    company = CoVisibility(2)
    company.begin(COLUMNS, 3)
    company.update(0.0, COLUMNS, place, belief, 3.0)
    return company


def in_sight(*columns):
    return np.isin(COLUMNS, columns)


def test_while_all_are_seen_nothing_is_held_against_anybody():
    assert not seen_together().log_not_lost(COLUMNS, in_sight(0, 1, 2)).any()


def test_a_lost_track_speaks_against_those_beside_it_as_far_as_it_was_believed():
    said = seen_together().log_not_lost(COLUMNS, in_sight(1, 2))
    np.testing.assert_allclose(said, [(0, 0), (np.log(0.1), 0), (np.log(0.1), 0)])


def test_of_two_lost_tracks_the_surer_one_speaks():
    belief = BELIEF.copy()
    belief[1, 0] = 0.5
    said = seen_together(belief=belief).log_not_lost(COLUMNS, in_sight(2))
    np.testing.assert_allclose(said[2], (np.log(0.1), np.log(0.4)))


def test_the_surest_name_may_still_have_been_wrong():
    belief = BELIEF.copy()
    belief[0, 0] = 1.0
    assert seen_together(belief=belief).log_not_lost(COLUMNS, in_sight(1, 2))[1, 0] == -8.0


def test_one_that_began_since_may_be_the_lost_one():
    company = seen_together()
    company.update(0.2, COLUMNS[1:], FAR[1:], BELIEF[1:], 3.0)
    company.begin(np.array([3]), 4)
    company.update(0.4, np.array([1, 2, 3]), FAR, BELIEF, 3.0)
    said = company.log_not_lost(np.arange(4), np.array([False, True, True, True]))
    assert said[3, 0] == 0.0
    assert said[1, 0] < 0.0


@pytest.mark.parametrize("near", [(0.0, 2.0), (np.nan, np.nan)])
def test_one_that_may_have_been_exchanged_with_the_lost_one_may_be_it(near):
    place = FAR.copy()
    place[1] = near
    said = seen_together(place=place).log_not_lost(COLUMNS, in_sight(1, 2))
    assert said[1, 0] == 0.0
    assert said[2, 0] < 0.0


def test_one_that_may_be_another_by_now_is_free_again():
    company = seen_together()
    company.reset(np.array([1]))
    said = company.log_not_lost(COLUMNS, in_sight(1, 2))
    assert said[1, 0] == 0.0
    assert said[2, 0] < 0.0


def test_a_new_track_in_an_old_column_has_no_company():
    company = seen_together()
    company.begin(np.array([0]), 3)
    assert not company.log_not_lost(COLUMNS, in_sight(1, 2)).any()


def test_what_broke_off_claims_those_it_went_on_as():
    company = seen_together()
    said = company.log_handover(np.array([0, 2, -1]), np.full(3, 0.1))
    np.testing.assert_allclose(said, [np.log((0.91, 0.1)), np.log((0.1, 0.28)), (0.0, 0.0)])


@pytest.mark.parametrize(("seconds", "certainty", "known"), [(3, 0.99, False), (10, 0.99, True), (10, 0.9, False)])
def test_a_vehicle_is_elsewhere_once_it_surely_was_another_track_for_long(seconds, certainty, known):
    company = CoVisibility(2)
    company.begin(COLUMNS, 3)
    belief = np.array([(certainty, 0.0), (0.0, 0.0), (0.0, 0.0)])
    for t in np.arange(0.0, seconds, 0.25):
        company.update(float(t), COLUMNS, FAR, belief, 3.0)
    assert company.elsewhere(COLUMNS).tolist() == [[False, False], [known, False], [known, False]]
