"""A mission that is wrong about the camera: its picture is mirrored, which no correction of the pose undoes."""

from dataclasses import replace

import numpy as np
import pytest

from assoc.identification.identifier import Identifier
from tests.support.assoc_scene import Fleet, camera

IDS = (11, 12, 13, 14, 15, 16)
MIRROR = np.array([-1.0, 1.0, 1.0])


def play(identifier, fleet, seconds, mirrored, shown=None):
    """Names of each frame of a film, mirrored or not, of the fleet or of another that is shown instead; whether it was
    taken for mirrored then."""
    rng, names, found = np.random.default_rng(1), [], []
    for k in range(round(seconds * 10)):
        t = k / 10
        seen = (shown or fleet).observation(t, camera(), np.arange(1, len(IDS) + 1), rng)
        if mirrored:
            seen = replace(seen, ray_cam=seen.ray_cam * MIRROR, front_cam=seen.front_cam * MIRROR)
        names.append(identifier.update(seen, camera(), fleet.reports(t - 0.1, t, rng)).system_id)
        found.append(identifier.mirrored)
    return np.array(names), np.array(found)


@pytest.mark.slow_but_first
@pytest.mark.parametrize("seed", [0, 1, 3])
def test_a_mirrored_picture_is_found_and_named(seed):
    identifier = Identifier(IDS)
    names, found = play(identifier, Fleet(n=6, seed=seed), 5.0, mirrored=True)
    assert found[30:].all()
    assert (names[30:] == IDS).all()
    assert not names[~found].any()
    assert ((names == 0) | (names == IDS)).all()


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_no_other_picture_is_taken_for_a_mirrored_one(seed):
    fleet, other = Fleet(n=6, seed=seed), Fleet(n=6, seed=seed + 20)
    assert not play(Identifier(IDS), fleet, 3.0, mirrored=False)[1].any()
    assert not play(Identifier(IDS), fleet, 6.0, mirrored=False, shown=other)[1].any()


def test_a_place_is_seen_where_the_mirror_shows_it():
    identifier = Identifier(IDS)
    play(identifier, Fleet(n=6, seed=1, bias_m=0.0), 3.0, mirrored=True)
    ray = identifier.expected_rays(np.array([[8.0, 0.0, 0.0]]), camera())[0]
    assert ray[0] / ray[2] == pytest.approx(-0.2, abs=0.03)
