"""When a thing is reported or tried again."""

import pytest

from infra.reporting import Backoff, Hysteresis, ReportGrowth, ReportOnce, Throttle, TokenBucket


def test_a_text_is_reported_once_and_only_so_many_are():
    once = ReportOnce(most=3)
    assert once.new(["a", "b", "a"]) == ["a", "b"]
    assert once.new(["b", "c", "d"]) == ["c"]
    assert once.new(["e"]) == []


def test_each_key_waits_for_itself_whichever_way_the_clock_goes():
    throttle = Throttle(30)
    assert [throttle.due("a", now) for now in (100, 129, 130, 131)] == [True, False, True, False]
    assert throttle.due("b", 131)
    assert [throttle.due("a", now) for now in (110, 99)] == [False, True]


@pytest.mark.parametrize(
    ("more", "counts", "reported"),
    [
        ({}, [0, 1, 1, 2, 3, 4, 7, 8, 16], [1, 2, 4, 8, 16]),
        ({"first": 3}, [1, 2, 3, 5, 6], [3, 6]),
        ({"factor": 10.0}, [1, 9, 10, 99, 100], [1, 10, 100]),
        ({}, [50, 60, 2, 3, 4], [50, 2, 4]),  # counted by a process that was started anew
    ],
)
def test_a_count_is_reported_when_it_has_grown_so_many_times(more, counts, reported):
    growth = ReportGrowth(**more)
    assert [count for count in counts if growth.due(count)] == reported


def test_growth_after_a_rest_is_as_new():
    growth = ReportGrowth(rest=20)
    times = [(0, 8), (1, 9), (10, 10), (31, 11), (32, 12), (33, 22)]
    assert [count for now, count in times if growth.due(count, now)] == [8, 11, 22]


def test_growth_is_reported_no_oftener_than_wanted():
    growth = ReportGrowth(every=30)
    assert [now for now in range(100) if growth.due(2**now, now)] == [0, 30, 60, 90]


@pytest.mark.parametrize(
    ("levels", "reported"),
    [
        ([0] * 5 + [1] * 60, [10]),  # after it has lasted
        ([1] * 4 + [0] + [1] * 5, []),  # a pause begins it anew
        ([1] * 20 + [2] * 20, [5, 20]),  # worse at once: trouble has lasted already
        ([1] * 10 + [0] * 29 + [1] * 40, [5]),  # not better for long enough
        ([1] * 10 + [0] * 31 + [1] * 40, [5, 46]),
    ],
)
def test_trouble_is_reported_when_it_lasts_and_again_when_it_was_over_for_a_while(levels, reported):
    trouble = Hysteresis(rises_after=5, falls_after=30)
    assert [now for now, level in enumerate(levels) if trouble.rises(level, now)] == reported


def test_a_burst_passes_and_then_a_steady_rate():
    bucket = TokenBucket(2.0, 20.0, 0.0)
    assert sum(bucket.allows(0.0) for _ in range(100)) == 20
    assert sum(bucket.allows(0.01 * k) for k in range(1000)) == pytest.approx(20, abs=1)
    assert not bucket.allows(-1000.0)
    assert sum(bucket.allows(1e6) for _ in range(100)) == 20


def test_trying_again_takes_longer_each_time():
    backoff = Backoff((1.0, 2.0, 4.0))
    tried = [now_s for now_s in range(20) if backoff.due(float(now_s))]
    assert tried == [0, 1, 3, 7, 11, 15, 19]
    backoff.succeeded()
    assert backoff.due(100.0) and backoff.due(101.0)
    backoff.succeeded()
    assert [backoff.failed() for _ in range(5)] == [1.0, 2.0, 4.0, 4.0, 4.0]
