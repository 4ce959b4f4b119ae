"""Vehicles that report the place of another: never a wrong name, and an alarm."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from assoc.identification.identifier import Identifier
from tests.support.assoc_scene import Fleet, camera

IDS = (11, 12, 13, 14)


def convoy(seed):
    """Vehicles that drive as one body, so that any of them fits any track but for a constant offset."""
    fleet = Fleet(seed=seed, spacing_m=7.0)
    fleet.phase[:], fleet.size[:] = fleet.phase[0], fleet.size[0]
    fleet.start[:, 1] = 0.0
    return fleet


def spoofed(reports, since_us, rng, spread_m=0.3, late_s=0.0):
    """Vehicle 1 reports the place of vehicle 2, with noise of its own, and where that one was some time ago."""
    mine, other = reports.vehicle == 1, reports.vehicle == 2
    late = mine & (reports.t_us >= since_us)
    p, v, heading = reports.p_enu.copy(), reports.v_enu.copy(), reports.heading.copy()
    for k in np.flatnonzero(late):
        source = np.flatnonzero(other & (reports.t_us == reports.t_us[k]))[0]
        p[k], v[k], heading[k] = reports.p_enu[source], reports.v_enu[source], reports.heading[source]
        p[k, :2] += rng.normal((0.6, -0.4), spread_m) - late_s * v[k, :2]
    return replace(reports, p_enu=p, v_enu=v, heading=heading)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_a_vehicle_that_takes_anothers_place_takes_no_name(seed):
    identifier, fleet, rng = Identifier(IDS), convoy(seed), np.random.default_rng(seed)
    began_us = fleet.observation(8.0, camera(), [1, 2, 3, 4], rng).t_us
    alarmed = []
    for k in range(300):
        t = k / 10
        reports = spoofed(fleet.reports(t - 0.1, t, rng), began_us, rng)
        answer = identifier.update(fleet.observation(t, camera(), [1, 2, 3, 4], rng), camera(), reports)
        named = answer.system_id > 0
        np.testing.assert_array_equal(answer.system_id[named], np.array(IDS)[named])
        alarmed.append(answer.conflict)
    assert not any(alarmed[:80])
    assert all(said == (12, 13) for said in alarmed[120:])
    assert answer.system_id[[0, 3]].tolist() == [11, 14]


@pytest.mark.slow_but_first
@pytest.mark.parametrize("spread_m", [0.0, 0.3], ids=["the same noise", "noise of its own"])
@pytest.mark.parametrize("seed", range(3))
def test_of_two_that_report_one_place_from_the_start_neither_is_named(seed, spread_m):
    identifier, fleet, rng = Identifier(IDS), Fleet(seed=seed, spacing_m=7.0), np.random.default_rng(seed)
    alarmed = []
    for k in range(200):
        t = k / 10
        reports = spoofed(fleet.reports(t - 0.1, t, rng), 0, rng, spread_m)
        answer = identifier.update(fleet.observation(t, camera(), [1, 2, 3, 4], rng), camera(), reports)
        assert not set(answer.system_id[[1, 2]].tolist()) & {12}
        assert 13 not in answer.system_id[[0, 1, 3]]
        alarmed.append(answer.conflict)
    assert all(said == (12, 13) for said in alarmed[40:])
    assert answer.system_id.tolist() == [11, 0, 0, 14]


@pytest.mark.slow
def test_of_two_that_report_one_place_the_one_that_is_not_late_can_be_named():
    identifier, fleet, rng = Identifier(IDS), Fleet(seed=1, spacing_m=12.0), np.random.default_rng(1)
    named = []
    for k in range(200):
        t = k / 10
        reports = spoofed(fleet.reports(t - 0.1, t, rng), 0, rng, late_s=0.6)
        answer = identifier.update(fleet.observation(t, camera(), [1, 2, 3, 4], rng), camera(), reports)
        assert 12 not in answer.system_id
        named.append(answer.system_id[2] == 13)
    assert 13 in answer.conflict
    # the other's offset is within what a bias may be for much of the time
    assert np.mean(named[40:]) > 0.25


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_neighbours_of_whom_one_is_not_detected_are_not_accused(seed):
    """Vehicle 1 drives 4 m from vehicle 2 and has no box for half of the time."""
    identifier, fleet, rng = Identifier(IDS), convoy(seed), np.random.default_rng(seed)
    fleet.start[:, 0] = np.arange(4) * 4.0
    for k in range(200):
        t = k / 10
        seen = fleet.observation(t, camera(), [1, 2, 3, 4], rng)
        if k % 80 >= 40:
            rows = np.array([0, 2, 3])
            fields = ("track_id", "ray_cam", "front_cam", "gap_s", "score")
            seen = replace(seen, **{name: getattr(seen, name)[rows] for name in fields})
        answer = identifier.update(seen, camera(), fleet.reports(t - 0.1, t, rng))
        assert not answer.conflict
        named = answer.system_id > 0
        np.testing.assert_array_equal(answer.system_id[named], answer.track_id[named] + 10)
    assert named.mean() > 0.7
