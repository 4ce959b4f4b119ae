import struct
import sys

import gpxpy
import numpy as np
import pytest
from pymavlink.DFReader import DFReader_binary
from pyulog import ULog

from gcs.errors import ImportFileError
from gcs.importing import sources
from gcs.importing.sources import read_vehicle_logs
from tests.support.bundled import ROOT
from tests.support.imports.flown import UGVS, fly
from tests.support.imports.log_writers import dataflash, gpx, pose_csv, positions_csv, ulog, wire_attitudes, wire_places


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    return fly(tmp_path_factory.mktemp("flown"), 60)


def read(tmp_path, name, data):
    path = tmp_path / name
    path.write_bytes(data if isinstance(data, bytes) else data.encode())
    return read_vehicle_logs(path)


def assert_same_places(log, flown, system_id, *, within_us=1000, moving=True):
    told = wire_places(flown, system_id)
    assert log.places.t_us == pytest.approx(told["t_us"], abs=within_us)
    assert log.places.lat_deg == pytest.approx(told["lat"], abs=2e-7)
    assert log.places.lon_deg == pytest.approx(told["lon"], abs=2e-7)
    assert log.places.alt_m == pytest.approx(told["alt_m"], abs=0.02)
    if moving:
        wanted = np.column_stack([told[name] for name in ("vn", "ve", "vd")])
        assert log.places.v_ned == pytest.approx(wanted, abs=0.01)


@pytest.mark.parametrize("system_id", [1, 11])
def test_dataflash(system_id, flown, tmp_path):
    data = dataflash(flown, system_id, gimbal_deg=(0.0, -45.0, 10.0))
    (log,) = read(tmp_path, "rover.bin", data)
    assert (log.clock, log.system_id) == ("utc", system_id)
    assert_same_places(log, flown, system_id)
    assert log.places.height_m == pytest.approx(wire_places(flown, system_id)["height_m"], abs=0.01)
    t_us, angles = wire_attitudes(flown, system_id)
    assert log.attitudes.t_us == pytest.approx(t_us, abs=1000)
    turned = (log.attitudes.angles - angles + np.pi) % (2 * np.pi) - np.pi
    assert np.abs(turned).max() < np.radians(0.02)
    assert np.degrees(log.gimbal.angles[3]) == pytest.approx((0.0, -45.0, 10.0))
    assert log.gimbal.yaw_from == "nose"
    assert log.places.std_m == pytest.approx(1.2)


def test_what_we_write_is_dataflash_to_pymavlink(flown, tmp_path):
    path = tmp_path / "rover.bin"
    path.write_bytes(dataflash(flown, 11))
    reader = DFReader_binary(str(path))
    positions = []
    while (message := reader.recv_match(type=["POS"])) is not None:
        positions.append((message.Lat, message.Lng, message.Alt))
    reader.data_map.close()
    reader.filehandle.close()
    (log,) = read_vehicle_logs(path)
    found = np.column_stack([log.places.lat_deg, log.places.lon_deg, log.places.alt_m])
    assert np.array(positions) == pytest.approx(found, abs=1e-6)
    assert log.places.t_us[0] * 1e-6 == pytest.approx(reader.clock.timebase + 77.0, abs=0.01)


def test_dataflash_without_a_filter_or_a_date(flown, tmp_path):
    whole = dataflash(flown, 11)
    (log,) = read(tmp_path, "a.bin", whole.replace(b"POS\0", b"XXX\0"))
    assert_same_places(log, flown, 11)
    assert log.notes.found[0].endswith("of the receiver")
    (log,) = read(tmp_path, "b.bin", dataflash(flown, 11, gps=False))
    assert log.clock == "own"


def test_dataflash_goes_on_after_damage(flown, tmp_path):
    data = bytearray(dataflash(flown, 11))
    data[5000:5400] = bytes(400)
    (log,) = read(tmp_path, "rover.bin", bytes(data))
    assert log.notes.skipped["damaged bytes"] >= 390
    assert len(log.places) >= len(wire_places(flown, 11)["t_us"]) - 10


