"""A good drive, broken in one way, in every format: read as if whole, or left out and counted, or told, or refused."""

import re
from functools import lru_cache

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from gcs.errors import ImportFileError
from tests.support.imports.straight import (
    ALT_M,
    FILES,
    HEIGHT_M,
    LAT,
    LON,
    READERS,
    STEP_US,
    T0_US,
    YAW_DEG,
    N,
    Straight,
    read_as,
    read_written,
)

WITHIN_M, WITHIN_DEG = 0.05, 0.5
DATED = tuple(f"rover.{suffix}" for suffix in ("csv", "gpx", "kml", "nmea", "bin", "log", "ulg", "tlog"))
"""Positions are on the clock of the date; of the others on that of the film."""
FILM_TIMES_ARE_ITS_OWN = "messages"
"""Their times are those of the pictures: a film whose time stamps begin again is refused."""
WRITTEN_BY_TIME = ("rover.bin", "rover.log", "rover.ulg")
"""Their times are broken in tests of their own."""
SMOOTHED = ("film.srt", "siyi")
WITH_BODY = tuple(name for name in READERS if name not in ("rover.gpx", "rover.kml", "rover.nmea", *SMOOTHED))
WITH_HEIGHT = ("rover.csv", "elapsed.csv", "rover.bin", "rover.log", "rover.tlog", "film.srt", "messages")
ALL_TIMES = [name for name in READERS if name not in (*WRITTEN_BY_TIME, FILM_TIMES_ARE_ITS_OWN)]
rows = st.integers(12, N - 12)
few = settings(max_examples=2, phases=[Phase.generate])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("broken")


def errors(log):
    """By how much places, altitudes and headings are off from those that the drive had at their times."""

    def samples(t_us):
        zero_us = 0 if log.clock == "utc" else log.zero_us or T0_US
        return (t_us + zero_us - T0_US) / STEP_US

    def off(values, line, k):
        return np.nanmax(np.abs(values - line[0] - line[1] * k), initial=0.0)

    places, at = log.places, samples(log.places.t_us)
    yaw = np.degrees(log.attitudes.angles[:, 2]) - YAW_DEG[0] - YAW_DEG[1] * samples(log.attitudes.t_us)
    return {
        "north": off(places.lat_deg, LAT, at) * 111_320.0,
        "east": off(places.lon_deg, LON, at) * 75_800.0,
        "up": off(places.alt_m, ALT_M, at),
        "height": off(places.height_m, HEIGHT_M, at),
        "heading": np.abs((yaw + 180.0) % 360.0 - 180.0).max(initial=0.0),
    }


@pytest.fixture(scope="module")
def whole(folder):
    return lru_cache(lambda name: read_as(name, Straight(), folder))


def is_right(log, whole):
    """Within what rounding makes of the unbroken drive."""
    before, after = errors(whole), errors(log)
    # the smoothest path through cells of 3 m
    within_m = 1.0 if log.notes.found[0].startswith("SIYI") else WITHIN_M
    return all(after[what] <= before[what] + (WITHIN_DEG if what == "heading" else within_m) for what in after)


def words(log, whole):
    """What is told or counted, and was not of the unbroken drive."""
    return [*(said for said in log.notes.assumed if said not in whole.notes.assumed), *log.notes.skipped]


def assert_counted_and_right(log, whole, least=N - 1):
    assert words(log, whole)
    assert is_right(log, whole), errors(log)
    assert len(log.places) >= least


def assert_not_silent(name, drive, folder, whole):
    """Right, or told, or refused."""
    try:
        log = read_as(name, drive, folder)
    except ImportFileError as error:
        assert "\n" not in str(error)
        return
    assert words(log, whole(name)) or is_right(log, whole(name)), errors(log)


@pytest.mark.parametrize("name", READERS)
def test_whole(name, whole):
    log = whole(name)
    # cells of 3 m, and sets that round heights to 0.3 m
    assert is_right(log, log) and len(log.places) == N and not log.notes.skipped
    assert max(errors(log).values()) < (0.5 if name in ("siyi", "klv") else 0.05)


