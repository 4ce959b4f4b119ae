"""Names are doubted as far as others may drive beside our vehicles."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from assoc.hypotheses.look_alikes import discount_lookalikes

BIAS_STD_M, SPREAD_M = 1.5, 12.0


@settings(max_examples=25)
@given(st.integers(0, 10_000), st.floats(-5.0, 30.0), st.floats(0.0, 6.0))
def test_doubt_is_bayes_rule_with_a_stranger_beside_the_vehicle(seed, score, distance_m):
    """One track, one vehicle: a stranger has the pair's likelihood, its offset spread evenly over some metres."""
    chance = np.random.default_rng(seed).uniform(1e-4, 0.2)
    bias = np.array([[[distance_m, 0.0]]])
    got = discount_lookalikes(np.array([[score]]), bias, BIAS_STD_M, chance, np.zeros(1))[0, 0]
    pair = np.exp(score)
    offset_density = min(np.exp(-(distance_m**2) / (2.0 * BIAS_STD_M**2)), 1.0)
    offset_density = max(offset_density, np.exp(-5.0))  # receivers may be worse than their model
    follower = pair / offset_density * (BIAS_STD_M / SPREAD_M) ** 2
    assert got == pytest.approx(score - np.log((1.0 - chance) + chance * follower), abs=1e-9)
