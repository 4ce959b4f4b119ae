"""A change of name is put back to the moment at which its track could be exchanged."""

from __future__ import annotations

import numpy as np
import pytest

from assoc.whole_flight.exchanges import names_since_exchanges

FRAMES = np.arange(0.0, 12.0, 0.1)
CROSSED, CLOSE_M = 5.0, 3.0
A, B = 3, 7


def crossing(apart_m=0.5):
    """(F, 2, 2) places of two tracks that meet when they cross, and drive apart."""
    along = 2.0 * (FRAMES - CROSSED)
    aside = np.full_like(along, 0.5 * apart_m)
    return np.stack([np.stack([along, aside], axis=1), np.stack([-along, -aside], axis=1)], axis=1)


def since_exchanges(name, places=None):
    """The names since exchanges of two tracks that had names (F, 2)."""
    places = crossing() if places is None else places
    told = names_since_exchanges(FRAMES.tolist(), [[A, B]] * len(FRAMES), list(places), name.tolist(), CLOSE_M)
    return np.array(told)


def exchanged_at(first, second=None):
    """(F, 2) names of two tracks that are exchanged at a time each."""
    second = first if second is None else second
    return np.stack([np.where(first > FRAMES, 0, 1), np.where(second > FRAMES, 1, 0)], axis=1)


@pytest.mark.parametrize(("first", "second"), [(8.0, 8.0), (7.0, 9.5)])
def test_names_change_where_the_tracks_were_nearest(first, second):
    np.testing.assert_array_equal(since_exchanges(exchanged_at(first, second)), exchanged_at(CROSSED))


def test_a_name_unknown_for_a_while_changes_there_too():
    name = exchanged_at(8.0)
    name[(FRAMES > 4.0) & (FRAMES < 8.0)] = -1
    told = since_exchanges(name)
    np.testing.assert_array_equal(told[FRAMES >= CROSSED], exchanged_at(CROSSED)[FRAMES >= CROSSED])


def test_tracks_that_never_met_keep_their_names():
    name = exchanged_at(8.0)
    np.testing.assert_array_equal(since_exchanges(name, crossing(apart_m=2.0 * CLOSE_M)), name)


def test_a_name_that_does_not_last_is_no_exchange():
    name = exchanged_at(99.0)
    name[(FRAMES > 8.0) & (FRAMES < 8.45)] = [1, 0]
    np.testing.assert_array_equal(since_exchanges(name), name)


def test_one_that_begins_beside_the_other_takes_its_name_from_there():
    places = crossing()
    ids = [[A] if t < CROSSED else [A, B] for t in FRAMES.tolist()]
    names = [[0] if t < CROSSED else [0, -1] if t < 8.0 else [1, 0] for t in FRAMES.tolist()]
    at = [place[: len(each)] for place, each in zip(places, ids, strict=True)]
    told = names_since_exchanges(FRAMES.tolist(), ids, at, names, CLOSE_M)
    assert [each[0] for each in told] == [0 if t < CROSSED else 1 for t in FRAMES.tolist()]


def test_nothing_seen_has_no_names():
    assert names_since_exchanges([0.0, 0.1], [[], []], [np.zeros((0, 2))] * 2, [[], []], CLOSE_M) == [[], []]
