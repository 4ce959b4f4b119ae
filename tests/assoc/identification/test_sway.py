"""A camera fixed to a swaying body of which no attitude is reported, or one that does not show the sway."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from assoc.identification.identifier import Identifier
from tests.support.assoc_scene import Fleet, camera

IDS = (11, 12, 13, 14, 15)
LEVEL = replace(camera(attitude_known=False), stabilized=False)
SLANTED = replace(
    camera(p=(0.0, -78.0, 45.0)),
    R_enu_cam=Rotation.from_rotvec([np.deg2rad(60.0), 0.0, 0.0]).as_matrix() @ LEVEL.R_enu_cam,
    stabilized=False,
    of_image_time=True,
)
"""Northward, 30° below the horizon."""


def swayed(told, t, size_deg):
    """The true camera: it turns about east, north and up beyond what is told of it."""
    turn = np.deg2rad(size_deg) * np.sin([1.3 * t, 1.1 * t + 1.0, 0.9 * t + 2.0])
    return replace(told, R_enu_cam=Rotation.from_rotvec(turn).as_matrix() @ told.R_enu_cam)


def play(identifier, told, size_deg, seen, reporting, seconds):
    """(frames, 5) names of the vehicles of one fleet while another one reports, 10 frames a second."""
    rng, names, heard = np.random.default_rng(1), [], -1.0
    for t in np.arange(int(10 * seconds)) / 10.0:
        reports, heard = reporting.reports(heard, t, rng), t
        observation = seen.observation(t, swayed(told, t, np.array(size_deg)), np.arange(1, seen.n + 1), rng)
        names.append(identifier.update(observation, told, reports).system_id)
    return np.array(names)


@pytest.mark.slow
@pytest.mark.parametrize(("told", "size_deg"), [(LEVEL, (3.0, 2.5, 0.0)), (SLANTED, (0.5, 0.5, 0.5))])
def test_vehicles_below_a_swaying_camera_are_named(told, size_deg):
    fleet = Fleet(n=5, spacing_m=6.0)
    names = play(Identifier(IDS), told, size_deg, fleet, fleet, 7.0)
    assert (names[20:] == IDS).mean() > 0.98
    assert np.isin(names, (0, *IDS)).all()


@pytest.mark.slow
def test_a_sway_does_not_make_another_fleet_fit():
    seen, reporting = Fleet(n=5, spacing_m=7.0), Fleet(n=5, spacing_m=11.0, seed=5)
    names = play(Identifier(IDS), LEVEL, (3.0, 2.5, 0.0), seen, reporting, 4.0)
    assert (names[20:] != 0).mean() < 0.02
