import math

from gcs.space import SpaceForecast

GB, MB = 1_000_000_000, 1_000_000


def told(forecast, start_s, seconds, free, rate, others=0):
    """Write at a rate for some seconds; levels and texts of what was told, and what is free at the end."""
    found = []
    for k in range(seconds):
        free -= rate + others
        now_s = start_s + k
        found += forecast.update(now_s, 0, free, rate * round(now_s))
    return [(event.level, event.text) for event in found], free


def test_minutes_left_at_the_measured_rate():
    forecast = SpaceForecast()
    assert told(forecast, 0, 120, 10 * GB, 2 * MB)[0] == []
    assert math.isclose(forecast.minutes_left, (10 * GB - 240 * MB) / (2 * MB) / 60)


def test_warning_then_alarm_then_room_again():
    forecast = SpaceForecast()
    first, free = told(forecast, 0, 1000, 3 * GB, 2 * MB)
    assert [level for level, _ in first] == ["warning"]
    assert first[0][1] == "disk is filling up: 1,198 MB free, 10.0 min at 2.0 MB/s"
    second, free = told(forecast, 1000, 400, free, 2 * MB)
    assert [level for level, _ in second] == ["alarm"]
    third, _ = told(forecast, 1400, 5, free + 40 * GB, 2 * MB)
    assert [level for level, _ in third] == ["info"]


def test_little_room_is_an_alarm_without_any_growth():
    forecast = SpaceForecast()
    (event,) = forecast.update(0.0, 7, 150 * MB, 0)
    assert (event.level, event.text, event.t_us) == ("alarm", "disk is filling up: 150 MB free", 7)
    assert math.isinf(forecast.minutes_left)


def test_what_others_write_counts():
    forecast = SpaceForecast()
    told(forecast, 0, 60, 10 * GB, 1 * MB, others=9 * MB)
    assert math.isclose(forecast.minutes_left, (10 * GB - 600 * MB) / (10 * MB) / 60)


def test_no_flicker_at_the_edge():
    forecast = SpaceForecast()
    assert len(forecast.update(0.0, 0, 199 * MB, 0)) == 1
    assert forecast.update(1.0, 0, 201 * MB, 0) == ()
    assert forecast.update(2.0, 0, 199 * MB, 0) == ()
    assert len(forecast.update(90.0, 0, 900 * MB, 0)) == 1
