"""Triangular topological sequences: what they must not depend on, and what they say when there are no triangles."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from assoc.errors import ShapeError
from bench.paper.tts import associate_by_tts, associate_by_tts_once, triangle_sequences, tts_similarity


def points(seed, n):
    """n points well apart."""
    rng = np.random.default_rng(seed)
    return rng.permutation(np.stack(np.meshgrid(np.arange(6), np.arange(6)), -1).reshape(-1, 2))[
        :n
    ] * 10.0 + rng.uniform(-3, 3, (n, 2))


def moved(p, angle, scale, shift):
    c, s = np.cos(angle), np.sin(angle)
    return scale * p @ np.array([[c, s], [-s, c]]) + shift


seeds = st.integers(0, 10_000)


def test_an_equilateral_triangle_has_one_triangle_of_sixty_degrees_at_each_corner():
    p = np.array([[0.0, 0.0], [2.0, 0.0], [1.0, np.sqrt(3.0)]])
    for sequence in triangle_sequences(p):
        np.testing.assert_allclose(sequence, [[60.0, 60.0, 60.0]])


def test_angles_stand_in_the_order_self_next_previous():
    p = np.array([[0.0, 0.0], [4.0, 0.0], [0.0, 1.0]])
    at_right, far, high = triangle_sequences(p)
    narrow, wide = np.degrees(np.arctan2(1.0, 4.0)), np.degrees(np.arctan2(4.0, 1.0))
    np.testing.assert_allclose(at_right, [[90.0, narrow, wide]])
    np.testing.assert_allclose(far, [[narrow, wide, 90.0]])
    np.testing.assert_allclose(high, [[wide, 90.0, narrow]])


def test_around_an_inner_point_the_angles_make_a_full_turn():
    p = np.array([[0.0, 0.0], [5.0, 1.0], [1.0, 6.0], [-5.0, 0.5], [0.3, -4.0]])
    assert triangle_sequences(p)[0][:, 0].sum() == pytest.approx(360.0)


@settings(max_examples=25, deadline=None)
@given(seeds, st.integers(4, 10), st.floats(-3, 3), st.floats(0.01, 100.0))
def test_a_view_is_its_own_best_match_under_any_similarity_transform(seed, n, angle, scale):
    p = points(seed, n)
    seen = moved(p, angle, scale, [30.0, -7.0])
    similarity = tts_similarity(seen, p)
    np.testing.assert_allclose(similarity, tts_similarity(p, p), atol=1e-7)
    np.testing.assert_allclose(np.diag(similarity), 1.0, atol=1e-7)
    assert similarity.max() <= 1.0 + 1e-9
    assert associate_by_tts(seen, p).tolist() == list(range(n))


@settings(max_examples=25, deadline=None)
@given(seeds, st.integers(4, 9))
def test_the_order_of_the_points_only_reorders_the_answer(seed, n):
    rng = np.random.default_rng(seed)
    image, world = points(seed, n), points(seed, n) + rng.normal(0, 0.3, (n, 2))
    rows, columns = rng.permutation(n), rng.permutation(n)
    plain = tts_similarity(image, world)
    np.testing.assert_allclose(tts_similarity(image[rows], world[columns]), plain[np.ix_(rows, columns)])


def test_a_mirrored_view_is_not_the_same_view():
    p = points(3, 6)
    assert np.diag(tts_similarity(p * [1.0, -1.0], p)).max() < 1.0 - 1e-3


def test_the_second_step_mends_a_pair_that_looks_alike():
    rng = np.random.default_rng(5)
    one = two = 0
    for seed in range(40):
        p = points(seed, 8)
        seen = moved(p, 0.7, 25.0, [400.0, 300.0]) + rng.normal(0, 8.0, p.shape)
        one += np.sum(associate_by_tts_once(tts_similarity(seen, p)) == np.arange(8))
        two += np.sum(associate_by_tts(seen, p) == np.arange(8))
    assert two > one > 200


def test_surplus_boxes_stay_without_a_vehicle():
    p = points(2, 7)
    answer = associate_by_tts(p, p[:6])
    assert np.sum(answer < 0) == 1
    assert sorted(answer[answer >= 0].tolist()) == list(range(6))


@pytest.mark.parametrize(
    "flat",
    [
        np.empty((0, 2)),
        np.zeros((1, 2)),
        np.array([[0.0, 0.0], [1.0, 2.0]]),
        np.arange(8.0)[:, None] * [3.0, 1.0],
        np.ones((5, 2)),
        np.array([[0.0, 0.0], [np.nan, 1.0], [2.0, 2.0]]),
    ],
    ids=["nobody", "one", "two", "a line", "one place", "unknown"],
)
def test_without_triangles_nobody_is_associated(flat):
    other = points(1, 5)
    assert not tts_similarity(flat, other).any()
    assert associate_by_tts(flat, other).tolist() == [-1] * len(flat)
    assert associate_by_tts(other, flat).tolist() == [-1] * 5


def test_coinciding_points_among_others_do_no_harm():
    p = np.concatenate([points(4, 6), points(4, 6)[:1]])
    assert np.isfinite(tts_similarity(p, p)).all()


def test_a_wrong_shape_is_told():
    with pytest.raises(ShapeError, match=r"\(n, 2\)"):
        triangle_sequences(np.zeros((4, 3)))
