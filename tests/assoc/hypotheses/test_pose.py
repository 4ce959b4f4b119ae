"""The camera's pose from matched pairs, against the same problem solved with all residuals in one covariance."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from assoc.evidence.likelihood import bound_variance, initial_state
from assoc.geometry.ground import THETA
from assoc.hypotheses.pose import BiasModels, PosePrior, fit, log_evidence, misfit, whiten
from tests.support.assoc_scene import BIAS_STD_M, DECAY, WHITE_VAR, blocks_of, noise

BLOCKS, PAIRS, SAMPLES = 6, 3, 4
PRIOR = PosePrior(std=np.array([0.05, 0.01, 0.02, 0.02, 2.0, 2.0, 1.0, 0.2, 0.1]))
OWN = np.arange(PAIRS)
seeds = st.integers(0, 10_000)


def scene(seed, spread=0.4):
    """Blocks in which track i follows vehicle i at its own distance, with a derivative by the pose."""
    rng = np.random.default_rng(seed)
    own = rng.normal(0.0, BIAS_STD_M, (PAIRS, 2))
    nothing = np.empty((0, 2))

    def block():
        return [[own[i] + rng.normal(0.0, spread, (SAMPLES, 2)) if i == j else nothing for j in OWN] for i in OWN]

    blocks = blocks_of([block() for _ in range(BLOCKS)])
    return replace(blocks, jacobian=rng.normal(0.0, 1.0, blocks.jacobian.shape))


def covariance(std, decay):
    """Of the block means of one pair and one axis."""
    apart = np.abs(np.subtract.outer(np.arange(BLOCKS), np.arange(BLOCKS)))
    return std**2 * decay**apart + WHITE_VAR / SAMPLES * np.eye(BLOCKS)


def start(std=BIAS_STD_M):
    return bound_variance(initial_state(PAIRS, PAIRS), std)


@settings(max_examples=25)
@given(seeds)
def test_evidence_for_how_biases_wander_is_the_joint_density_of_all_block_means(seed):
    from scipy.stats import multivariate_normal  # here: at the top every test process would load it

    blocks, theta = scene(seed), np.random.default_rng(seed).normal(0.0, 0.1, THETA)
    models = BiasModels(std=np.array([0.8, 1.3, 2.5]), decay=np.array([0.5, 0.9, 0.99]))
    found = log_evidence(blocks, OWN, OWN, theta, initial_state(PAIRS, PAIRS), noise(), models)
    means = blocks.mean[:, OWN, OWN] + blocks.jacobian @ theta
    expected = [
        sum(
            multivariate_normal.logpdf(means[:, i, axis], np.zeros(BLOCKS), covariance(std, decay))
            for i in OWN
            for axis in (0, 1)
        )
        for std, decay in zip(models.std, models.decay, strict=True)
    ]
    np.testing.assert_allclose(found - found[0], np.array(expected) - expected[0], atol=1e-6)


@settings(max_examples=25)
@given(seeds)
def test_the_fitted_pose_is_that_of_least_squares_over_everything(seed):
    blocks = scene(seed)
    fitted = fit(whiten(blocks, OWN, OWN, start(), noise()), PRIOR)
    # minimise (m + Jθ)ᵀ K⁻¹ (m + Jθ) + θᵀ Λ θ over all pairs and axes
    inverse = np.linalg.inv(covariance(BIAS_STD_M, DECAY))
    hessian, gradient = np.diag(PRIOR.std**-2.0), np.zeros(THETA)
    for i in OWN:
        for axis in (0, 1):
            J, m = blocks.jacobian[:, i, axis], blocks.mean[:, i, i, axis]
            hessian = hessian + J.T @ inverse @ J
            gradient = gradient + J.T @ inverse @ m
    np.testing.assert_allclose(fitted.theta, -np.linalg.solve(hessian, gradient), atol=1e-8)
    np.testing.assert_allclose(fitted.std, np.sqrt(np.diag(np.linalg.inv(hessian))), rtol=1e-9)
    assert fitted.cost == pytest.approx(-0.5 * np.linalg.slogdet(hessian * PRIOR.std * PRIOR.std[:, None])[1])


def test_pairs_that_fit_badly_are_held_down():
    """One of three goes elsewhere slowly enough to count: it pulls the pose less than its residuals ask for."""
    blocks = scene(3, spread=0.2)
    mean = blocks.mean.copy()
    mean[:, 2, 2] += np.linspace(0.0, 12.0, BLOCKS)[:, None]
    spoilt = whiten(replace(blocks, mean=mean), OWN, OWN, start(), noise())
    good = fit(whiten(blocks, OWN, OWN, start(), noise()), PRIOR).theta
    H = np.diag(PRIOR.std**-2.0) + np.einsum("bpai,bpaj->ij", spoilt.jacobian, spoilt.jacobian)
    obedient = -np.linalg.solve(H, np.einsum("bpai,bpa->i", spoilt.jacobian, spoilt.e))
    held = fit(spoilt, PRIOR).theta
    assert np.linalg.norm((held - good) / PRIOR.std) < 0.8 * np.linalg.norm((obedient - good) / PRIOR.std)
    assert misfit(spoilt, held)[2] > misfit(spoilt, obedient)[2], "what it asks for is not done"


def test_a_pair_that_begins_anew_says_nothing_of_the_pose_in_that_block():
    blocks = scene(2, spread=0.1)
    mean = blocks.mean.copy()
    mean[3:, 1, 1] += 80.0
    white = whiten(replace(blocks, mean=mean), OWN, OWN, start(), noise())
    assert not white.e[3, 1].any() and not white.jacobian[3, 1].any()
    assert np.abs(white.e).max() < 8.0
