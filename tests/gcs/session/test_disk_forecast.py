import math

import pytest

from gcs.session.recorder import SpaceForecast

GB, MB = 1_000_000_000, 1_000_000


def left_s(forecast, seconds, free, rate, others=0, start_s=0):
    """What is foretold after writing at a rate for some seconds, and what is free then."""
    for now_s in range(start_s, start_s + seconds):
        free -= rate + others
        found = forecast.update(now_s, free, rate * now_s)
    return found, free


def test_time_left_at_the_measured_rate():
    found, free = left_s(SpaceForecast(), 120, 10 * GB, 2 * MB)
    assert found == pytest.approx(free / (2 * MB))


def test_another_rate_counts_after_five_minutes():
    forecast = SpaceForecast()
    _, free = left_s(forecast, 120, 10 * GB, 20 * MB)
    for now_s in range(120, 421):
        found = forecast.update(now_s, free, 20 * MB * 119)
    assert math.isinf(found), "nothing grows any more"


def test_nothing_is_foretold_from_the_first_seconds():
    assert math.isinf(left_s(SpaceForecast(), 5, 10 * GB, 2 * MB)[0])
    assert math.isfinite(left_s(SpaceForecast(), 6, 10 * GB, 2 * MB)[0])


def test_what_others_write_counts():
    found, free = left_s(SpaceForecast(), 60, 10 * GB, 1 * MB, others=9 * MB)
    assert found == pytest.approx(free / (10 * MB))
