"""Hypotheses in blocks: complete, in order, and the same answer whatever the block, with ties and degenerate sets."""

from itertools import combinations, permutations
from math import comb, perm

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from assoc.methods import assignments
from assoc.methods.assignments import block_shape, orders, vehicle_sets
from assoc.methods.projection import associate_by_projection
from bench.latency import literal


def scores(x, y, history=10):
    """Every hypothesis of the literal method as (vehicle of each track, error of each future frame)."""
    found = []
    for pairs in literal.hypotheses(x.shape[1], y.shape[1]):
        i, j = (list(side) for side in zip(*pairs, strict=True))
        X, Y = x[:history, i].reshape(-1, 3), y[:history, j].reshape(-1, 2)
        if np.linalg.matrix_rank(X) == 3:
            theta = np.linalg.lstsq(X, Y, rcond=None)[0]
            vehicle = np.full(y.shape[1], -1)
            vehicle[j] = i
            found.append((vehicle.tolist(), np.linalg.norm(x[history:, i] @ theta - y[history:, j], axis=2).sum(1)))
    return found


def scene(n_rl, n_im, seed, frames=12):
    """Vehicles that wander below the camera, tracks of the first of them in another order; some of nobody."""
    rng = np.random.default_rng(seed)
    n = max(n_rl, n_im)
    p = rng.uniform(-15.0, 15.0, (n, 2)) + np.cumsum(rng.uniform(-1.0, 1.5, (frames, n, 2)), axis=0)
    x = np.concatenate([p, np.full((frames, n, 1), -40.0)], axis=2)
    y = 30.0 * p[:, rng.permutation(n)[:n_im]] * (1.0, -1.0) + rng.normal(0.0, 2.0, (frames, n_im, 2))
    return x[:, :n_rl] + rng.normal(0.0, 0.5, (frames, n_rl, 3)), y


@pytest.mark.parametrize(("n_im", "s"), [(1, 1), (4, 1), (5, 3), (6, 6), (300, 2)])
def test_orders_are_the_permutations_in_lexicographic_order(n_im, s):
    everything = orders(0, perm(n_im, s), n_im, s)
    assert everything.track.T.tolist() == [list(one) for one in permutations(range(n_im), s)]
    meets = everything.meets.reshape(s, n_im, -1)
    np.testing.assert_array_equal(np.argmax(meets, axis=1), everything.track)
    np.testing.assert_array_equal(np.sum(meets, axis=1), 1.0)


def test_runs_of_orders_join_up():
    runs = [orders(start, start + 7, 5, 3).track for start in range(0, perm(5, 3), 7)]
    np.testing.assert_array_equal(np.concatenate(runs, axis=1), orders(0, perm(5, 3), 5, 3).track)
    assert not runs[0].flags.writeable


@pytest.mark.parametrize(("n_rl", "n_im"), [(7, 6), (6, 7), (9, 8), (9, 9), (200, 2), (2, 1500), (1, 1), (3000, 1)])
@pytest.mark.parametrize("frames", [1, 2, 100])
def test_blocks_are_bounded(n_rl, n_im, frames):
    sets, run = block_shape(n_rl, n_im, frames)
    s = min(n_rl, n_im)
    assert 1 <= sets <= comb(n_rl, s) and 1 <= run <= perm(n_im, s)
    assert sets * run * frames <= 20_160 and s * n_im * run <= 2**18


def test_vehicle_sets_are_the_combinations():
    assert np.concatenate(list(vehicle_sets(6, 3, 7))).tolist() == [list(one) for one in combinations(range(6), 3)]


@settings(max_examples=40, deadline=None)
@given(n_rl=st.integers(1, 6), n_im=st.integers(1, 5), future=st.integers(1, 3), seed=st.integers(0, 10_000))
def test_winner_is_that_of_the_literal_scores(n_rl, n_im, future, seed):
    x, y = scene(n_rl, n_im, seed, frames=10 + future)
    table = scores(x, y)
    errors = np.array([error for _, error in table])
    wins = np.argmin(errors, axis=0)
    k = max(set(wins.tolist()), key=lambda k: (np.sum(wins == k), -errors[k].sum()))
    found = associate_by_projection(x, y)
    assert found.vehicle.tolist() == table[k][0]
    assert found.votes == np.sum(wins == k)
    assert found.error_px == pytest.approx(errors[k].sum(), rel=1e-9)
    assert found.hypotheses == len(table) and found.degenerate == 0


@pytest.mark.parametrize(("n_rl", "n_im"), [(6, 4), (4, 5), (5, 5), (7, 2)])
def test_the_answer_does_not_depend_on_the_block(n_rl, n_im, monkeypatch):
    x, y = scene(n_rl, n_im, 3)
    whole = associate_by_projection(x, y)
    monkeypatch.setattr(assignments, "_SETS", 2)
    for size in (1, 11, 100):
        monkeypatch.setattr(assignments, "_BLOCK", size)
        parts = associate_by_projection(x, y)
        np.testing.assert_array_equal(parts.vehicle, whole.vehicle)
        np.testing.assert_allclose(parts.theta, whole.theta, rtol=1e-9, atol=1e-9)
        assert parts.error_px == pytest.approx(whole.error_px, rel=1e-9)
        assert (parts.votes, parts.hypotheses) == (whole.votes, whole.hypotheses)


@pytest.mark.parametrize("side", ["tracks", "vehicles"])
@pytest.mark.parametrize("seed", range(5))
def test_of_equal_hypotheses_one_wins_with_their_error(side, seed):
    x, y = scene(5, 4, seed, frames=11)
    if side == "tracks":
        y[:, 2] = y[:, 0]
    else:
        x[:, 3] = x[:, 1]
    table = scores(x, y)
    least = min(float(error[0]) for _, error in table)
    equal = [vehicle for vehicle, error in table if error[0] < least + 1e-8]
    found = associate_by_projection(x, y)
    assert len(equal) > 1 and found.vehicle.tolist() in equal
    assert found.error_px == pytest.approx(least, rel=1e-9)


def test_only_sets_that_do_not_determine_the_projection_are_left_out():
    x, y = scene(5, 3, 2)
    # 0, 1 and 2 drive along one line through the point below the UAV
    x[:, :3] = np.stack([np.add.outer(np.arange(12.0), [0.0, 5.0, 9.0]), np.zeros((12, 3)), np.full((12, 3), -40.0)], 2)
    table = scores(x, y)
    errors = np.array([error.sum() for _, error in table])
    found = associate_by_projection(x, y)
    assert (found.hypotheses, found.degenerate, len(table)) == (60, 6, 54)
    assert found.error_px == pytest.approx(errors[[v for v, _ in table].index(found.vehicle.tolist())], rel=1e-9)