def test_dataflash_with_a_type_of_length_0_ends(flown, tmp_path):
    hostile = struct.pack("<3sBB4s16s64s", b"\xa3\x95\x80", 1, 0, b"ATT", b"QB", b"TimeUS,X") + b"\xa3\x95\x01" * 50
    (log,) = read(tmp_path, "rover.bin", hostile + dataflash(flown, 11))
    assert_same_places(log, flown, 11)


def test_ulog(flown, tmp_path):
    data = ulog(flown, 12)
    (log,) = read(tmp_path, "rover.ulg", data)
    assert (log.clock, log.system_id) == ("utc", 12)
    assert_same_places(log, flown, 12)
    assert log.places.std_m == pytest.approx(0.8)
    t_us, angles = wire_attitudes(flown, 12)
    assert log.attitudes.t_us == pytest.approx(t_us)
    turned = (log.attitudes.angles - angles + np.pi) % (2 * np.pi) - np.pi
    assert np.abs(turned).max() < 1e-5
    oracle = ULog(str(tmp_path / "rover.ulg")).get_dataset("vehicle_global_position").data
    assert oracle["lat"] == pytest.approx(log.places.lat_deg, abs=1e-9)


def test_a_telemetry_log_of_one_vehicle(flown, tmp_path):
    flown.log.cut(tmp_path / "uav.tlog", system_ids=[1])
    (log,) = read_vehicle_logs(tmp_path / "uav.tlog")
    assert (log.clock, log.system_id) == ("utc", 1)
    assert_same_places(log, flown, 1, within_us=0)
    t_us, angles = wire_attitudes(flown, 1)
    assert log.attitudes.t_us == pytest.approx(t_us)
    assert log.attitudes.angles == pytest.approx(angles)
    assert np.degrees(log.gimbal.angles[:, 1]) == pytest.approx(-90.0, abs=0.1)
    assert log.gimbal.yaw_from == "nose"


def test_a_number_that_signals_that_it_is_none_is_passed_over(flown, tmp_path):
    speed = struct.pack("<f", wire_places(flown, 12)["vn"][30])
    (log,) = read(tmp_path, "rover.ulg", ulog(flown, 12).replace(speed, b"\x01\x00\xa0\x7f"))
    assert np.isfinite(log.places.v_ned).all()


def test_bytes_between_the_messages_of_a_ulog_are_damage(flown, tmp_path):
    whole = ulog(flown, 12)
    at = int(0.3 * len(whole))
    hurt = whole[:at] + bytes(range(7)) + whole[at:]
    for data, said in ((whole, {}), (whole[:-9], {"ends in the middle": 1}), (hurt, {"damaged places": 1})):
        (log,) = read(tmp_path, "rover.ulg", data)
        assert log.notes.skipped == said


