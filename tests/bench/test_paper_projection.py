"""The paper's projection: exact against its literal form, honest about degenerate geometry."""

from itertools import permutations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from assoc.errors import AssocError, DegenerateError, ShapeError
from bench.paper.projection import associate_by_projection, orders, reprojection_errors


def hypotheses(n_rl, n_im):
    """Every injective assignment as (vehicles, tracks)."""
    if n_rl >= n_im:
        return [(list(chosen), list(range(n_im))) for chosen in permutations(range(n_rl), n_im)]
    return [(list(range(n_rl)), list(chosen)) for chosen in permutations(range(n_im), n_rl)]


def literal(x, y, history):
    """Section 3.2 word for word: stack the pairs, solve, reproject, vote."""
    wins, errors, thetas = [], [], []
    for vehicles, tracks in hypotheses(x.shape[1], y.shape[1]):
        X = np.concatenate([x[t, vehicles] for t in range(history)])
        Y = np.concatenate([y[t, tracks] for t in range(history)])
        theta = np.linalg.lstsq(X, Y, rcond=None)[0]
        thetas.append(theta)
        errors.append(
            [np.linalg.norm(x[t, vehicles] @ theta - y[t, tracks], axis=1).sum() for t in range(history, len(x))]
        )
    errors = np.array(errors)
    wins = np.argmin(errors, axis=0)
    best = max(set(wins.tolist()), key=lambda k: (np.sum(wins == k), -errors[k].sum()))
    vehicles, tracks = hypotheses(x.shape[1], y.shape[1])[best]
    answer = np.full(y.shape[1], -1)
    answer[tracks] = vehicles
    return answer, thetas[best], errors[best].sum()


def scene(n_rl, n_im, seed, noise=0.3, frames=12):
    """Vehicles under a camera that looks straight down, tracks in random order; surplus tracks belong to nobody."""
    rng = np.random.default_rng(seed)
    n = max(n_rl, n_im)
    p = rng.uniform(-15, 15, (n, 2)) + np.cumsum(rng.uniform(-1, 1, (frames, n, 2)) + 0.5, axis=0)
    x = np.concatenate([p, np.full((frames, n, 1), -40.0)], axis=2)
    y = np.stack([30 * p[..., 0] + 960, -30 * p[..., 1] + 540], axis=2)
    order = rng.permutation(n)[:n_im] if n_rl >= n_im else rng.permutation(n)
    truth = np.where(order < n_rl, order, -1)
    return x[:, :n_rl] + rng.normal(0, noise, (frames, n_rl, 3)) * (1, 1, 0), y[:, order], truth


@settings(max_examples=25, deadline=None)
@given(n_rl=st.integers(2, 5), n_im=st.integers(2, 5), seed=st.integers(0, 10_000))
def test_gram_form_equals_literal_form(n_rl, n_im, seed):
    x, y, _ = scene(n_rl, n_im, seed, noise=1.0)
    found = associate_by_projection(x, y)
    vehicle, theta, error = literal(x, y, 10)
    np.testing.assert_array_equal(found.vehicle, vehicle)
    np.testing.assert_allclose(found.theta, theta, rtol=1e-6, atol=1e-7)
    assert found.error_px == pytest.approx(error, rel=1e-8)


@pytest.mark.parametrize(
    ("n_rl", "n_im"),
    [
        (7, 6),  # the paper's own case: one vehicle outside the image
        (6, 7),  # one false detection
        (5, 5),
        (3, 1),  # one track, several vehicles
    ],
)
def test_low_noise_is_solved(n_rl, n_im):
    x, y, truth = scene(n_rl, n_im, 5, noise=0.02, frames=14)
    found = associate_by_projection(x, y, history=12)
    np.testing.assert_array_equal(found.vehicle, truth)
    assert found.degenerate == 0


def test_more_tracks_than_vehicles_leaves_the_surplus():
    x, y, _ = scene(3, 5, 1)
    assert np.sum(associate_by_projection(x, y).vehicle == -1) == 2


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 1000))
def test_permuting_vehicles_and_tracks_permutes_the_answer(seed):
    x, y, _ = scene(5, 4, seed)
    rng = np.random.default_rng(seed + 1)
    vehicles, tracks = rng.permutation(5), rng.permutation(4)
    straight = associate_by_projection(x, y).vehicle
    turned = associate_by_projection(x[:, vehicles], y[:, tracks]).vehicle
    np.testing.assert_array_equal(vehicles[turned], straight[tracks])


def test_collinear_vehicles_below_the_uav_are_refused():
    t = np.arange(12.0)[:, None]
    along = np.concatenate([t, t + 5, t + 9], axis=1)
    x = np.stack([along, np.zeros_like(along), np.full_like(along, -40.0)], axis=2)
    with pytest.raises(DegenerateError, match="rank below 3"):
        associate_by_projection(x, x[..., :2] * 30)


