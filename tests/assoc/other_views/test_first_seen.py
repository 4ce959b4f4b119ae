"""Tracks of two views that are one object are the same in both, by who saw it first."""

import numpy as np
import pytest

from assoc.other_views.first_seen import FirstSeen, FirstSeenTracks, Heard

A, B = 1, 2


def two(frames):
    """Two views, A before B, that hear each other: what A and B have in the end.

    Args:
        frames: tracks of A, tracks of B, and the probability of each pair to be one.
    """
    views = {A: FirstSeenTracks(A), B: FirstSeenTracks(B)}
    for k, (of_a, of_b, same) in enumerate(frames):
        p, t_us = np.array(same, float).reshape(len(of_a), len(of_b)), 100_000 * k
        before = {view: tracks.all for view, tracks in views.items()}
        views[A].update(t_us, np.array(of_a, int), [Heard(B, np.array(of_b, int), p, before[B])])
        views[B].update(t_us + 50_000, np.array(of_b, int), [Heard(A, np.array(of_a, int), p.T, views[A].all)])
    return [{track: first[1:] for track, first in tracks.all.items()} for tracks in views.values()]


@pytest.mark.parametrize(
    ("frames", "of_a", "of_b"),
    [
        ([([7], [3], [0.9])] * 3, {7: (A, 7)}, {3: (A, 7)}),
        ([([7], [3], [0.5])] * 3, {7: (A, 7)}, {3: (B, 3)}),
        ([([], [3], []), *[([7], [3], [0.9])] * 3], {7: (B, 3)}, {3: (B, 3)}),  # the earlier one counts
        # a track that was lost goes on as another one, and is known again by what the other view has
        ([([7], [3], [0.9])] * 2 + [([8], [3], [0.9])] * 2, {7: (A, 7), 8: (A, 7)}, {3: (A, 7)}),
        # what turns out to be another one is so
        ([([7], [3], [0.9])] * 2 + [([7], [3], [0.1])] * 2, {7: (A, 7)}, {3: (B, 3)}),
        # two boxes are two objects
        ([([7], [3, 4], [0.9, 0.9])] * 3, {7: (A, 7)}, {3: (A, 7), 4: (B, 4)}),
    ],
)
def test_the_view_that_saw_it_first_gives_the_number(frames, of_a, of_b):
    assert two(frames) == [of_a, of_b]


def test_what_was_not_seen_for_long_is_forgotten():
    tracks = FirstSeenTracks(A)
    tracks.update(0, np.array([1]), [Heard(B, np.array([5]), np.ones((1, 1)), {5: FirstSeen(-1, B, 5)})])
    assert tracks.of(1)[1:] == (B, 5) and tracks.of(2)[1:] == (A, 2)
    tracks.update(60_000_000, np.array([2]), [])
    assert tracks.of(1)[1:] == (A, 1)
