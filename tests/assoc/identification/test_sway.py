"""A camera fixed to a swaying body of which no attitude is reported."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from assoc.identification.identifier import Identifier
from tests.support.assoc_scene import Fleet, camera

IDS = (11, 12, 13, 14, 15)
LEVEL = replace(camera(attitude_known=False), stabilized=False)


def tilt_at(t):
    """Pitch and roll, radians: a second of it is metres on the ground."""
    return np.deg2rad([3.0 * np.sin(1.3 * t), 2.5 * np.sin(1.1 * t + 1.0)])


def swayed(t):
    """The true camera: with the top of its image to the north, right is east and forward is north."""
    return replace(LEVEL, R_enu_cam=Rotation.from_rotvec([*tilt_at(t), 0.0]).as_matrix() @ LEVEL.R_enu_cam)


def play(identifier, seen, reporting, seconds):
    """(frames, 5) names of the vehicles of one fleet while another one reports, 10 frames a second."""
    rng, names, heard = np.random.default_rng(1), [], -1.0
    for t in np.arange(int(10 * seconds)) / 10.0:
        reports, heard = reporting.reports(heard, t, rng), t
        observation = seen.observation(t, swayed(t), np.arange(1, seen.n + 1), rng)
        names.append(identifier.update(observation, LEVEL, reports).system_id)
    return np.array(names)


def test_vehicles_below_a_swaying_camera_are_named():
    fleet = Fleet(n=5, spacing_m=7.0)
    names = play(Identifier(IDS), fleet, fleet, 8.0)
    assert (names[20:] == IDS).mean() > 0.98
    assert np.isin(names, (0, *IDS)).all()


def test_a_sway_does_not_make_another_fleet_fit():
    names = play(Identifier(IDS), Fleet(n=5, spacing_m=7.0), Fleet(n=5, spacing_m=11.0, seed=5), 4.0)
    assert (names[20:] != 0).mean() < 0.02
