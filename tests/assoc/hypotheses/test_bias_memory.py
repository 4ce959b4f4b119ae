"""What a vehicle's tracks taught of its position error, and which new tracks it counts for."""

import numpy as np
import pytest

from assoc.hypotheses.bias_memory import BiasMemory

BIAS_STD_M, TAU_S = 1.5, 60.0
OWN_M, STRANGERS_M = np.array([[2.0, -1.0]]), np.array([[-5.0, 1.0]])
VEHICLE, VAR = np.array([0]), np.array([0.2])


@pytest.fixture
def memory():
    memory = BiasMemory(1)
    memory.store(10.0, VEHICLE, np.array([3]), OWN_M, VAR)
    return memory


def test_without_a_track_nothing_is_known():
    mean, var = BiasMemory(1).recall(5.0, BIAS_STD_M, TAU_S)
    assert mean.tolist() == [[0.0, 0.0]]
    assert var[0] == pytest.approx(BIAS_STD_M**2)


def test_the_last_track_counts_while_no_other_is_seen(memory):
    memory.store(12.0, VEHICLE, np.array([4]), STRANGERS_M, VAR)
    mean, var = memory.recall(12.0, BIAS_STD_M, TAU_S, np.array([8, 9]))
    np.testing.assert_allclose(mean, STRANGERS_M)
    assert var[0] == pytest.approx(VAR[0] + 0.05)


def test_a_track_in_sight_teaches_nothing_about_another_one_that_may_be_its_vehicle(memory):
    """A stranger got the name; when the vehicle itself comes into view, it is judged by what was known before."""
    for t in (12.0, 12.3, 12.6):
        memory.store(t, VEHICLE, np.array([4]), STRANGERS_M, VAR)
    mean, var = memory.recall(13.0, BIAS_STD_M, TAU_S, np.array([4]))
    decay = np.exp(-3.0 / TAU_S)
    np.testing.assert_allclose(mean, OWN_M * decay)
    assert var[0] == pytest.approx((VAR[0] + 0.05) * decay**2 + (1.0 - decay**2) * BIAS_STD_M**2)


def test_the_first_track_in_sight_leaves_the_prior_to_others(memory):
    mean, var = memory.recall(10.5, BIAS_STD_M, TAU_S, np.array([3]))
    assert mean.tolist() == [[0.0, 0.0]]
    assert var[0] == pytest.approx(BIAS_STD_M**2)
