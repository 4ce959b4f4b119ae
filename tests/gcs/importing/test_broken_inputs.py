"""A good drive, broken in one way, in every format: read as if whole, or left out and counted, or told, or refused."""

import math
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
WITHIN_US = 5000
DATED = tuple(f"rover.{suffix}" for suffix in ("csv", "gpx", "kml", "nmea", "bin", "log", "ulg", "tlog"))
"""Positions are on the clock of the date; of the others on that of the film."""
FILM_TIMES_ARE_ITS_OWN = "messages"
"""Their times are those of the pictures: a film whose time stamps begin again is refused."""
CUT_AT_STARTS = ("rover.bin", "rover.log")
"""A start of the vehicle is where the log is to be cut."""
OWN_CLOCK = (*CUT_AT_STARTS, "rover.ulg")
"""Times are by the vehicle's own clock, and the date beside it."""
SMOOTHED = ("film.srt", "siyi")
WITH_BODY = tuple(name for name in READERS if name not in ("rover.gpx", "rover.kml", "rover.nmea", *SMOOTHED))
WITH_HEIGHT = ("rover.csv", "elapsed.csv", "rover.bin", "rover.log", "rover.tlog", "film.srt", "messages")
ALL_TIMES = [name for name in READERS if name != FILM_TIMES_ARE_ITS_OWN]
CLOCKS = ("t_us", "film_us", "boot_us")
TWO_CLOCKS = [
    name for name in READERS if name not in ("rover.csv", "elapsed.csv", "rover.gpx", "rover.kml", "rover.nmea")
]
"""In these a date stands beside another clock."""
rows = st.integers(16, N - 16)
few = settings(max_examples=2, phases=[Phase.generate])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("broken")


def samples(values, line):
    return (values - line[0]) / line[1]


def unix_us(log, t_us):
    return t_us + (0 if log.clock == "utc" else log.zero_us or T0_US)


def sampled(log):
    """Samples as places and headings tell them, and their times, µs of the date."""
    places, found = log.places, []
    # cells of 3 m do not tell
    k = samples(places.alt_m, ALT_M) if "SIYI" in log.notes.found[0] else samples(places.lat_deg, LAT)
    found.append((k, places.t_us))
    for track in (log.attitudes, log.gimbal):
        if len(track) and track.yaw_from == "north":
            yaw = np.degrees(np.unwrap(track.angles[:, 2]))
            yaw0 = YAW_DEG[0] - (26.6 if track is log.gimbal and log.notes.found[0].startswith("KLV") else 0.0)
            found.append((samples(yaw - 360.0 * np.round((yaw[0] - yaw0) / 360.0), (yaw0, YAW_DEG[1])), track.t_us))
    return [dict(zip(np.rint(k).tolist(), unix_us(log, t_us).tolist(), strict=True)) for k, t_us in found]


def off_deg(angles, others):
    return np.nanmax(np.abs((np.degrees(angles - others) + 180.0) % 360.0 - 180.0), initial=0.0)


def errors(log):
    """By how much places, altitudes and headings are off from those that the drive had at their times."""
    places = log.places
    k = (unix_us(log, places.t_us) - T0_US) / STEP_US

    def off(values, line):
        return np.nanmax(np.abs(values - line[0] - line[1] * k), initial=0.0)

    return {
        "north": off(places.lat_deg, LAT) * 111_320.0,
        "east": off(places.lon_deg, LON) * 75_800.0,
        "up": off(places.alt_m, ALT_M),
        "height": off(places.height_m, HEIGHT_M),
        "heading": off_deg(places.heading, np.radians(YAW_DEG[0] + YAW_DEG[1] * k)),
    }


def turned_deg(log, whole):
    """Differences of body and gimbal angles from those of the unbroken drive at their times."""
    worst = 0.0
    for track, then in ((log.attitudes, whole.attitudes), (log.gimbal, whole.gimbal)):
        at, known = unix_us(log, track.t_us) - T0_US, unix_us(whole, then.t_us) - T0_US
        for axis in range(3 * bool(len(then))):
            wanted = np.interp(at, known, np.unwrap(then.angles[:, axis]))
            worst = max(worst, off_deg(track.angles[:, axis], wanted))
    return worst


@pytest.fixture(scope="module")
def whole(folder):
    return lru_cache(lambda name: read_as(name, Straight(), folder))


def is_right(log, whole):
    """Within what rounding makes of the unbroken drive, and at its times."""
    before, after = errors(whole), errors(log)
    # the smoothest path through cells of 3 m
    within_m = 1.0 if "SIYI" in log.notes.found[0] else WITHIN_M
    in_time = all(
        abs(t_us - then.get(k, t_us)) <= WITHIN_US
        for found, then in zip(sampled(log), sampled(whole), strict=True)
        for k, t_us in found.items()
    )
    close = all(after[what] <= before[what] + (WITHIN_DEG if what == "heading" else within_m) for what in after)
    return in_time and close and turned_deg(log, whole) <= WITHIN_DEG


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


@pytest.mark.slow_but_first
@pytest.mark.parametrize("name", READERS)
def test_whole(name, whole):
    log = whole(name)
    # cells of 3 m, and sets that round heights to 0.3 m
    assert is_right(log, log) and len(log.places) == N and not log.notes.skipped
    assert max(errors(log).values()) < (0.5 if name in ("siyi", "klv") else 0.05)


@pytest.mark.slow_but_first
@pytest.mark.parametrize("name", ALL_TIMES)
@given(row=st.integers(9, N - 9))
@few
def test_all_clocks_begin_again(name, row, folder, whole):
    drive = Straight()
    for clock in (drive.t_us, drive.film_us, drive.boot_us):
        clock[row:] -= row * STEP_US
    if name == "film.srt" and row > N // 2:
        return  # blocks of subtitles may stand in any order, where they do not lie over each other
    with pytest.raises(ImportFileError, match=r"(again: |started again at )(line|byte|subtitle|\d+\.\d s of)"):
        read_as(name, drive, folder)


