"""Leaps of a clock that the path tells, and what looks like one and is none."""

import numpy as np
import pytest

from gcs.importing.checks.clock_leaps import path_leaps
from infra.clock_steps import set_back

T_US = np.arange(0, 60_000_000, 200_000)
MIDDLE = len(T_US) // 2


def drive(t_us, speed_mps=3.0, noise_m=0.03):
    """A winding path, driven by a vehicle that brakes and speeds up."""
    t_s = t_us * 1e-6
    way_m = speed_mps * (t_s + 2.0 * np.sin(t_s / 5.0))
    noise = np.random.default_rng(1).normal(0.0, noise_m, (len(t_us), 2))
    return np.column_stack([way_m, 20.0 * np.sin(way_m / 40.0)]) + noise


@pytest.mark.parametrize("by_us", [-150_000, 120_000, 400_000, 900_000])
@pytest.mark.parametrize("lost", [0.0, 0.1])
def test_a_leap_is_found_where_it_is(by_us, lost):
    kept = np.random.default_rng(2).random(len(T_US)) >= lost
    kept[MIDDLE - 3 : MIDDLE + 3] = True
    t_us, row = T_US[kept], int(np.count_nonzero(kept[:MIDDLE]))
    told = t_us + by_us * (np.arange(len(t_us)) >= row)
    assert path_leaps(told, drive(t_us)) == [(row - 1, by_us)]


GOOD = {
    "whole": np.ones(len(T_US), bool),
    "one in ten lost": np.random.default_rng(3).random(len(T_US)) >= 0.1,
    "one in three lost": np.random.default_rng(4).random(len(T_US)) >= 0.33,
    "seconds lost": np.abs(T_US - 30_000_000) > 2_000_000,
}


@pytest.mark.parametrize("kept", GOOD.values(), ids=GOOD)
@pytest.mark.parametrize("late_us", [0, 20_000])
def test_none_is_found_where_there_is_none(kept, late_us):
    t_us = T_US[kept]
    late = np.random.default_rng(5).integers(0, late_us + 1, len(t_us))
    assert path_leaps(t_us + late, drive(t_us)) == []


RANDOM = np.random.default_rng(6)
LATE = {
    "by a jitter": np.abs(RANDOM.normal(0.0, 30_000, len(T_US))),
    "by a queue": RANDOM.exponential(50_000, len(T_US)),
    "so that rows overtake each other": RANDOM.exponential(150_000, len(T_US)),
    "cut to the second before": -(T_US % 1_000_000),
}


@pytest.mark.parametrize("late_us", LATE.values(), ids=LATE)
def test_stamps_that_come_late_are_no_clock_that_was_set(late_us):
    told = T_US + np.rint(late_us).astype(np.int64)
    assert set_back(told) == []
    assert path_leaps(np.sort(told), drive(T_US)) == []


def test_who_stands_tells_nothing():
    assert path_leaps(T_US + 400_000 * (T_US[MIDDLE] <= T_US), drive(T_US, speed_mps=0.0)) == []
