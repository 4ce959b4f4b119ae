"""Dataflash logs with the troubles that users of other readers report, made of a good one."""

import mmap
import struct
from datetime import datetime

import numpy as np
import pytest

from gcs.errors import ImportFileError
from gcs.importing.formats import dataflash as reader
from gcs.importing.sources import read_vehicle_logs
from tests.support.imports.flown import fly
from tests.support.imports.log_writers import BOOT_US, GPS_EPOCH_US, WEEK_MS, dataflash, wire_places
from tests.support.imports.straight import Straight


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    return fly(tmp_path_factory.mktemp("flown"), 60)


def read(tmp_path, data):
    path = tmp_path / "rover.bin"
    path.write_bytes(data)
    (log,) = read_vehicle_logs(path)
    return log


def assert_same(log, other):
    assert log.clock == other.clock == "utc"
    assert log.places.t_us == pytest.approx(other.places.t_us, abs=5000)
    for name in ("lat_deg", "lon_deg"):
        assert getattr(log.places, name) == pytest.approx(getattr(other.places, name), abs=4e-7)
    assert log.places.v_ned == pytest.approx(other.places.v_ned, abs=0.01, nan_ok=True)


def test_a_receiver_that_never_has_a_fix_does_not_count(flown, tmp_path):
    good = read(tmp_path, dataflash(flown, 11))
    assert_same(read(tmp_path, dataflash(flown, 11, receiver=1)), good)
    without_filter = dataflash(flown, 11, receiver=1).replace(b"POS\0", b"XXX\0").replace(b"XKF1", b"YKF1")
    assert_same(read(tmp_path, without_filter), good)


def test_the_velocity_is_that_of_the_core_that_flies(flown, tmp_path):
    good = read(tmp_path, dataflash(flown, 11))
    assert_same(read(tmp_path, dataflash(flown, 11, core=1)), good)


@pytest.mark.parametrize("formats", [True, False])
def test_two_starts_in_one_file_are_refused_with_their_place(formats, flown, tmp_path):
    first, second = dataflash(flown, 11), dataflash(flown, 11, late_us=464_900_000)
    cut = 0 if formats else second.index(b"\xa3\x95\x41", 7 * 89)
    with pytest.raises(ImportFileError, match=rf"started again at byte {len(first)};"):
        read(tmp_path, first + second[cut:])


def test_a_date_that_steps_is_that_which_holds_longest(flown, tmp_path):
    good, late = dataflash(flown, 11), dataflash(flown, 11, late_us=3_600_000_000)
    third = len(good) // 3
    start = good.index(b"\xa3\x95\x41", third)
    assert len(good) == len(late)
    log = read(tmp_path, late[:start] + good[start:])
    assert_same(log, read(tmp_path, good))
    (said,) = log.notes.assumed
    assert said.startswith("GPS time steps by -3600.00 s")


@pytest.mark.parametrize(
    ("since", "leap_s"), [("2014-05-01", 16), ("2016-05-01", 17), ("2018-05-01", 18), ("2007-05-01", 18)]
)
def test_leap_seconds_are_those_of_the_day(since, leap_s, tmp_path):
    drive = Straight()
    written_us = drive.t_us - drive.t_us[0] + int(datetime.fromisoformat(f"{since}+00:00").timestamp()) * 1_000_000
    drive.t_us = written_us.copy()
    log = read(tmp_path, dataflash(drive, 11))  # which is written with 18
    assert (log.places.t_us - written_us == (18 - leap_s) * 1_000_000).all()
    assert f"GPS time less {leap_s} s" in log.dated


class NoFind(mmap.mmap):
    def find(self, *_):
        raise AssertionError("mmap.find reads past a map of whole pages before CPython 3.11.5")

    rfind = find


