"""A good drive with numbers of another vehicle, unit or frame, in every format: told, or left out, or refused."""

import re
from dataclasses import replace

import numpy as np
import pytest

from gcs.errors import ImportFileError
from gcs.importing.checks.one_path import several_paths
from gcs.importing.checks.plausible import metres
from gcs.importing.checks.side_by_side import above_fleet, fleet_words, height_words, uav_words
from gcs.importing.checks.steps import stays
from gcs.importing.ground_vehicles import GroundVehicles
from tests.support.imports.straight import READERS, N, Straight, read_as

APART_DEG = {"4 m": 3.6e-5, "8 m": 7.2e-5, "14 m": 12.6e-5}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("numbers")


def said_of(name, drive, folder):
    """Words of a reader about a drive, refused or not."""
    try:
        notes = read_as(name, drive, folder).notes
    except ImportFileError as error:
        return str(error)
    return "; ".join((*notes.assumed, *notes.skipped))


def by_turns(drive, turns, north_deg):
    """Positions of so many vehicles, one beside the other."""
    drive.lat = drive.lat + north_deg * turns
    return drive


@pytest.mark.slow_but_first
@pytest.mark.parametrize("name", READERS)
@pytest.mark.parametrize("apart", APART_DEG)
@pytest.mark.parametrize("count", [2, 3, 5])
def test_vehicles_that_take_turns(name, apart, count, folder):
    if name == "siyi" and apart == "4 m":
        return  # two cells of its coordinates
    drive = by_turns(Straight(), np.arange(N) % count, APART_DEG[apart])
    assert re.search(r"leap \d+\.\d m to and fro, as at .*\d.*: two vehicles", said_of(name, drive, folder))


@pytest.mark.slow_but_first
@pytest.mark.parametrize("name", READERS)
@pytest.mark.parametrize("share", [0.1, 0.5])
def test_another_vehicle_now_and_then(name, share, folder):
    now = np.random.default_rng(5).random(N) < share
    assert "take turns in it" in said_of(name, by_turns(Straight(), now, 7.2e-5), folder)


def fleet_of(*logs):
    """Vehicles 11 and up."""
    found = dict(enumerate(logs, 11))
    return GroundVehicles(places={i: log.places for i, log in found.items()}, tlog=None, logs=found)


def said_of_flight(uav, *rovers):
    """Words of an import about a UAV above ground vehicles, refused or not."""
    fleet = fleet_of(*rovers)
    try:
        told = (*fleet_words(fleet), *(words for log in (uav, *rovers) for words in log.notes.skipped))
        uav, said = above_fleet(uav, fleet)
        return "; ".join((*said, *told, *height_words(uav.source, uav.places, fleet), *uav_words(uav)))
    except ImportFileError as error:
        return str(error)


def straight(up_m=0.0):
    """A drive whose vehicle looks where it goes, or a flight above it."""
    drive = Straight()
    drive.yaw_deg, drive.alt_m = np.full(N, COURSE_DEG), drive.alt_m + up_m
    return drive


@pytest.fixture(scope="module")
def rover(folder):
    return read_as("rover.csv", straight(), folder)


@pytest.fixture(scope="module")
def uav(folder):
    return read_as("rover.csv", straight(30.0), folder)


COURSE_DEG = 18.8
UNITS = {"cm": 100.0, "mm": 1e3, "cm called mm": 0.1, "feet": 1 / 0.3048, "metres called feet": 0.3048}
WITH_HEIGHT = ("rover.csv", "elapsed.csv", "rover.bin", "rover.log", "rover.tlog", "film.srt", "messages")
CONSTANT_SPEED = ("rover.nmea", "rover.bin", "rover.log", "rover.ulg", "rover.tlog")
"""Their writers tell one speed all the time."""
OF_UAVS = ("elapsed.csv", "film.srt", "klv", "messages", "siyi")
WITHOUT_BODY = ("rover.gpx", "rover.kml", "rover.nmea")
OF_BOTH = tuple(name for name in READERS if name not in OF_UAVS)


