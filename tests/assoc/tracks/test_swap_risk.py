"""When names are doubted because a tracker may have exchanged two tracks."""

from __future__ import annotations

import numpy as np
import pytest

from assoc.params import IdentifierParams
from assoc.tracks.swap_risk import SwapRisk

PARAMS = IdentifierParams()
CALM = np.log(PARAMS.switch_rate * PARAMS.block_s)
RISKY = np.log(PARAMS.switch_rate_leap * PARAMS.block_s)
COLUMNS = np.arange(2)
GONE = (np.nan, np.nan)


def chances(places, missed):
    """ln chance of a change of owner of two tracks in the second block, after a calm first."""
    risk = SwapRisk(PARAMS)
    risk.update(0.5, COLUMNS, np.array([(0.0, 0.0), places[1]]), np.zeros(2, bool), 0)
    now = np.array([GONE if away else place for place, away in zip(places, missed, strict=True)])
    risk.update(1.5, COLUMNS, now, np.array(missed), 0)
    return risk.log_chances(1, 1, COLUMNS)[0]


@pytest.mark.parametrize(("apart_m", "risky"), [(1.5, True), (12.0, False)])
def test_missed_together(apart_m, risky):
    said = chances([(0.0, 0.0), (apart_m, 0.0)], (True, True))
    assert (said == RISKY).all() == risky
    assert (said < RISKY).all() != risky


def test_one_missed_beside_one_that_is_seen():
    said = chances([(0.0, 0.0), (1.5, 0.0)], (True, False))
    assert (said < RISKY).all()


def test_both_seen_far_apart():
    np.testing.assert_allclose(chances([(0.0, 0.0), (12.0, 0.0)], (False, False)), CALM)


def test_missed_between_two_looks():
    risk = SwapRisk(PARAMS)
    places = np.array([(0.0, 0.0), (1.5, 0.0)])
    for t in (0.5, 1.5):
        risk.update(t, COLUMNS, places, np.full(2, t > 1.0), 0)
    np.testing.assert_allclose(risk.log_chances(1, 1, COLUMNS)[0], RISKY)