def test_without_pyulog_it_is_told_what_to_install(flown, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyulog", None)
    with pytest.raises(ImportFileError, match=r"pip install 'rollcall-gcs\[import\]'"):
        read(tmp_path, "rover.ulg", ulog(flown, 12))


def test_a_table_of_several_vehicles(flown, tmp_path):
    logs = read(tmp_path, "positions.csv", positions_csv(flown, UGVS))
    assert [log.system_id for log in logs] == list(UGVS)
    for log in logs:
        assert log.clock == "utc"
        assert_same_places(log, flown, log.system_id, within_us=0)


def test_a_table_of_poses_by_frame_with_decimal_commas(flown, tmp_path):
    (log,) = read(tmp_path, "pose.csv", pose_csv(flown))
    assert (log.clock, len(log.places), len(log.attitudes)) == ("frame", 60, 60)
    spots = [spot for _, spot in flown.spots()]
    assert log.places.lat_deg == pytest.approx([spot.lat for spot in spots], abs=1e-7)
    assert log.places.height_m == pytest.approx([spot.height for spot in spots], abs=1e-6)
    yaw = np.degrees(log.attitudes.angles[:, 2])
    assert (yaw - [spot.yaw for spot in spots] + 180.0) % 360.0 - 180.0 == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize(
    ("header", "cell", "clock", "us"),
    [
        ("time", "2026-11-20T10:20:01.5Z", "utc", 1_795_170_001_500_000),
        ("timestamp", "2026-11-20T12:20:01.5+02:00", "utc", 1_795_170_001_500_000),
        ("time_s", "1795170001.5", "utc", 1_795_170_001_500_000),
        ("time", "1.5", "video", 1_500_000),
        ("elapsed_s", "1.5", "video", 1_500_000),
        ("t_us", "1795170001500000", "utc", 1_795_170_001_500_000),
    ],
)
def test_times_of_a_table(header, cell, clock, us, tmp_path):
    (log,) = read(tmp_path, "pose.csv", f"{header},lat,lon\n{cell},1.5,2.5\n")
    assert (log.clock, log.places.t_us.tolist()) == (clock, [us])


def test_speed_and_course_of_a_table(tmp_path):
    (log,) = read(tmp_path, "pose.csv", "time_us,lat,lon,speed_mps,course_deg\n5,1.5,2.5,2,90\n")
    assert log.places.v_ned[0, :2] == pytest.approx((0.0, 2.0), abs=1e-9)


def test_gpx(flown, tmp_path):
    text = gpx(flown, (11, 12))
    logs = read(tmp_path, "rovers.gpx", text)
    assert [log.system_id for log in logs] == [11, 12]
    for log in logs:
        assert_same_places(log, flown, log.system_id, moving=False)
    (first, _) = gpxpy.parse(text).tracks
    assert [point.latitude for point in first.segments[0].points] == pytest.approx(logs[0].places.lat_deg)


def nested(levels):
    """A PX4 log of formats within formats: a hundred times more fields with each level."""
    formats = [f"t{k}:t{k + 1}[99] a;" for k in range(levels)] + [f"t{levels}:uint8_t[99] a;", TOP]
    messages = [(b"B", bytes(40)), *((b"F", text.encode()) for text in formats), (b"A", ADDED)]
    return (
        b"ULog\x01\x12\x35\x01"
        + bytes(8)
        + b"".join(struct.pack("<Hc", len(data), kind) + data for kind, data in messages)
    )


TOP = "vehicle_attitude:uint64_t timestamp;t0[99] a;"
ADDED = struct.pack("<BH", 0, 1) + b"vehicle_attitude"
BOMB = '<!DOCTYPE g [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;">]><gpx><trk><name>&b;</name></trk></gpx>'


@pytest.mark.slow_but_first
@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("a.bin", b"\xa3\x95"),
        ("a.bin", b"hello" * 100),
        ("a.ulg", b"ULog\x01\x12\x35\x01"),
        ("a.ulg", b"hello" * 100),
        ("a.ulg", nested(8)),
        ("a.csv", "lat,lon\n1,2\n"),
        ("a.csv", "time_us,lat\n1,2\n"),
        ("a.csv", "time_us,lat,lon\nnan,1,2\n1,inf,2\n1,1e300,2\n-5,1,2\n"),
        ("a.csv", "time_us,system_id,lat,lon\n1,256,1.5,2.5\n1,-1,1.5,2.5\n1,1.5,1.5,2.5\n"),
        ("a.csv", b"\xff\xfe\x00\x00" * 100),
        ("a.gpx", BOMB),
        ("a.gpx", "<gpx><trk></trk></gpx>"),
        ("a.gpx", "hello"),
        ("a.gpx", "<a>" * 5000),
        ("a.doc", "hello"),
        ("a.csv", ""),
    ],
)
def test_what_is_none_is_one_clear_line(name, data, tmp_path):
    with pytest.raises(ImportFileError, match=rf"a\.{name[2:]}") as caught:
        read(tmp_path, name, data)
    assert "\n" not in str(caught.value)


def test_there_is_no_such_file(tmp_path):
    for name in ("a.bin", "a.ulg", "a.csv", "a.gpx", "a.srt"):
        with pytest.raises(ImportFileError, match="no such file"):
            read_vehicle_logs(tmp_path / name)


def test_the_page_names_each_kind_of_file_that_is_read_and_that_is_not():
    page = (ROOT / "docs" / "import.md").read_text(encoding="utf-8")
    products = page.partition("## Which file of which product")[2].partition("\n## ")[0].lower()
    for suffix in {suffix for each in sources.FORMATS for suffix in each.suffixes} | sources.OTHERWISE.keys():
        assert f"`{suffix}`" in products, suffix
