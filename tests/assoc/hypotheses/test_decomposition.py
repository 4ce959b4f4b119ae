from itertools import permutations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from assoc.hypotheses.marginals import (
    best_assignment,
    exact_marginals,
    least_losses,
    loopy_marginals,
    marginals,
    separate,
)


def totals(score):
    """All assignments with anybody left alone, as (m,) columns or −1, and their totals."""
    m, n = score.shape
    found = {}
    for columns in permutations([*range(n), *[-1] * m], m):
        found[columns] = sum(score[i, j] for i, j in enumerate(columns) if j >= 0)
    return found


@settings(max_examples=60, deadline=None)
@given(st.integers(1, 4), st.integers(1, 4), st.integers(0, 10**6), st.floats(0.3, 20.0))
def test_losses_never_overstate_what_a_pair_costs(m, n, seed, spread):
    score = np.random.default_rng(seed).normal(2.0, spread, (m, n))
    best = best_assignment(score)
    found = totals(score)
    most = max(found.values())
    loss = least_losses(score, best)
    for i in range(m):
        for j in range(n):
            true = most - max(total for columns, total in found.items() if columns[i] == j)
            assert loss[i, j] <= true + 1e-9
    np.testing.assert_allclose(loss[best >= 0, best[best >= 0]], 0.0, atol=1e-9)


def test_losses_tell_clear_pairs_from_hopeless_ones():
    score = np.array([[30.0, -5.0], [-5.0, 30.0]])
    np.testing.assert_allclose(least_losses(score, best_assignment(score)), [[0.0, 65.0], [65.0, 0.0]])


def test_near_ties_are_not_decided_by_belief_propagation():
    """Two by two and tight, belief propagation is sure of the better of two nearly equal assignments."""
    score = np.array([[12.2, 12.4], [11.5, 12.3]])
    right = 1.0 / (1.0 + np.exp((12.4 + 11.5) - (12.2 + 12.3)))
    assert loopy_marginals(score)[0][0, 0] > 0.95
    np.testing.assert_allclose(marginals(score)[0, 0], right, atol=1e-3)


@settings(max_examples=80, deadline=None)
@given(st.integers(1, 6), st.integers(1, 6), st.integers(0, 10**6), st.floats(-4.0, 15.0), st.floats(0.2, 25.0))
def test_marginals_of_parts_are_those_of_the_whole(m, n, seed, centre, spread):
    score = np.random.default_rng(seed).normal(centre, spread, (m, n))
    np.testing.assert_allclose(marginals(score), exact_marginals(score), atol=1e-4)


def test_parts_are_disjoint_and_whole():
    plausible = np.array([[1, 0, 0, 0], [0, 1, 1, 0], [0, 0, 1, 0], [0, 0, 0, 0]], bool)
    parts = [(rows.tolist(), columns.tolist()) for rows, columns in separate(plausible)]
    assert sorted(parts) == [([0], [0]), ([1, 2], [1, 2])]
