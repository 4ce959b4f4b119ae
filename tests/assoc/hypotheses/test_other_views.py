"""What one view tells another of the vehicles' receivers."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from assoc.evidence.likelihood import initial_state
from assoc.geometry.ground import EAST, THETA, YAW
from assoc.hypotheses.other_views import LearntBiases, SharedBiases
from assoc.records import CameraState

IDS = np.array([11, 12, 13])
STD, TAU = 1.5, 60.0
ORIGIN_US = 1_000_000_000
CAMERA = CameraState(R_enu_cam=np.eye(3), p_enu=np.zeros(3), ground_z=0.0, px_rad=1e-3)


def told(**changes):
    whole = LearntBiases(
        system_id=np.array([12]), t_us=np.array([ORIGIN_US]), mean=np.array([[1.0, -2.0]]), var=np.array([0.1])
    )
    return replace(whole, **changes)


def heard(learnt):
    shared = SharedBiases(len(IDS))
    shared.hear(IDS, ORIGIN_US, learnt)
    return shared


def unknown(n=1):
    return np.zeros((n, 3, 2)), np.full((n, 3), STD**2)


@pytest.mark.parametrize("t", [-30.0, 0.0, 30.0])
def test_what_was_told_is_as_of_its_time(t):
    mean, var, better = heard(told()).better_of(np.array([t]), *unknown(), STD, TAU)
    decay = np.exp(-abs(t) / TAU)
    assert mean[0, 1] == pytest.approx(decay * np.array([1.0, -2.0]))
    assert var[0, 1] == pytest.approx(decay**2 * 0.1 + (1.0 - decay**2) * STD**2)
    assert better.tolist() == [[False, True, False]]
    assert np.all(var[0, [0, 2]] == STD**2)


@pytest.mark.parametrize(
    "learnt", [told(mean=np.array([[9.0, 0.0]])), told(system_id=np.array([99])), told(var=np.array([2.0 * STD**2]))]
)
def test_another_vehicles_a_strangers_and_nothing_count_for_nothing(learnt):
    _, var, better = heard(learnt).better_of(np.zeros(1), *unknown(), STD, TAU)
    assert not better.any()
    assert np.all(var == STD**2)


def test_pairs_that_were_compared_keep_their_own_evidence():
    state = replace(initial_state(2, 3), var=np.full((2, 3), STD**2), seen=np.array([[False] * 3, [True] * 3]))
    begun = heard(told()).begun(state, np.zeros(2), STD, TAU)
    assert begun.var[0, 1] == pytest.approx(0.1)
    assert np.array_equal(begun.var[1], state.var[1])
    assert SharedBiases(3).begun(state, np.zeros(2), STD, TAU) is state


def best(*vehicles, mean=0.5):
    """The part of a hypothesis with a track each that what is told is made of: heading known to 0.1, all 2 m apart."""
    n = len(vehicles)
    jacobian = np.zeros((2, n, 2, THETA))
    jacobian[..., 0, YAW], jacobian[..., 0, EAST] = 2.0 * np.arange(n), 1.0
    std = np.zeros(THETA)
    std[[YAW, EAST]] = 0.1, 5.0
    final = replace(initial_state(n, 3), mean=np.full((n, 3, 2), mean), var=np.full((n, 3), 0.2))
    blocks = SimpleNamespace(count=np.ones((2, n, 3)), jacobian=jacobian)
    return SimpleNamespace(vehicle=np.array(vehicles), final=final, blocks=blocks, theta_std=std)


def test_what_is_told_is_as_uncertain_as_the_camera_moves_one_more_than_others():
    shared = SharedBiases(3)
    shared.learn(4.0, np.array([0, 1]), best(1, 2))
    own = shared.told(IDS, ORIGIN_US)
    assert (own.system_id.tolist(), own.t_us.tolist()) == ([12, 13], [ORIGIN_US + 4_000_000] * 2)
    assert np.all(own.mean == 0.5)
    assert own.var == pytest.approx([0.2 + 0.5 * (1.0 * 0.1) ** 2] * 2)
    shared.forget(())
    assert len(shared.told(IDS, ORIGIN_US).system_id) == 2
    shared.forget((0, 1))
    assert shared.told(IDS, ORIGIN_US).system_id.tolist() == [13]
    shared.learn(5.0, np.zeros(0, np.int64), best(1))
    shared.forget()
    assert not len(shared.told(IDS, ORIGIN_US).system_id)


def test_whom_a_view_knows_itself_goes_on_by_its_own_evidence():
    shared = heard(told())
    shared.learn(4.0, np.array([0]), best(1))
    for t, is_told in ((0.0, False), (4.0, False), (4.0 + TAU, True)):
        assert shared.better_of(np.array([t]), *unknown(), STD, TAU)[2].any() == is_told


def test_cameras_that_are_off_by_different_ways_are_compared_by_whom_both_know():
    """The other camera has all 2 m further east; one that both know tells so, one that only this one knows does not."""
    both = told(
        system_id=IDS[:2], t_us=np.full(2, ORIGIN_US), mean=np.array([[2.5, 0.5], [1.0, -2.0]]), var=np.full(2, 0.1)
    )
    for known, shift, shift_var in ((0, 2.0, 0.1 + 0.2), (2, 0.0, np.inf)):
        shared = heard(both)
        shared.learn(0.0, np.array([0]), best(known))
        assert shared.placed(CAMERA, 1.0) is CAMERA
        mean, var, better = shared.better_of(np.zeros(1), *unknown(), STD, TAU)
        assert better[0, 1] == np.isfinite(shift_var)
        if better[0, 1]:
            trust = 4.66 / (4.66 + shift_var)
            assert mean[0, 1] == pytest.approx([1.0 - trust * shift, -2.0])
            assert var[0, 1] == pytest.approx(0.1 + trust * shift_var)


def test_who_knows_nobody_takes_the_others_place_for_its_own():
    assert SharedBiases(3).placed(CAMERA, 1.0) is CAMERA
    for own_m in (np.nan, 1.0):
        placed = heard(told()).placed(replace(CAMERA, position_std_m=own_m), 1.0)
        assert placed.position_std_m == pytest.approx(np.sqrt(1.0 + 2.33))


def test_of_several_views_who_knows_best_counts():
    both = LearntBiases.best_of(
        [told(), told(var=np.array([0.05]), mean=np.array([[1.1, -2.1]])), told(system_id=IDS[:1])]
    )
    assert both.system_id.tolist() == [11, 12]
    assert both.var.tolist() == [0.1, 0.05]
