import numpy as np
import pytest

from assoc.geometry.ground import EAST, NORTH, THETA
from assoc.geometry.sway import Sway, wander_of


@pytest.mark.parametrize("position_std_m", [0.0, 1e-300, 2.5, 3.5, 1e5, 1e300])
def test_a_wander_is_of_decimetres_whatever_precision_is_told(position_std_m):
    assert 0.0 < wander_of(position_std_m).std <= 1.0


def test_a_wander_moves_the_camera_and_does_not_turn_it():
    sway = Sway(t=np.array([0.0, 1.0]), off=np.array([[0.0, 1.0], [2.0, 1.0]]), prior=wander_of(3.5))
    beyond = sway.at(np.array([0.5, 9.0]))
    assert beyond.shape == (2, THETA)
    assert beyond[:, [EAST, NORTH]] == pytest.approx(np.array([[1.0, 1.0], [2.0, 1.0]]))
    assert np.count_nonzero(np.delete(beyond, [EAST, NORTH], axis=1)) == 0