@pytest.mark.parametrize("damage", [0, 3, 5000])
def test_a_log_of_whole_pages_with_a_cut_end_is_read_without_searching_in_the_map(damage, flown, tmp_path, monkeypatch):
    whole = dataflash(flown, 11)
    data = bytearray(whole[: len(whole) // mmap.PAGESIZE * mmap.PAGESIZE])
    middle = len(data) // 2
    data[middle : middle + damage] = bytes(damage)
    monkeypatch.setattr(reader.mmap, "mmap", NoFind)
    log = read(tmp_path, bytes(data))
    assert len(log.places) >= 8
    assert log.notes.skipped["damaged bytes"] >= damage - 60


OLD = {
    128: (b"FMT", b"BBnNZ", b"Type,Length,Name,Format,Columns"),
    1: (b"GPS", b"BIHBcLLeeEefI", b"Status,TimeMS,Week,NSats,HDop,Lat,Lng,RelAlt,Alt,Spd,GCrs,VZ,T"),
    2: (b"POS", b"ILLff", b"TimeMS,Lat,Lng,Alt,RelAlt"),
    3: (b"ATT", b"Icccc", b"TimeMS,Roll,Pitch,DesYaw,Yaw"),
}
OLD_SIZES = {1: "<BIHBhiiiiIifI", 2: "<Iiiff", 3: "<Ihhhh"}


def old_dataflash(flown, system_id):
    """A log of ArduPilot before 2015: milliseconds since boot, GPS time under other names."""
    data = [struct.pack("<3sBB4s16s64s", b"\xa3\x95\x80", 128, 89, *OLD[128])]
    data += [
        struct.pack("<3sBB4s16s64s", b"\xa3\x95\x80", kind, 3 + struct.calcsize(size), *OLD[kind])
        for kind, size in OLD_SIZES.items()
    ]
    places = wire_places(flown, system_id)
    for t, lat, lon, alt, height, *_ in zip(*(column.tolist() for column in places.values()), strict=True):
        boot_ms = (t - int(places["t_us"][0]) + BOOT_US) // 1000
        week, ms = divmod((t - GPS_EPOCH_US) // 1000, WEEK_MS)
        at = (round(lat * 1e7), round(lon * 1e7))
        cm = (round(height * 100), round(alt * 100))
        fix = (3, ms, week, 9, 80, *at, *cm, 0, 0, 0.0, boot_ms)
        for kind, values in ((1, fix), (2, (boot_ms, *at, alt, height)), (3, (boot_ms, 100, 200, 0, 9000))):
            data.append(b"\xa3\x95" + bytes([kind]) + struct.pack(OLD_SIZES[kind], *values))
    return b"".join(data)


def test_logs_from_before_2015(flown, tmp_path):
    log, good = read(tmp_path, old_dataflash(flown, 11)), read(tmp_path, dataflash(flown, 11))
    assert log.places.t_us == pytest.approx(good.places.t_us, abs=5000)
    assert log.places.lat_deg == pytest.approx(good.places.lat_deg, abs=4e-7)
    assert log.places.height_m == pytest.approx(good.places.height_m, abs=0.02)
    assert np.degrees(log.attitudes.angles[0]) == pytest.approx((1.0, 2.0, 90.0))


SIZES = {char: np.dtype(kind).itemsize for char, kind in reader._TYPES.items()}


@pytest.mark.slow_but_first
@pytest.mark.parametrize("kind", "nfd")
@pytest.mark.parametrize("name", ["GPS", "POS", "ATT", "XKF1", "PARM", "MNT"])
def test_columns_of_another_kind_are_not_there(kind, name, flown, tmp_path):
    data = dataflash(flown, 11, gimbal_deg=(0.0, -45.0, 10.0))
    at = data.index(struct.pack("4s", name.encode()), 89) + 4
    told = {len(read(tmp_path, data).places)}
    whole = told | {"no position in it; an ArduPilot log with POS or GPS is needed"}
    for column, char in enumerate(data[at : at + 16].split(b"\0")[0].decode()):
        if SIZES[char] == SIZES[kind]:
            changed = bytearray(data)
            changed[at + column] = ord(kind)
            try:
                told.add(len(read(tmp_path, changed).places))
            except ImportFileError as error:
                told.add(str(error).partition(": ")[2])
    assert told <= whole