def test_too_many_hypotheses_are_refused_before_work_begins():
    with pytest.raises(AssocError, match="at most"):
        associate_by_projection(np.ones((12, 15, 3)), np.ones((12, 15, 2)))


@pytest.mark.parametrize(
    ("x", "y", "history"),
    [
        ((12, 3, 2), (12, 3, 2), 10),  # world points without height
        ((12, 3, 3), (11, 3, 2), 10),  # different lengths
        ((10, 3, 3), (10, 3, 2), 10),  # no future frame
    ],
)
def test_wrong_shapes_are_refused(x, y, history):
    with pytest.raises(ShapeError):
        associate_by_projection(np.ones(x), np.ones(y), history=history)


def test_reprojection_errors_are_zero_for_the_right_pairs():
    x, y, truth = scene(4, 4, 3, noise=0.0)
    theta = np.linalg.lstsq(x[0][truth], y[0], rcond=None)[0]
    E = reprojection_errors(x[0], y[0], theta)
    assert E.shape == (4, 4)
    np.testing.assert_allclose(E[np.arange(4), truth], 0.0, atol=1e-6)


def scores(x, y, history=10):
    """Every hypothesis, scored one by one, as (vehicle of each track, error of each future frame)."""
    found = []
    for i, j in hypotheses(x.shape[1], y.shape[1]):
        X, Y = x[:history, i].reshape(-1, 3), y[:history, j].reshape(-1, 2)
        if np.linalg.matrix_rank(X) == 3:
            theta = np.linalg.lstsq(X, Y, rcond=None)[0]
            vehicle = np.full(y.shape[1], -1)
            vehicle[j] = i
            found.append((vehicle.tolist(), np.linalg.norm(x[history:, i] @ theta - y[history:, j], axis=2).sum(1)))
    return found


def noisy_scene(n_rl, n_im, seed, frames=12):
    """Vehicles that wander below the camera, tracks of the first of them in another order; some of nobody."""
    rng = np.random.default_rng(seed)
    n = max(n_rl, n_im)
    p = rng.uniform(-15.0, 15.0, (n, 2)) + np.cumsum(rng.uniform(-1.0, 1.5, (frames, n, 2)), axis=0)
    x = np.concatenate([p, np.full((frames, n, 1), -40.0)], axis=2)
    y = 30.0 * p[:, rng.permutation(n)[:n_im]] * (1.0, -1.0) + rng.normal(0.0, 2.0, (frames, n_im, 2))
    return x[:, :n_rl] + rng.normal(0.0, 0.5, (frames, n_rl, 3)), y


@pytest.mark.slow_but_first
@pytest.mark.parametrize(("n_im", "s"), [(1, 1), (4, 1), (5, 3), (6, 6), (300, 2)])
def test_orders_are_the_permutations_in_lexicographic_order(n_im, s):
    everything = orders(n_im, s)
    assert everything.track.T.tolist() == [list(one) for one in permutations(range(n_im), s)]
    meets = everything.meets.reshape(s, n_im, -1)
    np.testing.assert_array_equal(np.argmax(meets, axis=1), everything.track)
    np.testing.assert_array_equal(np.sum(meets, axis=1), 1.0)


@settings(max_examples=40, deadline=None)
@given(n_rl=st.integers(1, 6), n_im=st.integers(1, 5), future=st.integers(1, 3), seed=st.integers(0, 10_000))
def test_winner_is_that_of_hypotheses_scored_one_by_one(n_rl, n_im, future, seed):
    x, y = noisy_scene(n_rl, n_im, seed, frames=10 + future)
    table = scores(x, y)
    errors = np.array([error for _, error in table])
    wins = np.argmin(errors, axis=0)
    k = max(set(wins.tolist()), key=lambda k: (np.sum(wins == k), -errors[k].sum()))
    found = associate_by_projection(x, y)
    assert found.vehicle.tolist() == table[k][0]
    assert found.votes == np.sum(wins == k)
    assert found.error_px == pytest.approx(errors[k].sum(), rel=1e-9)
    assert found.hypotheses == len(table) and found.degenerate == 0


@pytest.mark.slow_but_first
@pytest.mark.parametrize("side", ["tracks", "vehicles"])
@pytest.mark.parametrize("seed", range(5))
def test_of_equal_hypotheses_one_wins_with_their_error(side, seed):
    x, y = noisy_scene(5, 4, seed, frames=11)
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
    x, y = noisy_scene(5, 3, 2)
    # 0, 1 and 2 drive along one line through the point below the UAV
    x[:, :3] = np.stack([np.add.outer(np.arange(12.0), [0.0, 5.0, 9.0]), np.zeros((12, 3)), np.full((12, 3), -40.0)], 2)
    table = scores(x, y)
    errors = np.array([error.sum() for _, error in table])
    found = associate_by_projection(x, y)
    assert (found.hypotheses, found.degenerate, len(table)) == (60, 6, 54)
    assert found.error_px == pytest.approx(errors[[v for v, _ in table].index(found.vehicle.tolist())], rel=1e-9)
