"""The best naming of segments and its probabilities, beside all namings that there are."""

from itertools import product

import numpy as np
import pytest

from assoc.whole_flight.owners import Namings


def namings(score, apart):
    """Every naming of segments that is allowed, and its ln weight."""
    segments, n = score.shape
    for owner in product(range(-1, n), repeat=segments):
        shared = [(f, g) for f in range(segments) for g in range(f) if owner[f] == owner[g] >= 0]
        if not any(apart[f, g] for f, g in shared):
            yield owner, sum(score[f, j] for f, j in enumerate(owner) if j >= 0)


def scene(seed, segments=5, n=2):
    rng = np.random.default_rng(seed)
    start = rng.uniform(0.0, 8.0, segments)
    stop = start + rng.uniform(1.0, 6.0, segments)
    apart = (start[:, None] < stop) & (start < stop[:, None]) & ~np.eye(segments, dtype=bool)
    return rng.normal(0.0, 3.0, (segments, n)), apart


@pytest.mark.parametrize("seed", range(20))
def test_the_best_naming_is_the_best_of_all(seed):
    score, apart = scene(seed)
    owner = Namings(score, apart).best()
    every = dict(namings(score, apart))
    assert every[tuple(owner.tolist())] == pytest.approx(max(every.values()))


@pytest.mark.parametrize("seed", range(20))
def test_probabilities_are_near_those_of_all_namings(seed):
    score, apart = scene(seed)
    p = Namings(score, apart).probabilities()
    assert np.sum(p, axis=1) == pytest.approx(1.0)
    exact = np.zeros_like(p)
    for owner, weight in namings(score, apart):
        exact[range(len(owner)), owner] += np.exp(weight)
    exact /= np.sum(exact, axis=1, keepdims=True)
    # what many namings share that are nearly as good is told too small
    assert np.max(np.abs(p - exact)) < 0.2
    clear = np.max(exact, axis=1) > 0.7
    assert np.array_equal(np.argmax(p, axis=1)[clear], np.argmax(exact, axis=1)[clear])


def test_one_segment_and_its_rival_share_as_their_odds_say():
    score, apart = np.array([[3.0], [2.0]]), ~np.eye(2, dtype=bool)
    p = Namings(score, apart).probabilities()
    assert p[0, 0] / p[1, 0] == pytest.approx(np.exp(3.0 - 2.0))


def test_of_two_that_are_both_sure_only_one_is():
    score, apart = np.array([[60.0], [50.0]]), ~np.eye(2, dtype=bool)
    p = Namings(score, apart).probabilities()
    assert p[:, 0] == pytest.approx([1.0, 0.0], abs=1e-3)


def test_a_third_that_fits_one_of_two_does_not_unsettle_both():
    score = np.array([[24.0, 30.0], [28.0, 25.0], [-15.0, 20.0]])
    p = Namings(score, ~np.eye(3, dtype=bool)).probabilities()
    assert np.argmax(p, axis=1).tolist() == [1, 0, 2]
    assert np.min(np.max(p, axis=1)) > 0.99


def test_nothing_to_name_leaves_all_without_a_name():
    score = np.full((3, 2), -60.0)
    assert Namings(score, np.zeros((3, 3), bool)).best().tolist() == [-1, -1, -1]