@pytest.mark.slow_but_first
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
    if (name, unit) == ("film.srt", "cdeg"):
        return  # written within a turn
    drive, (columns, factor) = Straight(), IN_ANOTHER_UNIT[unit]
    for column in columns:
        setattr(drive, column, getattr(drive, column) * factor)
    assert_not_silent(name, drive, folder, whole)


@pytest.mark.slow_but_first
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


@pytest.mark.slow_but_first
@pytest.mark.parametrize("name", ALL_TIMES)
@given(row=rows, later=st.integers(2, 8))
@few
def test_one_row_comes_late(name, row, later, folder, whole):
    drive = Straight()
    drive.order = np.insert(np.delete(np.arange(N), row), row + later, row)
    if name in CUT_AT_STARTS and later * STEP_US >= 1_000_000:
        return
    log = read_as(name, drive, folder)
    assert is_right(log, whole(name)) and len(log.places) == N


def clocks(*names):
    """Clocks that are set in the middle, by less than a gap is long."""

    def broken(drive, row, by_s):
        for name in names:
            getattr(drive, name)[row:] += round(by_s * 1e6)

    return broken


def running(*names):
    """Clocks that run 0.5 to 2 % faster or slower."""

    def broken(drive, _row, by_s):
        for name in names:
            clock = getattr(drive, name)
            clock[:] = clock[0] + np.rint(
                (clock - clock[0]) * (1.0 + np.sign(by_s) * (0.003 + 0.013 * abs(by_s)))
            ).astype(np.int64)

    return broken


def whole_seconds(*names):
    def broken(drive, _row, _by_s):
        for name in names:
            getattr(drive, name)[:] -= getattr(drive, name) % 1_000_000

    return broken


def ordered(rows_of):
    def broken(drive, row, _by_s):
        drive.order = rows_of(row)

    return broken


def one_time(drive, _row, _by_s):
    for name in CLOCKS:
        getattr(drive, name)[:] = getattr(drive, name)[0]


def weeks_begin_again(drive, row, by_s):
    drive.t_us[: row if by_s < 0.0 else N] -= 1024 * 7 * 86_400_000_000


def further(factor, broken):
    return lambda drive, row, by_s: broken(drive, row, factor * by_s)


def by_sign(amount_s, broken):
    return lambda drive, row, by_s: broken(drive, row, math.copysign(amount_s, by_s))


def in_any_order(row):
    return np.arange(N).reshape(-1, 4)[:, np.random.default_rng(row).permutation(4)].ravel()


IN_FILM = ("elapsed.csv", "film.srt", "klv", "messages")
UNKNOWN = "siyi"
"""Its whole seconds and cells of 3 m do not tell so little."""
WAYS = {
    "the date is set by a little": (clocks("t_us"), READERS),
    "the film's clock is set by a little": (clocks("film_us"), IN_FILM),
    "the vehicle's clock is set by a little": (clocks("boot_us"), (*OWN_CLOCK, "rover.tlog")),
    "all clocks are set by a little": (clocks(*CLOCKS), [name for name in READERS if name != UNKNOWN]),
    "the date is set": (further(3000.0, clocks("t_us")), READERS),
    "the date is set by leap seconds": (by_sign(18.0, clocks("t_us")), READERS),
    "the date is set by a day": (by_sign(86_400.0, clocks("t_us")), READERS),
    "the film's clock is set": (
        lambda drive, row, by_s: clocks("film_us")(drive, row, abs(3000.0 * by_s)),
        (*IN_FILM, UNKNOWN),
    ),
    "the date runs otherwise": (running("t_us"), [name for name in TWO_CLOCKS if name != UNKNOWN]),
    "the film's clock runs otherwise": (running("film_us"), IN_FILM[1:]),
    "whole seconds": (whole_seconds(*CLOCKS), READERS),
    "dates of whole seconds": (whole_seconds("t_us"), READERS),
    "all have one time": (one_time, READERS),
    "weeks begin again": (weeks_begin_again, READERS),
    "all is there twice": (ordered(lambda _: np.r_[np.arange(N), np.arange(N)]), READERS),
    "the last third is there twice": (ordered(lambda _: np.r_[np.arange(N), np.arange(N - N // 3, N)]), READERS),
    "a few are there twice": (ordered(lambda row: np.r_[np.arange(row), np.arange(row - 3, N)]), READERS),
    "in any order": (ordered(in_any_order), READERS),
    "the last come first": (ordered(lambda _: np.arange(N)[::-1]), READERS),
}
"""Ways to break times, by a row and by seconds, and the readers in which they can be."""
WAYS_OF_READERS = [
    pytest.param(way, name, marks=[pytest.mark.slow] * (name != readers[k % len(readers)]))
    for k, (way, (_, readers)) in enumerate(WAYS.items())
    for name in readers
]
"""Every way with each of its readers; one reader a way, another for each, is in the quick tests."""


@pytest.mark.slow_but_first
@pytest.mark.parametrize(("way", "name"), WAYS_OF_READERS)
@given(row=rows, by_s=st.floats(0.12, 1.3), back=st.booleans())
@few
def test_times_are_not_what_they_seem(way, name, row, by_s, back, folder, whole):
    drive = Straight()
    # a film whose own time stamps go back is refused as such
    WAYS[way][0](drive, row, -by_s if back and name != FILM_TIMES_ARE_ITS_OWN else by_s)
    assert_not_silent(name, drive, folder, whole)
