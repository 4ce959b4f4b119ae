import numpy as np
import pytest

from gcs.importing.smoothing import filled_in, smooth_path, smoothed_places
from gcs.importing.vehicle_log import PlaceTrack

T = np.arange(0.0, 60.0)
PATH = 30.0 * np.sin(T / 9.0) + 1.5 * T
"""Metres at each second: 5 m/s at most, slow turns."""


def test_a_path_rounded_to_11_m_is_followed_to_a_metre():
    cell_m = 11.1
    rounded = np.round(PATH / cell_m) * cell_m
    found, v = smooth_path(T, rounded, 0.3, cell_m)
    assert np.std(rounded - PATH) > 3.0
    assert np.std(found - PATH) < 1.2
    assert np.abs(found - rounded).max() < 0.51 * cell_m
    assert np.std(v - np.gradient(PATH, T)) < 0.7


def test_fine_positions_stay_where_they_are():
    noisy = PATH + np.random.default_rng(3).normal(0.0, 0.3, len(T))
    found, v = smooth_path(T, noisy, 0.3, 0.1)
    assert np.std(found - PATH) < 0.3
    assert np.std(v - np.gradient(PATH, T)) < 0.4


@pytest.mark.parametrize("n", [0, 1, 2, 3])
def test_few_positions(n):
    found, v = smooth_path(T[:n], PATH[:n], 0.3, 11.0)
    assert len(found) == len(v) == n
    assert np.abs(found - PATH[:n]).max(initial=0.0) < 1.0


def test_no_velocity_where_positions_are_coarse():
    degrees = np.column_stack([48.0 + np.round(PATH / 11.1) * 1e-4, np.full(len(T), 11.0)])
    wide = {"alt_m": T, "height_m": T, "noise_m": 0.3, "std_m": 3.5}
    coarse = smoothed_places((T * 1e6).astype(np.int64), degrees, cell_deg=1e-4, **wide)
    fine = smoothed_places((T * 1e6).astype(np.int64), degrees, cell_deg=1e-6, **wide)
    assert np.isnan(coarse.v_ned).all()
    assert np.isfinite(fine.v_ned[:, :2]).all()


def test_a_position_a_second_is_filled_in_but_over_no_hole():
    rows = np.r_[0:20, 40:60]
    t_us = (T[rows] * 1e6).astype(np.int64)
    lat = 48.0 + PATH[rows] / 111_320.0
    track = filled_in(PlaceTrack.of(t_us, lat, np.full(len(rows), 11.0), alt_m=T[rows], height_m=T[rows]))
    assert np.diff(track.t_us).max() == 21_000_000
    assert np.median(np.diff(track.t_us)) == pytest.approx(90_000, abs=1)
    at = track.t_us * 1e-6
    inside = (at < 19.0) | (at > 40.0)
    truth = 30.0 * np.sin(at / 9.0) + 1.5 * at
    assert (track.lat_deg[inside] - 48.0) * 111_320.0 == pytest.approx(truth[inside], abs=0.3)
    assert track.alt_m == pytest.approx(at)
    assert np.isnan(track.v_ned).all()


def test_ten_a_second_stay_as_they_are():
    t_us = np.arange(0, 5_000_000, 100_000)
    track = PlaceTrack.of(t_us, np.full(50, 48.0), np.full(50, 11.0))
    assert filled_in(track) is track
