"""Names out of several joint hypotheses: weighed as their evidence says, with room for strangers."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from assoc.hypotheses.labels import mixed_marginals, most_probable_names, posterior_weights
from assoc.hypotheses.marginals import best_assignment, exact_marginals

BIAS_STD_M, CHANCE, SPREAD_M = 1.5, 0.02, 12.0
ODDS = 1e4
"""More than any score here: no score is evidence that a vehicle reports the place of another."""
seeds = st.integers(0, 10_000)


def hypothesis(score, value=0.0, bias=0.0):
    """A joint hypothesis of which only scores, total and bias means matter here."""
    final = SimpleNamespace(mean=np.full((*score.shape, 2), bias), inherited=np.zeros(score.shape))
    return SimpleNamespace(score=score, value=value, final=final, vehicle=best_assignment(score))


def mixed(hypotheses, chance=1e-12, log_not_lost=0.0):
    m, n = hypotheses[0].score.shape
    free = np.broadcast_to(np.asarray(log_not_lost), (m, n))
    nowhere = np.zeros((m, n), np.bool_)
    context = SimpleNamespace(
        noise=SimpleNamespace(bias_std=BIAS_STD_M),
        clutter=chance,
        in_view=np.zeros(n),
        log_odds=ODDS,
        age_s=np.full(m, 20.0),
        live=m,
    )
    return mixed_marginals(hypotheses, posterior_weights(hypotheses), context, free, nowhere)


def test_weights_are_the_shares_of_the_likelihoods_however_small_these_are():
    values = [-900.0, -900.0 + np.log(3.0), -2000.0]
    np.testing.assert_allclose(posterior_weights([hypothesis(np.zeros((1, 1)), v) for v in values]), [0.25, 0.75, 0.0])


@settings(max_examples=25)
@given(seeds, st.integers(1, 4), st.integers(1, 4))
def test_without_strangers_names_are_as_likely_as_the_hypotheses_that_give_them(seed, m, n):
    rng = np.random.default_rng(seed)
    several = [hypothesis(rng.normal(0.0, 4.0, (m, n)), value) for value in rng.normal(0.0, 1.0, 3)]
    share = posterior_weights(several)
    expected = sum(w * exact_marginals(h.score) for w, h in zip(share, several, strict=True))
    np.testing.assert_allclose(mixed(several), expected, atol=1e-3)


def test_however_well_it_fits_a_name_is_never_surer_than_strangers_allow():
    sure = mixed([hypothesis(np.array([[500.0]]))], chance=CHANCE)[0, 0]
    aside = mixed([hypothesis(np.array([[500.0]]), bias=2.0)], chance=CHANCE)[0, 0]
    assert sure == pytest.approx(1.0 / (1.0 + CHANCE * (BIAS_STD_M / SPREAD_M) ** 2), abs=1e-9)
    assert aside < sure


def test_a_vehicle_that_was_seen_beside_this_track_is_not_its_name():
    several = [hypothesis(np.array([[20.0, 18.0]]))]
    assert np.argmax(mixed(several)[0]) == 0
    assert np.argmax(mixed(several, log_not_lost=[[-30.0, 0.0]])[0]) == 1


def test_each_vehicle_is_named_once_and_nobody_where_that_is_likelier():
    p = np.array([[0.6, 0.1, 0.3], [0.55, 0.35, 0.1], [0.1, 0.1, 0.8]])
    assert most_probable_names(p).tolist() == [0, 1, -1]
    assert most_probable_names(np.array([[0.0, 1.0]])).tolist() == [-1]
    assert most_probable_names(np.ones((2, 1))).tolist() == [-1, -1]
