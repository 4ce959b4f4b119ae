"""Bumps under vehicles, by their own altitudes: followed where there are any, and not made up from noise."""

import numpy as np
import pytest

from gcs.fold.ground.vehicle_relief import VehicleRelief

N, STEP_S = 6, 0.1


def drive(relief_m, *, noise_m, seconds=60.0, seed=1):
    """What is found and what is true, (k, n), of vehicles off by some metres, at 5 Hz."""
    rng, found = np.random.default_rng(seed), VehicleRelief(N)
    error, said, answers, truth = rng.normal(0.0, 3.0, N), np.zeros(N), [], []
    for k, t_s in enumerate(np.arange(0.0, seconds, STEP_S)):
        true = relief_m * np.sin(2.0 * np.pi * (t_s / 16.0 + np.arange(N) / N))
        if k % 2 == 0:
            said = true + error + rng.normal(0.0, noise_m, N)
        found.update(said, STEP_S)
        answers.append(found.heights_m)
        truth.append(true)
    return np.array(answers[300:]), np.array(truth[300:])


@pytest.mark.parametrize(("relief_m", "noise_m"), [(6.0, 0.5), (3.0, 0.8)])
def test_waves_are_followed(relief_m, noise_m):
    found, truth = drive(relief_m, noise_m=noise_m)
    assert np.std(found - truth) < 0.5 * np.std(truth)


@pytest.mark.parametrize("noise_m", [0.0, 0.8, 3.0])
def test_noise_on_even_ground_is_no_relief(noise_m):
    found, _ = drive(0.0, noise_m=noise_m)
    assert np.std(found) <= 0.15 * noise_m


def test_a_vehicle_without_altitude_has_none():
    found = VehicleRelief(2)
    for k in range(100):
        found.update(np.array([3.0 * np.sin(0.05 * k), np.nan]), STEP_S)
    assert found.heights_m[0] != 0.0 and found.heights_m[1] == 0.0