@pytest.mark.slow_but_first
@pytest.mark.parametrize("unit", UNITS)
@pytest.mark.parametrize("name", READERS)
def test_altitudes_in_another_unit(name, unit, folder, rover, uav):
    drive = straight(30.0)
    drive.alt_m = drive.alt_m * UNITS[unit]
    if name == "klv" and drive.alt_m.max() > 19_000.0:
        return  # which no set of it can tell
    if name.endswith("csv") and unit in ("cm", "mm"):
        assert "tell the unit in its name" in said_of(name, drive, folder)
        return
    log = read_as(name, drive, folder)
    assert re.search("another unit|took off|altitudes that cannot be", said_of_flight(log, rover))
    if name in OF_BOTH:
        assert re.search("another unit|that cannot be", said_of_flight(uav, log, rover))


@pytest.mark.slow_but_first
@pytest.mark.parametrize("name", [*OF_BOTH, "elapsed.csv", "film.srt", "messages"])
@pytest.mark.parametrize("how", ["changed over|other way round", "S, N", "W, E"])
def test_a_vehicle_on_the_other_side_of_the_earth(name, how, folder, rover, uav):
    drive = straight(30.0)
    if how == "S, N":
        drive.lat = -drive.lat
    elif how == "W, E":
        drive.lon = -drive.lon
    else:
        drive.lat, drive.lon = drive.lon, drive.lat
    log = read_as(name, drive, folder)
    assert re.search(how, said_of_flight(log, rover))
    if name in OF_BOTH:
        assert re.search(how, said_of_flight(uav, log, rover))


@pytest.mark.slow_but_first
@pytest.mark.parametrize("name", [name for name in OF_BOTH if name not in WITHOUT_BODY])
@pytest.mark.parametrize(
    ("yaw_deg", "how"),
    [
        (np.radians, "follow its course as radians"),
        (lambda yaw: yaw + 90.0, "is .90° from the course that it drives"),
        (lambda yaw: (yaw + np.linspace(0.0, 3000.0, N)) % 360.0, "does not follow the course"),
        (lambda yaw: yaw + 180.0, ""),
        (lambda yaw: yaw + 25.0, ""),
    ],
)
def test_headings_beside_the_course(name, yaw_deg, how, folder, rover, uav):
    drive = straight()
    drive.yaw_deg = yaw_deg(drive.yaw_deg)
    assert re.search(how or "^$", said_of_flight(uav, read_as(name, drive, folder)))


@pytest.mark.parametrize("name", [name for name in READERS if name not in (*WITHOUT_BODY, "film.srt", "siyi")])
def test_a_uavs_yaw_in_radians(name, folder, rover):
    """Asked of tables alone: what writes other files has one unit, and a UAV may well look north all the time."""
    drive = Straight()
    drive.yaw_deg = np.radians(drive.yaw_deg)
    said = said_of_flight(read_as(name, drive, folder), rover)
    assert bool(re.search("its yaw never exceeds 1.7.°: are these radians?", said)) == name.endswith(".csv")


@pytest.mark.parametrize("name", OF_BOTH)
def test_a_ground_vehicles_log_as_the_uavs(name, folder, rover):
    drive = straight(0.4)
    drive.height_m = 0.002 * np.arange(N)
    said = said_of_flight(read_as(name, drive, folder), rover)
    assert "it never is 3 m above its take-off or the fleet: is it a ground vehicle's log?" in said
    assert "ellipsoid" not in said


def test_one_ground_vehicle_under_two_ids(folder, rover, uav):
    drive = straight()
    drive.lat = drive.lat + 2e-6
    said = said_of_flight(uav, rover, read_as("rover.bin", drive, folder))
    assert said == "systems 11 and 12 go one way, 0.2 m apart: one vehicle under two ids?"
    drive.lat = drive.lat + 1e-5
    assert said_of_flight(uav, rover, read_as("rover.bin", drive, folder)) == ""


