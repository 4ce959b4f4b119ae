"""Confidence of new answers: no more than their mean over the last seconds."""

import numpy as np
import pytest

from assoc.identification.steady import SteadyAnswers

THRESHOLD = 0.7
FREE = np.array([False])


def told(answers, t, *p, track=(1, 0.0), free=FREE):
    return answers.limited(t, [track], np.array([p]), free)[0]


def test_an_answer_is_as_sure_as_it_was_in_the_last_seconds():
    answers = SteadyAnswers(THRESHOLD)
    told(answers, 0.0, 0.1, 0.1, 0.8)
    told(answers, 0.5, 0.9, 0.05, 0.05)
    now = told(answers, 1.0, 0.98, 0.01, 0.01)
    assert now[0] == pytest.approx(0.7), "no name falls below the threshold by this"
    assert now.sum() == pytest.approx(1.0)
    assert now[2] > 0.25, "the rest is what it was thought to be"
    assert told(answers, 1.5, 0.99, 0.01, 0.0)[0] == pytest.approx((0.1 + 0.9 + 0.98 + 0.99) / 4)
    assert told(answers, 2.4, 0.99, 0.01, 0.0)[0] == pytest.approx((0.9 + 0.98 + 0.99 + 0.99) / 4)
    assert told(answers, 9.0, 0.99, 0.01, 0.0) == pytest.approx([0.99, 0.01, 0.0])


def test_what_flips_is_not_sure():
    answers = SteadyAnswers(THRESHOLD)
    for t in (0.0, 0.5, 1.0):
        told(answers, t, 0.99, 0.0, 0.01)
    assert told(answers, 1.4, 0.0, 0.0, 1.0) == pytest.approx([0.5, 0.0, 0.5], abs=0.01)
    assert told(answers, 1.6, 0.0, 1.0, 0.0)[1] == pytest.approx(THRESHOLD)


def test_marginals_stay_marginals():
    rng, answers = np.random.default_rng(5), SteadyAnswers(THRESHOLD)
    for k in range(60):
        p = rng.dirichlet([0.2, 0.2, 0.2, 0.2], size=3)
        p[0] = np.eye(4)[k % 4]
        now = answers.limited(0.3 * k, [(i, 0.0) for i in range(3)], p, np.zeros(3, np.bool_))
        assert now.sum(axis=1) == pytest.approx(np.ones(3))
        assert np.all(now >= 0.0)
        assert np.all(now[:, :3][p[:, :3] >= THRESHOLD] >= THRESHOLD)


def test_a_weak_answer_and_a_statement_are_left_alone():
    answers = SteadyAnswers(THRESHOLD)
    told(answers, 0.0, 0.2, 0.2, 0.6)
    assert told(answers, 0.5, 0.6, 0.2, 0.2) == pytest.approx([0.6, 0.2, 0.2])
    assert told(answers, 1.0, 1.0, 0.0, 0.0, free=np.array([True])) == pytest.approx([1.0, 0.0, 0.0])


def test_a_track_that_begins_anew_has_no_past():
    answers = SteadyAnswers(THRESHOLD)
    told(answers, 0.0, 0.0, 0.99, 0.01)
    assert told(answers, 0.5, 0.99, 0.0, 0.01, track=(1, 0.4))[0] == pytest.approx(0.99)
    nobody = answers.limited(1.0, [], np.zeros((0, 3)), np.zeros(0, np.bool_))
    assert nobody.shape == (0, 3)
