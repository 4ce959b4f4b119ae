"""Steps of the UAV's reported position: taken out while names are sure, and put back when they are not."""

import numpy as np
import pytest

from gcs.fold.camera.position_steps import StepFilter

S = 1_000_000
V = np.array([15.0, 0.0, 0.0])


def fly(camera, start_s, stop_s, offset=(0.0, 0.0), *, sure=True, step_s=0.1, noise_m=0.0, turn=0.0):
    """Straight east at 15 m/s, reported this far off; what was told to begin anew."""
    rng, told = np.random.default_rng(1), []
    for t_s in np.arange(start_s, stop_s, step_s):
        p = V * t_s + np.array([*offset, 40.0]) + np.array([*rng.normal(0.0, noise_m, 2), 0.0])
        p[1] += 0.5 * turn * t_s * t_s
        told.append(camera.update(round(t_s * S), p, V + np.array([0.0, turn * t_s, 0.0]), sure=sure))
    return [size_m for size_m in told if size_m]


@pytest.mark.parametrize("offset", [(15.0, 0.0), (0.0, -55.0), (700.0, 700.0)])
def test_a_glitch_and_its_end_leave_the_camera_where_it_was(offset):
    camera = StepFilter()
    assert fly(camera, 0.0, 5.0) == fly(camera, 5.0, 12.0, offset) == []
    assert camera.shift_enu[:2] == pytest.approx(-np.array(offset), abs=0.01)
    assert fly(camera, 12.0, 15.0) == [] and np.abs(camera.shift_enu).max() < 0.01


def test_where_names_are_not_sure_they_begin_anew_at_the_new_place():
    camera = StepFilter()
    fly(camera, 0.0, 5.0, sure=False)
    assert fly(camera, 5.0, 6.0, (30.0, 0.0), sure=False) == [pytest.approx(30.0)]
    assert not camera.shift_enu.any()


def test_a_place_with_which_names_are_not_sure_again_was_the_wrong_one():
    camera = StepFilter()
    fly(camera, 0.0, 5.0)
    assert fly(camera, 5.0, 6.0, (30.0, 0.0)) == []
    assert fly(camera, 6.0, 20.0, (30.0, 0.0), sure=False) == [pytest.approx(30.0)]
    assert not camera.shift_enu.any()


@pytest.mark.parametrize("options", [{"noise_m": 0.8}, {"turn": 8.0}, {"step_s": 0.5}, {"step_s": 2.0}])
def test_flying_makes_no_steps(options):
    camera = StepFilter()
    assert fly(camera, 0.0, 30.0, **options) == [] and not camera.shift_enu.any()


def test_a_step_spread_over_frames_is_one():
    camera = StepFilter()
    fly(camera, 0.0, 5.0)
    for k, part in enumerate((4.0, 9.0, 15.0)):
        fly(camera, 5.0 + 0.1 * k, 5.05 + 0.1 * k, (part, 0.0))
    fly(camera, 5.3, 7.0, (15.0, 0.0))
    assert camera.shift_enu[0] == pytest.approx(-15.0, abs=0.1)


def test_what_is_not_known_or_long_ago_tells_nothing():
    camera = StepFilter()
    fly(camera, 0.0, 2.0)
    assert camera.update(2 * S, np.full(3, np.nan), V, sure=True) == 0.0
    assert fly(camera, 10.0, 12.0, (300.0, 0.0)) == [] and not camera.shift_enu.any()


def test_after_a_hole_nobody_knows_whether_it_has_stepped_back():
    camera = StepFilter()
    fly(camera, 0.0, 5.0)
    assert fly(camera, 5.0, 6.0, (30.0, 0.0)) == []
    assert fly(camera, 9.0, 12.0) == [pytest.approx(30.0)]
    assert not camera.shift_enu.any()
