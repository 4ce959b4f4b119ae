"""Two views of one fleet, of which one is wrong: what would reconcile them is told where the data tell it."""

import numpy as np
import pytest

from assoc.other_views.hearing import Hearing
from assoc.records import Sighting

START = np.array([[0.0, 0.0], [9.0, 4.0], [20.0, -6.0], [31.0, 10.0], [12.0, 16.0]])
CENTRE = np.array([14.0, -40.0])
"""Point, metres, about which vehicles drive circles, and where the wrong camera is."""


def turned(p, angle):
    c, s = np.cos(angle), np.sin(angle)
    return p @ np.array([[c, s], [-s, c]])


def round_a_bend(t):
    return CENTRE + turned(START - CENTRE, 4.0 * t / 50.0)


def crossing(t):
    ways = np.array([[4.0, 0.0], [-3.0, 1.0], [0.0, 4.0], [2.0, -3.0], [-3.0, -2.0]])
    return START + ways * t


def straight_on(t):
    return START + np.array([4.0 * t, 0.0])


def scaled(p, factor, angle=0.0):
    return CENTRE + factor * turned(p - CENTRE, angle)


def seen(t, place, names):
    p = np.full((5, 6), 0.006)
    p[np.arange(5), names] = 0.97
    m, cov = len(place), np.tile(0.16 * np.eye(2), (5, 1, 1))
    return Sighting(t_us=round(1e6 * t), track_id=np.arange(m), place=place, cov_m2=cov, common_std_m=1.5, p=p, fit=1.0)


def flown(drive, wrong, names=(0, 1, 2, 3, 4)):
    """Cause of the difference as the right view has it after six seconds beside the wrong one."""
    rng, hearing, told = np.random.default_rng(3), Hearing(), []
    for t in np.arange(0.0, 6.0, 0.2):
        told.append(seen(t, wrong(t) + rng.normal(0.0, 0.25, START.shape), names))
        hearing.answers(seen(t + 0.05, drive(t + 0.05) + rng.normal(0.0, 0.25, START.shape), range(5)), {7: told[-12:]})
    return hearing._apart[7].cause()


@pytest.mark.parametrize(
    ("drive", "wrong", "kind", "value", "scale"),
    [
        (crossing, lambda t: crossing(t - 1.5), "clock", 1.5, 1.0),
        (crossing, lambda t: crossing(t) + np.array([5.0, -3.0]), "position", 5.83, 1.0),
        (crossing, lambda t: scaled(crossing(t), 1.25), "camera", 0.0, 0.8),
        (round_a_bend, lambda t: round_a_bend(t - 1.5), None, 0.0, 1.0),  # all about one point: a clock or a turn
        (round_a_bend, lambda t: round_a_bend(t) + np.array([5.0, -3.0]), "position", 5.83, 1.0),
        (crossing, lambda t: scaled(crossing(t), 1.0, 0.2), "camera", 0.2, 1.0),
        (straight_on, lambda t: scaled(straight_on(t), 1.3), "camera", 0.0, 1.0 / 1.3),
        (straight_on, lambda t: straight_on(t) + np.array([0.0, 5.0]), "position", 5.0, 1.0),  # not along their way
        (straight_on, lambda t: straight_on(t - 1.5), None, 0.0, 1.0),  # a clock or a position: nobody knows
        (round_a_bend, round_a_bend, None, 0.0, 1.0),
        (round_a_bend, lambda t: round_a_bend(t)[[1, 2, 3, 4, 0]], None, 0.0, 1.0),  # names are mixed up, and no more
    ],
)
def test_what_would_reconcile_two_views(drive, wrong, kind, value, scale):
    cause = flown(drive, wrong)
    assert (cause.kind if cause else None) == kind
    if cause:
        assert (cause.value, cause.scale) == (pytest.approx(value, abs=0.15), pytest.approx(scale, abs=0.03))


def test_two_vehicles_tell_nothing():
    assert flown(round_a_bend, lambda t: round_a_bend(t - 1.5), names=(0, 1, 5, 5, 5)) is None
