"""Noise that the identifier assumes of reports, beside that of simulated ones."""

import numpy as np

from assoc.hypotheses.priors import noise_of
from assoc.params import IdentifierParams
from tests.support.assoc_scene import camera


def test_a_bias_scatters_within_a_block_as_far_as_it_is_said_to():
    """Gauss–Markov biases and white noise, twenty samples in each block of a second, on one axis."""
    rng, std, tau_s, white, k = np.random.default_rng(0), 1.8, 20.0, 0.1, 20
    step = np.exp(-1.0 / (k * tau_s))
    bias = np.empty((4000 * k, 1))
    bias[0] = rng.normal(0.0, std)
    for i in range(1, len(bias)):
        bias[i] = step * bias[i - 1] + rng.normal(0.0, std * np.sqrt(1.0 - step**2))
    blocks = (bias[:, 0] + rng.normal(0.0, white, len(bias))).reshape(-1, k)
    seen_var = np.mean(np.var(blocks, axis=1, ddof=1))

    def white_var(std_m):
        q, bonus = IdentifierParams(), np.zeros(1)
        return noise_of(q, camera(), white_std_m=white, bias_std=std_m, tau_s=tau_s, in_view_bonus=bonus).white_var

    foreseen = white**2 + white_var(std) - white_var(0.0)
    assert abs(seen_var / foreseen - 1.0) < 0.15
