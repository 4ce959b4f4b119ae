"""A clock's offset is found to a tenth of a second within hours, and never taken where it cannot be told."""

from dataclasses import replace

import numpy as np
import pytest

from assoc.clock_search.inputs import CameraPath, FleetLog
from assoc.clock_search.search import ClockVerdict, find_clock
from assoc.errors import ShapeError
from tests.support.films.clock_film import FilmedFleet, without

ANY = (-90_000.0, 90_000.0)


@pytest.mark.slow_but_first
@pytest.mark.parametrize("ahead_s", [0.0, 0.3, 3.0, -30.0, 600.0, 3600.0, -7200.0])
def test_offset_is_found_in_an_hour_of_reports(ahead_s):
    fleet = FilmedFleet(ahead_s=ahead_s)
    found = find_clock(fleet.film(), fleet.path(), fleet.log(), ANY)
    assert found.verdict is ClockVerdict.FOUND
    assert abs(found.best.offset_s - ahead_s) < 0.15
    assert found.best.vehicles == fleet.n
    assert found.runner_up.evidence < 0.65 * found.best.evidence


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fleet", "film", "path"),
    [
        (FilmedFleet(n=2, seed=2, ahead_s=77.7), {}, {}),
        (FilmedFleet(n=5, seed=3, ahead_s=77.7), {"clutter": 6, "missed": 0.25}, {}),
        (FilmedFleet(n=4, seed=4, ahead_s=77.7), {}, {"heading_known": False}),
        (FilmedFleet(n=4, seed=5, ahead_s=77.7, uav_mps=3.0), {}, {}),
        (FilmedFleet(n=4, seed=6, ahead_s=77.7, bias_m=1.5), {}, {}),
    ],
    ids=["two vehicles", "clutter", "no heading", "flying along", "poor receivers"],
)
def test_offset_is_found_under_difficulties(fleet, film, path):
    found = find_clock(fleet.film(**film), fleet.path(**path), fleet.log(), ANY)
    assert found.verdict is ClockVerdict.FOUND
    assert abs(found.best.offset_s - 77.7) < 0.2


@pytest.mark.slow
def test_offset_of_a_video_against_uav_and_fleet_together():
    fleet = FilmedFleet(ahead_s=-245.25, uav_mps=2.0)
    path = fleet.path(ahead_s=-245.25, log_s=(-400.0, 600.0))
    found = find_clock(fleet.film(), path, fleet.log(-400.0, 600.0), ANY, camera_too=True)
    assert found.verdict is ClockVerdict.FOUND
    assert abs(found.best.offset_s + 245.25) < 0.15


@pytest.mark.slow
def test_vehicles_that_stand_all_the_time_are_refused():
    fleet = FilmedFleet(still=True)
    found = find_clock(fleet.film(), fleet.path(), fleet.log(), ANY)
    assert found.verdict is ClockVerdict.AMBIGUOUS
    assert abs(found.best.offset_s - found.runner_up.offset_s) > 0.8


@pytest.mark.slow
def test_vehicles_that_do_the_same_again_and_again_are_refused_with_both_times():
    fleet = FilmedFleet(period_s=120.0, ahead_s=50.0)
    found = find_clock(fleet.film(), fleet.path(), fleet.log(), ANY)
    assert found.verdict is ClockVerdict.AMBIGUOUS
    for fit in (found.best, found.runner_up):
        assert abs((fit.offset_s - 50.0 + 60.0) % 120.0 - 60.0) < 0.3


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_nothing_is_found_where_the_time_of_the_film_is_not_in_the_log(seed):
    fleet = FilmedFleet(seed=seed)
    log = without(fleet.log(), -100.0, 140.0)
    assert find_clock(fleet.film(), fleet.path(), log, ANY).verdict is not ClockVerdict.FOUND


@pytest.mark.slow
def test_nothing_is_found_beyond_the_bounds():
    fleet = FilmedFleet(ahead_s=300.0)
    assert find_clock(fleet.film(), fleet.path(), fleet.log(), (-60.0, 60.0)).verdict is not ClockVerdict.FOUND
    assert find_clock(fleet.film(), fleet.path(), fleet.log(), (240.0, 360.0)).verdict is ClockVerdict.FOUND


def test_bounds_in_which_the_log_has_nothing_are_told_apart():
    fleet = FilmedFleet()
    found = find_clock(fleet.film(), fleet.path(), fleet.log(), (50_000.0, 60_000.0))
    assert found.verdict is ClockVerdict.NO_OVERLAP
    assert found.best is None


@pytest.mark.slow
def test_reports_of_years_apart_are_no_burden():
    fleet = FilmedFleet(ahead_s=40.0)
    log = fleet.log(-200.0, 300.0)
    stray = replace(
        log,
        t=np.concatenate([log.t, [-1.7e9, 1.7e9, 1.7e9 + 1.0]]),
        vehicle=np.concatenate([log.vehicle, [0, 0, 0]]),
        p_enu=np.concatenate([log.p_enu, np.zeros((3, 2))]),
    )
    found = find_clock(fleet.film(), fleet.path(), stray, (-np.inf, np.inf))
    assert found.verdict is ClockVerdict.FOUND
    assert abs(found.best.offset_s - 40.0) < 0.15


@pytest.mark.slow
def test_a_log_that_begins_in_the_middle_of_the_film_is_enough():
    fleet = FilmedFleet(ahead_s=1000.0)
    found = find_clock(fleet.film(), fleet.path(), fleet.log(15.0, 900.0), ANY)
    assert found.verdict is ClockVerdict.FOUND
    assert abs(found.best.offset_s - 1000.0) < 0.2


@pytest.mark.slow
def test_the_film_may_be_of_none_of_ours():
    film = FilmedFleet(seed=11)
    other = FilmedFleet(seed=12)
    assert find_clock(film.film(), film.path(), other.log(), ANY).verdict is not ClockVerdict.FOUND


def test_inputs_of_wrong_shape_are_refused():
    with pytest.raises(ShapeError, match="p_enu: expected shape"):
        FleetLog(n=1, t=np.zeros(3), vehicle=np.zeros(3, np.int64), p_enu=np.zeros((2, 2)))
    with pytest.raises(ShapeError, match="vehicle: expected 0 to 0"):
        FleetLog(n=1, t=np.zeros(1), vehicle=np.ones(1, np.int64), p_enu=np.zeros((1, 2)))
    with pytest.raises(ShapeError, match="t: expected increasing times"):
        CameraPath(
            t=np.zeros(2),
            R_enu_cam=np.zeros((2, 3, 3)),
            p_enu=np.zeros((2, 3)),
            ground_z=0.0,
            px_rad=1e-3,
            heading_known=True,
            half_view=(0.8, 0.45),
        )
