"""The evidence of pairs, block by block, against densities worked out from all samples at once."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from assoc.evidence.blocks import Blocks
from assoc.evidence.likelihood import NEVER, bound_variance, initial_state, moved_state, run_filter
from assoc.geometry.ground import THETA
from tests.support.assoc_scene import BIAS_STD_M, DECAY, blocks_of, noise

WIDE_SHARE, WIDE = 0.15, 6.0
"""A part of the receivers wanders with six times the variance."""
NO_SWITCH = -1e9
seeds = st.integers(0, 10_000)


def followed(samples, levels=None, switch=NO_SWITCH, state=None):
    """The state after all blocks."""
    blocks, levels = blocks_of(samples), levels or noise(in_view_bonus=np.zeros(len(samples[0][0])))
    state = state or bound_variance(initial_state(*blocks.count.shape[1:]), levels.bias_std)
    return run_filter(blocks, np.zeros(THETA), state, levels, np.full(blocks.count.shape[:2], switch))[0]


@settings(max_examples=30)
@given(seeds, st.integers(1, 6))
def test_a_first_block_scores_the_joint_density_of_its_samples(seed, k):
    from scipy.stats import multivariate_normal  # here: at the top every test process would load it

    r = np.random.default_rng(seed).normal(0.5, 0.6, (k, 2))
    white, together = 0.09 * np.eye(k), np.ones((k, k))

    def log_joint(bias_var):
        covariance = white + bias_var * together
        return sum(multivariate_normal.logpdf(r[:, axis], np.zeros(k), covariance) for axis in (0, 1))

    near = np.log(1.0 - WIDE_SHARE) + log_joint(BIAS_STD_M**2)
    far = np.log(WIDE_SHARE) + log_joint(WIDE * BIAS_STD_M**2)
    unrelated = -np.log(2e3)
    score = followed([[[r]]]).score[0, 0]
    assert score == pytest.approx(np.logaddexp(near, far) - unrelated, abs=1e-9)


@settings(max_examples=30)
@given(seeds, st.integers(2, 12))
def test_the_bias_is_that_of_gaussian_process_regression(seed, count):
    """A Gauss–Markov bias seen through block means; in some blocks nothing was seen."""
    rng = np.random.default_rng(seed)
    sizes = np.where(rng.random(count) < 0.3, 0, rng.integers(1, 5, count))
    samples = [[[rng.normal(0.7, 0.5, (k, 2))]] for k in sizes]
    found = followed(samples)
    at = np.flatnonzero(sizes)
    prior = BIAS_STD_M**2 * DECAY ** np.abs(np.subtract.outer(np.arange(count), np.arange(count)))
    gain = prior[-1, at] @ np.linalg.inv(prior[np.ix_(at, at)] + np.diag(0.09 / sizes[at])) if len(at) else np.empty(0)
    means = np.array([samples[b][0][0].mean(axis=0) for b in at]).reshape(-1, 2)
    np.testing.assert_allclose(found.mean[0, 0], gain @ means, atol=1e-9)
    assert found.var[0, 0] == pytest.approx(prior[-1, -1] - gain @ prior[at, -1], abs=1e-9)


@settings(max_examples=20)
@given(seeds, st.integers(0, 8))
def test_blocks_may_come_in_two_runs(seed, stop):
    rng = np.random.default_rng(seed)
    samples = [[[rng.normal(0, 1, (rng.integers(0, 4), 2)) for _ in range(2)] for _ in range(3)] for _ in range(8)]
    levels = noise(in_view_bonus=np.array([0.0, 0.5]), increment_max=4.0)
    whole = followed(samples, levels, -5.0)
    parts = followed(samples[:stop], levels, -5.0) if stop else None
    parts = followed(samples[stop:], levels, -5.0, parts) if stop < 8 else parts
    for name in ("score", "mean", "var", "seen", "inherited"):
        np.testing.assert_allclose(getattr(parts, name), getattr(whole, name), atol=1e-9)
    log_switch = np.full((8, 3), -5.0)
    start = bound_variance(initial_state(3, 2), BIAS_STD_M)
    _, folded = run_filter(blocks_of(samples), np.zeros(THETA), start, levels, log_switch, fold=stop)
    before = followed(samples[:stop], levels, -5.0) if stop else start
    np.testing.assert_allclose(folded.score, before.score, atol=1e-9)


def test_a_pair_that_was_never_compared_has_no_score():
    nothing = np.empty((0, 2))
    state = followed([[[nothing, np.zeros((3, 2))]]] * 4)
    assert state.score[0, 0] == NEVER and not state.seen[0, 0]
    assert state.score[0, 1] > 0.0 and state.seen[0, 1]


def test_one_block_can_say_only_so_much():
    """However badly the second block fits, and however well the others do."""
    levels = noise(increment_max=3.0)
    states = [followed([[[np.full((5, 2), x)]] for x in (0.0, 500.0, 0.0)[:n]], levels).score[0, 0] for n in (1, 2, 3)]
    assert states[1] - states[0] == pytest.approx(-3.0)
    assert abs(states[2] - states[1]) <= 3.0 + 1e-9


def test_a_track_that_changes_its_vehicle_is_believed_after_a_while():
    near, far = np.zeros((5, 2)), np.full((5, 2), 12.0)
    samples = [[[near, far]]] * 10 + [[[far, near]]] * 6
    levels = noise(in_view_bonus=np.zeros(2), increment_max=4.0)
    before = followed(samples[:10], levels, -8.0).score[0]
    after = followed(samples, levels, -8.0).score[0]
    assert before[0] > before[1] + 10.0
    assert after[1] > after[0] + 10.0
    assert after[1] > followed(samples, levels, NO_SWITCH).score[0, 1], "the chance of a change is what lets it in"


def test_a_score_tells_what_it_inherits_from_before_a_change():
    near, far = np.zeros((5, 2)), np.full((5, 2), 12.0)
    levels = noise(in_view_bonus=np.zeros(2), increment_max=4.0)
    samples = [[[near, far]]] * 10 + [[[far, near]]] * 6
    before, after = followed(samples[:10], levels, -8.0), followed(samples, levels, -8.0)
    assert before.inherited[0, 0] == 0.0
    assert after.inherited[0, 1] == pytest.approx(before.score[0, 0])
    # the rest is its own: the chance of the change and what came after it
    alone = followed(samples[10:], levels, NO_SWITCH).score[0, 1]
    assert after.score[0, 1] - after.inherited[0, 1] == pytest.approx(min(alone, levels.increment_max) - 8.0, abs=1.5)


def test_what_a_track_might_have_become_while_nothing_was_reported_is_inherited():
    near, nothing = np.zeros((5, 2)), np.empty((0, 2))
    state = followed([[[near, np.full((5, 2), 40.0)]]] + [[[near, nothing]]] * 9, switch=-8.0)
    assert state.inherited[0, 1] > 5.0
    assert -8.0 < state.score[0, 1] < state.inherited[0, 1]
    assert state.inherited[0, 0] == 0.0


def test_a_shift_of_the_camera_is_a_shift_of_the_residuals():
    rng = np.random.default_rng(4)
    samples = [[[rng.normal(0.0, 0.3, (4, 2))]] for _ in range(5)]
    theta = np.zeros(THETA)
    theta[4], theta[5] = 0.8, -0.3
    blocks = blocks_of(samples)
    jacobian = blocks.jacobian.copy()
    jacobian[:, :, 0, 4] = jacobian[:, :, 1, 5] = 1.0
    moved = [[[r + theta[4:6] for r in row] for row in block] for block in samples]
    values = {name: getattr(blocks, name) for name in blocks.__slots__} | {"jacobian": jacobian}
    start = bound_variance(initial_state(1, 1), BIAS_STD_M)
    shifted, _ = run_filter(Blocks(**values), theta, start, noise(), np.full((5, 1), NO_SWITCH))
    np.testing.assert_allclose(shifted.score, followed(moved).score)
    np.testing.assert_allclose(shifted.mean, followed(moved).mean)


@settings(max_examples=30)
@given(seeds, st.floats(-4.0, 4.0), st.floats(-4.0, 4.0))
def test_what_is_remembered_can_be_moved_as_if_the_pose_had_always_been_another(seed, east, north):
    """Memory of a bias that does not wander is exact but for the wider part of N."""
    rng = np.random.default_rng(seed)
    shift, levels = np.array([east, north]), noise(in_view_bonus=np.zeros(1), decay=1.0, floor_var=0.0)
    samples = [[[rng.normal(0.5, 0.3, (5, 2))]] for _ in range(6)]
    moved = moved_state(followed(samples, levels), shift, BIAS_STD_M)
    anew = followed([[[block[0][0] + shift]] for block in samples], levels)
    np.testing.assert_allclose(moved.mean, anew.mean, atol=1e-9)
    np.testing.assert_allclose(moved.var, anew.var)
    assert moved.score[0, 0] == pytest.approx(anew.score[0, 0], abs=0.4 + 0.1 * abs(anew.score[0, 0]))


def test_of_a_pair_that_was_never_compared_nothing_is_moved():
    state = bound_variance(initial_state(2, 3), BIAS_STD_M)
    moved = moved_state(state, np.array([3.0, -1.0]), BIAS_STD_M)
    assert np.array_equal(moved.score, state.score) and np.array_equal(moved.mean, state.mean)


def test_bearing_with_receivers_that_wander_keeps_a_name_and_makes_none():
    """A bonus for vehicles in view lessens what speaks against a pair, and adds nothing to what speaks for it."""
    rng = np.random.default_rng(4)
    blocks = blocks_of([[[rng.normal(0.0, 0.3, (4, 2))]] for _ in range(12)])

    def score(log_null, bonus):
        levels = noise(in_view_bonus=np.array([bonus]))
        start, none = bound_variance(initial_state(1, 1), levels.bias_std), np.full((12, 1), NO_SWITCH)
        foreseen = replace(blocks, log_null=np.full(blocks.count.shape, log_null))
        return run_filter(foreseen, np.zeros(THETA), start, levels, none)[0].score[0, 0]

    # the reports' own past explains them far worse, about as well, and better than the track does
    well, even, badly = (score(null, 1.2) - score(null, 0.0) for null in (-12.0, -1.0, 1.0))
    assert well == pytest.approx(0.0, abs=0.5)
    assert 0.0 <= even <= 11 * 1.2 and badly == pytest.approx(11 * 1.2, abs=1.0)


def test_bearing_with_receivers_that_wander_tells_nothing_between_vehicles():
    """All pairs of a track gain alike, and the one that it may well be no more than it lacks."""
    rng = np.random.default_rng(5)
    near, beside = rng.normal(0.0, 0.3, (8, 4, 2)), rng.normal(0.4, 0.3, (8, 4, 2))
    blocks = blocks_of([[[near[b], beside[b]]] for b in range(8)])
    blocks = replace(blocks, log_null=np.full(blocks.count.shape, -0.5))
    start, none = bound_variance(initial_state(1, 2), BIAS_STD_M), np.full((8, 1), NO_SWITCH)
    plain, borne = (
        run_filter(blocks, np.zeros(THETA), start, noise(in_view_bonus=np.full(2, bonus)), none)[0].score[0]
        for bonus in (0.0, 1.2)
    )
    assert borne[0] - borne[1] == pytest.approx(plain[0] - plain[1])
    assert 1.0 < borne[0] - plain[0] <= 7 * 1.2