@pytest.mark.parametrize("name", ALL_TIMES)
@given(row=st.integers(9, N - 9))
@few
def test_all_clocks_begin_again(name, row, folder, whole):
    drive = Straight()
    for clock in (drive.t_us, drive.film_us, drive.boot_us):
        clock[row:] -= row * STEP_US
    if name == "film.srt" and row > N // 2:
        return  # blocks of subtitles may stand in any order, where they do not lie over each other
    with pytest.raises(ImportFileError, match=r"begin again|started again|not lie over"):
        read_as(name, drive, folder)


@pytest.mark.parametrize("name", [name for name in READERS if name not in WRITTEN_BY_TIME])
@given(row=st.integers(12, N - 12), by_s=st.floats(-4000.0, 4000.0).filter(lambda s: abs(s) > 1.3))
@few
def test_the_date_is_set(name, row, by_s, folder, whole):
    drive = Straight()
    drive.t_us[row:] += round(by_s * 1e6)
    assert_not_silent(name, drive, folder, whole)


@pytest.mark.parametrize("name", [name for name in READERS if name not in (*DATED, FILM_TIMES_ARE_ITS_OWN)])
@given(row=st.integers(12, N - 12), by_s=st.floats(1.3, 4000.0))
@few
def test_the_films_clock_leaps(name, row, by_s, folder, whole):
    drive = Straight()
    drive.film_us[row:] += round(by_s * 1e6)
    assert_not_silent(name, drive, folder, whole)


@pytest.mark.parametrize("name", ALL_TIMES)
@given(row=rows, by_s=st.floats(-3600.0, 3600.0).filter(lambda s: abs(s) > 20.0))
@few
def test_one_time_is_damaged(name, row, by_s, folder, whole):
    drive = Straight()
    for clock in (drive.t_us, drive.film_us, drive.boot_us):
        clock[row] = max(clock[row] + round(by_s * 1e6), clock[0] if clock is not drive.t_us else 0)
    log = read_as(name, drive, folder)
    assert words(log, whole(name))
    # a time behind all others leaves a gap, which is told
    assert is_right(log, whole(name)) or any("nothing was logged" in said for said in log.notes.assumed), errors(log)


@pytest.mark.slow_but_first
@pytest.mark.parametrize("name", READERS)
@given(row=rows, north=st.floats(0.001, 30.0), east=st.booleans(), count=st.integers(1, 4))
@few
def test_places_are_damaged(name, row, north, east, count, folder, whole):
    drive = Straight()
    (drive.lon if east else drive.lat)[row : row + count] += 1.5 * north if east else north
    assert_counted_and_right(read_as(name, drive, folder), whole(name), N - count)


@pytest.mark.slow_but_first
@pytest.mark.parametrize("name", READERS)
@given(row=rows)
@few
def test_one_place_is_none(name, row, folder, whole):
    drive = Straight()
    drive.lat[row] = drive.lon[row] = 0.0
    log = read_as(name, drive, folder)
    assert is_right(log, whole(name)) and len(log.places) == N - 1


@pytest.mark.slow_but_first
@pytest.mark.parametrize("name", READERS)
@given(row=rows, beside=st.booleans())
@few
def test_latitude_and_longitude_of_one_change_over(name, row, beside, folder, whole):
    drive = Straight()
    drive.lat[row], drive.lon[row] = drive.lon[row], drive.lat[row]
    drive.lat[row + 1] += beside * 1e-3
    assert_counted_and_right(read_as(name, drive, folder), whole(name), N - 1 - beside)


@pytest.mark.slow_but_first
@pytest.mark.parametrize("name", READERS)
@given(row=rows, alt_m=st.sampled_from([0.0, -500.0, 6000.0]), count=st.integers(1, 4))
@few
def test_altitudes_are_damaged(name, row, alt_m, count, folder, whole):
    drive = Straight()
    drive.alt_m[row : row + count] = alt_m
    assert_counted_and_right(read_as(name, drive, folder), whole(name))


@pytest.mark.slow_but_first
@pytest.mark.parametrize("name", WITH_BODY)
@given(row=rows, by_deg=st.floats(60.0, 180.0))
@few
def test_one_heading_is_damaged(name, row, by_deg, folder, whole):
    drive = Straight()
    drive.yaw_deg[row] += by_deg
    assert_counted_and_right(read_as(name, drive, folder), whole(name))