def test_an_aircrafts_log_as_a_ground_vehicles(folder, rover, uav):
    log = replace(read_as("rover.tlog", straight(), folder), flies=True)
    assert "its heartbeats are an aircraft's: is it the log of the UAV?" in said_of_flight(uav, rover, log)


@pytest.mark.slow_but_first
@pytest.mark.parametrize("name", READERS)
@pytest.mark.parametrize("by_m", [48.0, -48.0, 980.0])
def test_altitudes_that_count_from_elsewhere_halfway(name, by_m, folder):
    drive = straight()
    drive.alt_m = drive.alt_m + by_m * (np.arange(N) >= 77)
    assert re.search(rf"altitude steps by \{by_m:+.0f}.*another unit", said_of(name, drive, folder))


@pytest.mark.parametrize("name", WITH_HEIGHT)
def test_heights_that_count_from_elsewhere_halfway(name, folder):
    drive = straight()
    drive.height_m = drive.height_m + 98.0 * (np.arange(N) >= 77)
    assert "height steps by +98" in said_of(name, drive, folder)


def stuck(first, last):
    drive = straight()
    for column in (drive.lat, drive.lon):
        column[first:last] = column[first]
    return drive


@pytest.mark.slow_but_first
@pytest.mark.parametrize("name", [name for name in READERS if name != "siyi"])
@pytest.mark.parametrize(("first", "last"), [(60, 85), (0, 30), (120, N)])
def test_positions_that_stay_while_the_vehicle_goes_on(name, first, last, folder):
    """Told; of 3 m cells nobody knows, nor of a vehicle that may have stopped where it has no more than that."""
    log = read_as(name, stuck(first, last), folder)
    said = "positions that stay to the last digit while the vehicle goes on"
    assert log.notes.skipped[said] == last - first - 1, log.notes
    assert not np.any(np.diff(log.places.lat_deg) == 0.0)


@pytest.mark.parametrize("name", READERS)
def test_a_vehicle_that_brakes_and_stands_is_believed(name, folder):
    drive = straight()
    way = np.cumsum(np.interp(np.arange(N), [0, 60, 64, 100, 104, N], [1.0, 1.0, 0.0, 0.0, 1.0, 1.0]))
    drive.lat, drive.lon = 47.1 + 4e-6 * np.round(way, 2), 8.1 + 2e-6 * np.round(way, 2)
    if name not in CONSTANT_SPEED:
        assert "stay" not in said_of(name, drive, folder)


def test_what_is_right_is_not_told(rover, uav):
    assert said_of_flight(uav, rover) == ""


S = np.arange(240)
NOISE = np.random.default_rng(3).normal(0.0, 1.5e-5, (2, 240))
GOOD_PATHS = {
    "stands, 1.7 m of noise": (0.1, *NOISE),
    "drives, 1.7 m of noise, 1 Hz": (1.0, 2e-5 * S + NOISE[0], NOISE[1]),
    "5 Hz in a log of 10 Hz, 20 m/s": (0.1, 3.6e-5 * (S // 2), 0.0 * S),
    "circles of 8 m, 1 Hz": (1.0, 7e-5 * np.cos(0.4 * S), 1e-4 * np.sin(0.4 * S)),
    "two cells of 11 m in turn": (1.0, 1e-4 * (S % 2), 0.0 * S),
    "to and fro on 20 m, 1 Hz": (1.0, 1.8e-4 * np.abs(S % 16 - 8) / 8, 0.0 * S),
}


@pytest.mark.parametrize("name", GOOD_PATHS)
def test_a_path_of_one_vehicle_is_one(name):
    step_s, north, east = GOOD_PATHS[name]
    degrees = np.round(np.column_stack([47.1 + north, 8.1 + east]), 4 if "cells" in name else 7)
    t_us = np.rint(step_s * 1e6 * S).astype(np.int64)
    assert several_paths(t_us, degrees, str) == ""
    assert not stays(t_us, degrees, metres(degrees)).any()
