"""Names are doubted as far as others may drive beside our vehicles."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from assoc.hypotheses.look_alikes import discount_lookalikes, discounts, unseen_evidence
from assoc.hypotheses.marginals import best_assignment, marginals

BIAS_STD_M, CHANCE, SPREAD_M = 1.5, 0.02, 12.0


def discounted(score, bias=0.0, age_s=20.0, chance=CHANCE, inherited=0.0):
    score = np.array(score, np.float64)
    inherited = np.broadcast_to(np.asarray(inherited, np.float64), score.shape)
    bias = np.broadcast_to(bias, (*score.shape, 2))
    age = np.broadcast_to(np.asarray(age_s, np.float64), len(score))
    none_in_view = np.zeros(score.shape[1])
    found = discounts(score, inherited, bias, BIAS_STD_M, chance, none_in_view, age, best_assignment(score))
    return discount_lookalikes(score, found)


def unseen(score, vehicle, chance=CHANCE):
    score = np.array(score, np.float64)
    bias, age_s = np.zeros((*score.shape, 2)), np.full(len(score), 20.0)
    vehicle = np.array(vehicle)
    found = discounts(score, 0.0 * score, bias, BIAS_STD_M, chance, np.zeros(score.shape[1]), age_s, vehicle)
    return unseen_evidence(found, vehicle)


@settings(max_examples=25)
@given(st.integers(0, 10_000), st.integers(1, 3), st.integers(1, 3))
def test_an_assignment_weighs_as_much_whichever_way_its_look_alikes_are_counted(seed, m, n):
    """Σ L + Σ ln D over the unseen is Σ (L − ln D) over the seen and Σ ln D over all."""
    rng = np.random.default_rng(seed)
    score = rng.normal(8.0, 4.0, (m, n))
    vehicle = best_assignment(score)
    rows = np.flatnonzero(vehicle >= 0)
    of_all = unseen(score, np.full(m, -1))
    left = discounted(score)[rows, vehicle[rows]].sum()
    assert score[rows, vehicle[rows]].sum() + unseen(score, vehicle) == pytest.approx(left + of_all, abs=1e-9)


def test_an_unseen_vehicle_counts_for_an_assignment_as_far_as_a_track_drives_beside_it():
    assert unseen([[30.0]], [0]) == 0.0
    assert unseen([[30.0]], [-1]) > 15.0
    assert unseen([[-30.0]], [-1]) == pytest.approx(np.log1p(-CHANCE))


@settings(max_examples=25)
@given(st.integers(0, 10_000), st.floats(-5.0, 30.0), st.floats(0.0, 6.0))
def test_doubt_is_bayes_rule_with_a_stranger_beside_the_vehicle(seed, score, distance_m):
    """One track, one vehicle: a stranger has the pair's likelihood, its offset spread evenly over some metres."""
    chance = np.random.default_rng(seed).uniform(1e-4, 0.2)
    got = discounted([[score]], bias=[distance_m, 0.0], chance=chance)[0, 0]
    pair = np.exp(score)
    offset_density = min(np.exp(-(distance_m**2) / (2.0 * BIAS_STD_M**2)), 1.0)
    offset_density = max(offset_density, np.exp(-5.0))  # receivers may be worse than their model
    follower = pair / offset_density * (BIAS_STD_M / SPREAD_M) ** 2
    assert got == pytest.approx(score - np.log((1.0 - chance) + chance * follower), abs=1e-9)


def test_what_a_vehicles_reports_say_is_not_held_against_anothers_name():
    """Reports that their own past explains badly speak for every track that moves alike, and tell no track apart."""
    score = np.array([[62.0, 70.0], [60.0, 75.0]])
    left = discounted(score)
    np.testing.assert_allclose(left[0] - left[1], score[0] - score[1])
    assert marginals(left)[0, 0] > 0.9


def test_a_new_track_is_not_outweighed_by_the_age_of_its_neighbours():
    score = [[12.0, -5.0], [25.0, 40.0]]
    assert marginals(discounted(score, age_s=[1.0, 30.0]))[0, 0] > 0.9
    assert marginals(discounted(score, age_s=[30.0, 30.0]))[0, 0] < 0.5


def test_what_is_left_of_a_score_after_a_change_of_vehicle_tells_nothing_of_a_neighbour():
    """A clear track keeps its best score less ln of the chance of a change for all: more than a weak one has."""
    score, inherited = [[100.0, 77.0], [40.0, 60.0]], [[0.0, 100.0], [60.0, 0.0]]
    p = marginals(discounted(score, inherited=inherited))
    assert p[0, 0] > 0.99
    assert p[1, 1] > 0.99


@pytest.mark.parametrize("log_chance", [-5.0, -15.0, -25.0])
def test_two_that_come_out_of_one_box_keep_their_names_however_likely_a_change_was(log_chance):
    """What a change leaves of the stronger track's score would else outweigh the weaker one's own."""
    score = np.array([[32.0, 2.0], [64.0 + log_chance, 64.0]])
    p = marginals(discounted(score, age_s=6.0, inherited=[[0.0, 0.0], [64.0, 0.0]]))
    assert p[0, 0] > 0.99
    assert p[1, 1] > 0.99


def test_a_rest_of_a_score_for_a_vehicle_that_another_track_is_names_nobody():
    """A stranger's best score is for a vehicle with a box of its own; what is left of it for a third one is no name."""
    score = [[97.0, 117.0, 88.0], [94.0, 136.0, 88.0], [34.0, -1.0, -8.0]]
    bias = np.zeros((3, 3, 2))
    bias[0, :, 0], bias[1, ::2, 0], bias[2, 1:, 0] = 9.0, 9.0, 9.0
    inherited = [[117.0, 0.0, 117.0], [136.0, 0.0, 136.0], [0.0, 34.0, 34.0]]
    p = marginals(discounted(score, bias=bias, age_s=[78.0, 39.0, 6.0], inherited=inherited))
    assert p[0, 0] < 0.1
    assert p[2, 0] > 0.9