@pytest.mark.parametrize("name", WITH_HEIGHT)
@given(upto=st.integers(5, N // 3))
@few
def test_heights_of_0_before_home_is_set(name, upto, folder, whole):
    drive = Straight()
    drive.height_m[:upto] = 0.0
    log = read_as(name, drive, folder)
    assert is_right(log, whole(name)) and len(log.places) == N


@pytest.mark.slow_but_first
@pytest.mark.parametrize("name", READERS)
@given(upto=st.integers(5, N // 3))
@few
def test_altitudes_of_0_before_the_fix(name, upto, folder, whole):
    drive = Straight()
    drive.alt_m[:upto] = 0.0
    assert_not_silent(name, drive, folder, whole)


IN_ANOTHER_UNIT = {
    "1e7": (("lat", "lon"), 1e7),
    "rad": (("lat", "lon"), np.pi / 180.0),
    "mm": (("alt_m", "height_m"), 1e3),
    "cm": (("alt_m", "height_m"), 1e2),
    "cdeg": (("yaw_deg",), 1e2),
}
AS_TEXT = ("rover.csv", "elapsed.csv", "rover.gpx", "rover.kml", "film.srt")
"""Other formats have no room for numbers in another unit."""


@pytest.mark.parametrize("name", AS_TEXT)
@pytest.mark.parametrize("unit", IN_ANOTHER_UNIT)
def test_another_unit(name, unit, folder, whole):
    drive, (columns, factor) = Straight(), IN_ANOTHER_UNIT[unit]
    for column in columns:
        setattr(drive, column, getattr(drive, column) * factor)
    assert_not_silent(name, drive, folder, whole)


@pytest.mark.parametrize("name", [name for name in FILES if name not in ("rover.bin", "rover.ulg", "rover.tlog")])
@pytest.mark.parametrize("strange", ["4_7.100096", "٤٧.100096", "infinity", "47.1x"])
def test_what_is_no_number_costs_its_row(name, strange, folder, whole):
    # degrees and minutes of the 25th row
    text, found = re.subn(r"\b47(06\.00576|\.100096)0*\b", strange, FILES[name](Straight()))
    log = read_written(name, text, folder)
    assert found and is_right(log, whole(name)) and len(log.places) == N - 1 and log.notes.skipped


@pytest.mark.slow_but_first
@pytest.mark.parametrize("name", READERS)
def test_radians(name, folder, whole):
    drive = Straight()
    drive.lat, drive.lon = np.radians(drive.lat), np.radians(drive.lon)
    assert_not_silent(name, drive, folder, whole)


@pytest.mark.slow_but_first
@pytest.mark.parametrize("name", READERS)
@pytest.mark.parametrize("later_us", [0, 40_000])
def test_rows_of_another_component(name, later_us, folder, whole):
    drive = Straight()
    drive.mix_in(3, 1e-3, later_us)
    assert_not_silent(name, drive, folder, whole)


@pytest.mark.parametrize("name", ALL_TIMES)
@given(row=rows, later=st.integers(2, 8))
@few
def test_one_row_comes_late(name, row, later, folder, whole):
    drive = Straight()
    drive.order = np.insert(np.delete(np.arange(N), row), row + later, row)
    log = read_as(name, drive, folder)
    assert is_right(log, whole(name)) and len(log.places) == N


@pytest.mark.parametrize("name", [name for name in READERS if name not in WRITTEN_BY_TIME])
def test_the_last_come_first(name, folder, whole):
    drive = Straight()
    drive.order = np.arange(N)[::-1]
    assert_not_silent(name, drive, folder, whole)


@pytest.mark.parametrize("name", [name for name in READERS if name not in WRITTEN_BY_TIME])
def test_whole_seconds(name, folder, whole):
    drive = Straight()
    for clock in (drive.t_us, drive.film_us):
        clock -= clock % 1_000_000
    assert_not_silent(name, drive, folder, whole)


@pytest.mark.parametrize("name", READERS)
def test_all_have_one_time(name, folder, whole):
    drive = Straight()
    for clock in (drive.t_us, drive.film_us, drive.boot_us):
        clock[:] = clock[0]
    assert_not_silent(name, drive, folder, whole)
