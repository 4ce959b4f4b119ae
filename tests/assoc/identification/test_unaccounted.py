"""Boxes without a name are surely strangers only while all vehicles are accounted for."""

import numpy as np
import pytest

from assoc.identification.unaccounted import Whereabouts, shared_with_missing

N = 3
STRANGER = [0.0, 0.0, 0.0, 1.0]


def fleet(**changes):
    """Three vehicles 50 m apart that report and are in view."""
    values = {
        "place": np.array([[0.0, 0.0], [50.0, 0.0], [100.0, 0.0]]),
        "age_s": np.zeros(N),
        "view": np.ones(N),
        "last_t": np.full(N, 100.0),
    }
    return Whereabouts(**(values | changes))


def told(p, who=None, *, place=None, first_s=200.0, score=-20.0, elsewhere=False, former=-1):
    """Marginals of m tracks, all at the first vehicle's place unless told otherwise."""
    m = len(p)
    return shared_with_missing(
        np.array(p),
        np.zeros((m, 2)) if place is None else np.array(place),
        np.full(m, first_s),
        np.full((m, N), score),
        np.full((m, N), elsewhere),
        np.full(m, former),
        who or fleet(),
    )


NAMED = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]]


def test_a_stranger_beside_a_whole_fleet_stays_one():
    got = told([*NAMED, STRANGER])
    assert got[3, -1] == 1.0


@pytest.mark.parametrize("age_s", [0.5, 30.0, np.inf])
def test_a_box_may_be_a_vehicle_that_has_none(age_s):
    who = fleet(age_s=np.array([age_s, 0.0, 0.0]))
    got = told([*NAMED[1:], STRANGER], who)
    assert got[2, 0] == pytest.approx(0.45)
    assert got[2, -1] == pytest.approx(0.55)
    assert got[:2].tolist() == NAMED[1:]
    assert got.sum(axis=1) == pytest.approx(1.0)


def test_several_boxes_share_what_may_be_one_vehicle():
    got = told([*NAMED[1:], *[STRANGER] * 4])
    assert got[2:, 0] == pytest.approx(0.18)
    assert told([*NAMED[1:], *[STRANGER] * 20])[2:, -1].max() < 0.9


@pytest.mark.parametrize(
    "known",
    [
        {"who": fleet(view=np.array([0.0, 1.0, 1.0]))},
        {"elsewhere": True},
        {"who": fleet(age_s=np.array([5.0, 0.0, 0.0])), "place": [[50.0, 0.0], [100.0, 0.0], [80.0, 0.0]]},
        {"who": fleet(age_s=np.array([5.0, 0.0, 0.0])), "first_s": 50.0},
    ],
    ids=["out of view", "seen side by side", "too far to have driven", "compared before it fell silent"],
)
def test_what_rules_a_vehicle_out(known):
    assert told([*NAMED[1:], STRANGER], **known)[2, -1] == 1.0


def test_a_vehicle_that_now_reports_from_elsewhere_may_still_be_the_track_it_was():
    who = fleet(view=np.array([0.0, 1.0, 1.0]))
    got = told([*NAMED[1:], STRANGER], who, former=0)
    assert got[2, 0] == pytest.approx(0.45)


def test_a_vehicle_that_was_never_heard_may_be_anywhere():
    who = fleet(place=np.array([[np.nan, np.nan], [50.0, 0.0], [100.0, 0.0]]), age_s=np.array([np.inf, 0.0, 0.0]))
    assert told([*NAMED[1:], STRANGER], who)[2, 0] == pytest.approx(0.45)
