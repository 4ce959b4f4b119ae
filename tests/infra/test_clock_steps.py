import numpy as np

from infra.clock_steps import level_steps, restarts, set_back


def test_only_what_the_next_times_agree_about_is_a_restart():
    times = np.arange(0, 40_000, 500)
    assert restarts(times, 1000) == []
    late = times.copy()
    late[20] -= 9000
    late[50] += 90_000
    assert restarts(late, 1000) == []
    assert restarts(np.concatenate([times, times]), 1000) == [80]
    assert restarts(np.concatenate([times, times - 3_600_000]), 1000) == [80]
    assert restarts(np.concatenate([times, times[-1] - 600 + times]), 1000) == []


def test_a_clock_that_was_set_and_not_one_that_is_late():
    offsets = np.zeros(400, np.int64)
    offsets[100] = 5000
    offsets[200:] = -3000
    assert level_steps(offsets, 2000, 20) == [(200, -3000)]
    assert level_steps(offsets[:0], 2000, 20) == []


def test_a_clock_that_was_set_after_thousands_of_late_packets():
    rng = np.random.default_rng(1)
    late = rng.exponential(20_000.0, 40_000) + np.where(rng.random(40_000) < 0.02, rng.uniform(1e5, 6e5, 40_000), 0.0)
    offsets = np.rint(late).astype(np.int64)
    offsets[32_000:] += 5_000_000
    assert np.count_nonzero(np.abs(np.diff(offsets)) > 80_000) > 1_000
    ((row, by),) = level_steps(offsets, 80_000, 200, late=True)
    assert row == 32_000 and abs(by - 5_000_000) < 10_000


def test_a_clock_that_was_set_back_by_less_than_a_step_and_not_times_in_any_order():
    times = np.arange(0, 40_000_000, 500_000)
    assert set_back(times) == []
    for by in (600_000, 1_700_000):
        assert set_back(times - by * (times >= 20_000_000)) == [40]
    late = np.insert(np.delete(times, 20), 24, times[20])
    assert set_back(late) == []
    assert set_back(times.reshape(-1, 4)[:, ::-1].ravel()) == []
    assert set_back(times[:0]) == []


def test_what_arrives_late_moves_no_level():
    late = np.random.default_rng(1).integers(0, 300, 400)
    late[100:150] += 5000
    late[300:302] -= 5000
    assert level_steps(late, 2000, 100, late=True) == []
    ((row, by),) = level_steps(late - 3000 * (np.arange(400) >= 200), 2000, 100, late=True)
    assert row == 200 and abs(by + 3000) < 30
