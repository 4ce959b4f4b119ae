"""Masses and Dempster's rule, with an answer for every matrix."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from assoc.methods.belief import conflict, fuse, masses, min_max_norm, row_norm

shapes = st.tuples(st.integers(1, 6), st.integers(1, 6))
costs = shapes.flatmap(lambda s: arrays(np.float64, s, elements=st.floats(0, 1e6)))
pairs = shapes.flatmap(
    lambda s: st.tuples(*(arrays(np.float64, s, elements=st.floats(0, 1).map(lambda v: round(v, 6))) for _ in range(2)))
)


@given(costs)
def test_masses_are_distributions_that_prefer_small_costs(cost):
    m = masses(cost)
    np.testing.assert_allclose(m.sum(axis=1), 1.0)
    assert np.all(m >= 0)
    for row, c in zip(m, cost, strict=True):
        assert row[np.argmin(c)] == row.max()


@given(pairs)
def test_fusion_is_a_distribution_commutative_and_keeps_agreement(both):
    a, b = row_norm(both[0]), row_norm(both[1])
    m = fuse(a, b)
    np.testing.assert_allclose(m.sum(axis=1), 1.0)
    np.testing.assert_allclose(m, fuse(b, a), rtol=1e-12)
    K = conflict(a, b)
    assert np.all((K >= 0) & (K <= 1))


@given(pairs)
def test_fusion_is_the_printed_formula_where_that_is_defined(both):
    a, b = row_norm(both[0]), row_norm(both[1])
    K = conflict(a, b)
    printed = a * b / np.where(K < 0.999, 1 - K, 1.0)[:, None]
    rows = K < 0.999
    np.testing.assert_allclose(fuse(a, b)[rows], row_norm(printed)[rows], rtol=1e-9, atol=1e-12)


@given(pairs)
def test_uniform_masses_change_nothing(both):
    a = row_norm(both[0])
    np.testing.assert_allclose(fuse(a, row_norm(np.zeros_like(a))), a, atol=1e-12)


def test_equal_costs_say_nothing():
    np.testing.assert_array_equal(masses(np.full((2, 4), 7.0)), np.full((2, 4), 0.25))


def test_a_row_of_the_worst_costs_says_nothing():
    np.testing.assert_array_equal(masses(np.array([[0.0, 1.0], [1.0, 1.0]])), [[1.0, 0.0], [0.5, 0.5]])


def test_full_conflict_leaves_nothing():
    a, b = np.array([[1.0, 0.0]]), np.array([[0.0, 1.0]])
    assert conflict(a, b)[0] == 1.0
    np.testing.assert_array_equal(fuse(a, b), [[0.5, 0.5]])


def test_published_example_by_hand():
    # K = .6·.3 + .4·.7 = .46; .6·.7/.54 = .7778
    m = fuse(np.array([[0.6, 0.4]]), np.array([[0.7, 0.3]]))
    np.testing.assert_allclose(m, [[0.42 / 0.54, 0.12 / 0.54]])


def test_min_max_survives_extremes():
    assert min_max_norm(np.array([[-1.7e308, 1.7e308]])).tolist() == [[0.0, 1.0]]
    assert min_max_norm(np.empty((0, 3))).shape == (0, 3)
    assert masses(np.empty((2, 0))).shape == (2, 0)
