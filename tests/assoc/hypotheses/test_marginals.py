"""Assignments with nobody, and marginals against enumeration."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from assoc.hypotheses.marginals import best_assignment, exact_marginals, loopy_marginals, marginals

scores = st.tuples(st.integers(1, 4), st.integers(1, 4)).flatmap(
    lambda s: arrays(np.float64, s, elements=st.floats(-6, 6).map(lambda v: round(v, 3)))
)


def enumerate_all(score):
    """Exact marginals and the best total by trying every assignment."""
    m, n = score.shape
    total, best = np.zeros((m, n + 1)), -np.inf
    for choice in product(range(n + 1), repeat=m):
        used = [c for c in choice if c < n]
        if len(set(used)) == len(used):
            value = sum(score[i, c] for i, c in enumerate(choice) if c < n)
            best = max(best, value)
            for i, c in enumerate(choice):
                total[i, c] += np.exp(value)
    return total / total.sum(axis=1, keepdims=True), best


@settings(max_examples=60, deadline=None)
@given(scores)
def test_best_assignment_is_the_best(score):
    choice = best_assignment(score)
    rows = np.flatnonzero(choice >= 0)
    assert score[rows, choice[rows]].sum() == pytest.approx(enumerate_all(score)[1])
    assert len(set(choice[rows].tolist())) == len(rows)


@settings(max_examples=60, deadline=None)
@given(scores)
def test_exact_marginals_are_exact(score):
    np.testing.assert_allclose(exact_marginals(score), enumerate_all(score)[0], atol=1e-9)


@settings(max_examples=60, deadline=None)
@given(scores)
def test_marginals_are_the_exact_ones_within_what_clear_cases_allow(score):
    p = marginals(score)
    np.testing.assert_allclose(p.sum(axis=1), 1.0)
    np.testing.assert_allclose(p, enumerate_all(score)[0], atol=0.02)


@settings(max_examples=30, deadline=None)
@given(scores)
def test_one_column_is_exact(score):
    p = loopy_marginals(score[:, :1])[0]
    np.testing.assert_allclose(p, enumerate_all(score[:, :1])[0], atol=1e-6)


def test_huge_scores_stay_finite_and_compete():
    p = marginals(np.array([[5000.0, 4000.0], [4990.0, 10.0]]))
    assert np.isfinite(p).all()
    # 4000 + 4990 beats 5000 + 10
    assert p[0, 1] > 0.99 and p[1, 0] > 0.99


@pytest.mark.parametrize("shape", [(0, 0), (0, 3), (3, 0)])
def test_empty(shape):
    p = marginals(np.zeros(shape))
    assert p.shape == (shape[0], shape[1] + 1)
    assert best_assignment(np.zeros(shape)).tolist() == [-1] * shape[0]
