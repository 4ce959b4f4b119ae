"""Vehicles that drive as one: no name is surer than the place of each can make it."""

import numpy as np
import pytest

from assoc.hypotheses.place_alone import StrangerLimit, limit_by_place, log_odds_among_strangers

BIAS_STD_M, SPACING_M = 2.0, 4.0


def named(score, place, sure=0.99, bias_std=BIAS_STD_M):
    """Marginals with each track named as the vehicle of its own number, after the limit."""
    n = len(score)
    p = np.full((n, n + 1), (1.0 - sure) / n)
    p[np.arange(n), np.arange(n)] = sure
    at = np.array(place, np.float64)
    return limit_by_place(p, np.array(score, np.float64), np.linalg.norm(at[:, None] - at, axis=2), bias_std)


def grid(spacing_m):
    return [[spacing_m * (k % 3), spacing_m * (k // 3)] for k in range(9)]


@pytest.mark.parametrize("loss", [3.0, 12.0])
def test_in_a_grid_with_biases_of_half_its_spacing_nothing_is_sure(loss):
    p = named(20.0 + 0.5 * loss * np.eye(9), grid(SPACING_M))
    assert np.max(p) < 0.9
    assert np.all(np.argmax(p, axis=1) == np.arange(9))
    np.testing.assert_allclose(np.sum(p, axis=1), 1.0)


def test_doubt_goes_to_the_neighbours():
    p = named(20.0 + 2.0 * np.eye(3), [[0.0, 0.0], [SPACING_M, 0.0], [50.0, 0.0]])
    assert p[0, 1] > 0.05
    assert p[0, 2] == pytest.approx(0.01 / 3.0)
    assert p[2, 2] == 0.99


def test_wide_spacing_good_receivers_and_motion_leave_names_as_sure_as_they_are():
    alike = 20.0 + 2.0 * np.eye(9)
    assert np.min(np.diagonal(named(alike, grid(30.0)))) == pytest.approx(0.99, abs=1e-3)
    assert np.min(np.diagonal(named(alike, grid(SPACING_M), bias_std=0.2))) == pytest.approx(0.99, abs=1e-3)
    assert np.min(np.diagonal(named(100.0 * np.eye(9), grid(SPACING_M)))) == 0.99


def test_tracks_out_of_sight_and_unnamed_ones_limit_nobody():
    p = named(20.0 + np.eye(2), [[0.0, 0.0], [np.nan, np.nan]])
    assert p[0, 0] == 0.99
    none = np.array([[0.99, 0.0, 0.01], [0.0, 0.05, 0.95]])
    assert limit_by_place(none, np.zeros((2, 2)), np.zeros((2, 2)), BIAS_STD_M)[0, 0] == 0.99


def among_strangers(offset_m, n_strangers, against=0.0, view=1.0, stated=False):
    """The probability that is left of 0.999 for a vehicle whose report is so far off, with strangers 3 m apart."""
    m = 1 + n_strangers
    p = np.zeros((m, 2))
    p[0], p[1:, 1] = [0.999, 0.001], 1.0
    score = np.full((m, 1), 40.0)
    score[1:] = 20.0 - against
    bias = np.zeros((m, 1, 2))
    bias[1:, 0, 1] = 3.0 * np.arange(1, m)
    limit = StrangerLimit()
    for t, offset in enumerate(np.atleast_1d(offset_m)):
        bias[0, 0, 0] = offset
        odds = log_odds_among_strangers(p, score, bias, 1.0, np.array([view]), np.log(2.0 * 3000.0))
        left = limit.limit(float(t), np.arange(1, m + 1), p, odds, np.arange(m) < stated)
    np.testing.assert_allclose(left.sum(axis=1), 1.0)
    return left[0, 0]


def test_a_report_that_goes_wrong_for_seconds_is_no_strangers():
    assert among_strangers([0.0] * 10 + [8.0] * 5, 2) > 0.9
    assert among_strangers([8.0] * 15, 2) < 0.3
    assert among_strangers([0.0] + [8.0] * 90, 2) < 0.3


def test_a_name_far_from_its_report_is_doubted_among_parked_strangers():
    assert among_strangers(0.0, 2) > 0.95
    assert among_strangers(2.5, 2) < 0.9
    assert among_strangers(5.0, 2) < 0.5
    assert np.all(np.diff([among_strangers(2.5, n) for n in (1, 2, 3)]) <= 0.0)


def test_only_strangers_that_move_alike_can_stand_in():
    assert among_strangers(3.0, 0) == 0.999
    assert among_strangers(3.0, 3, against=100.0) == 0.999


def test_what_an_operator_stated_is_not_doubted_for_its_place():
    assert among_strangers(5.0, 3, stated=True) == 0.999


def test_a_vehicle_out_of_view_is_rather_a_stranger():
    assert among_strangers(0.5, 1, view=0.05) < 0.5 < among_strangers(0.5, 1)


def test_the_limit_is_bayes_rule_with_a_vehicle_that_has_no_box():
    """0.9 N(M) against 0.1 λ, a stranger within 6 m."""
    M = 2.0
    density = (0.85 * np.exp(-0.5 * M**2) + 0.15 / 6.0 * np.exp(-(M**2) / 12.0)) / (2.0 * np.pi)
    rate = 1.0 / (np.pi * 36.0)
    assert among_strangers(M, 1) == pytest.approx(min(0.9 * density / (0.9 * density + 0.1 * rate), 0.999))
