import numpy as np

from infra.clock_steps import level_steps, restarts


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
