"""Logs as text: of ArduPilot, of receivers, and KML, with what their writers do."""

import subprocess
import sys

import numpy as np
import pytest

from gcs.errors import ImportFileError
from gcs.importing.sources import read_vehicle_logs
from tests.support.imports.flown import fly
from tests.support.imports.log_writers import dataflash, wire_places
from tests.support.imports.text_writers import dataflash_text, kml, nmea, sentence, when

T0_US = 1_760_000_000_000_000


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    return fly(tmp_path_factory.mktemp("flown"), 60)


def read(tmp_path, name, data):
    (tmp_path / name).write_bytes(data if isinstance(data, bytes) else data.encode())
    return read_vehicle_logs(tmp_path / name)


OTHER_READER = """
import sys
from pymavlink.DFReader import DFReader_text
log = DFReader_text(sys.argv[1])
while record := log.recv_match(type="POS"):
    print(record.TimeUS, record.Lat, record.Lng, record.Alt)
"""


def test_a_dataflash_log_as_text_is_that_in_binary(flown, tmp_path):
    data = dataflash(flown, 11, gimbal_deg=(0.0, -45.0, 10.0), receiver=1)
    (log,) = read(tmp_path, "rover.log", dataflash_text(data))
    (binary,) = read(tmp_path, "rover.bin", data)
    assert (log.system_id, log.clock) == (11, "utc")
    assert (log.places.t_us == binary.places.t_us).all()
    for name in ("lat_deg", "lon_deg", "alt_m", "height_m", "v_ned", "heading"):
        assert getattr(log.places, name) == pytest.approx(getattr(binary.places, name), abs=1e-6, nan_ok=True), name
    assert log.attitudes.angles == pytest.approx(binary.attitudes.angles, abs=1e-9)
    assert log.gimbal.angles == pytest.approx(binary.gimbal.angles, abs=1e-9)
    assert not log.notes.skipped and log.notes.found[0].startswith("dataflash as text")
    command = [sys.executable, "-c", OTHER_READER, str(tmp_path / "rover.log")]
    told = subprocess.run(command, check=True, capture_output=True, text=True, timeout=60).stdout
    rows = np.array([line.split() for line in told.splitlines()], float)
    assert np.diff(rows[:, 0]) == pytest.approx(np.diff(log.places.t_us))
    assert rows[:, 1] == pytest.approx(log.places.lat_deg) and rows[:, 3] == pytest.approx(log.places.alt_m)


def test_lines_of_no_record_are_counted(flown, tmp_path):
    lines = dataflash_text(dataflash(flown, 11)).splitlines(keepends=True)
    at = next(k for k, line in enumerate(lines) if line.startswith("POS") and k > len(lines) // 2)
    cut = lines[at].replace(", ", "; ", 2)
    (log,) = read(tmp_path, "rover.log", "".join(["ArduRover V4.5\n", *lines[:at], cut, "POS, 12\n", *lines[at + 1 :]]))
    (whole,) = read(tmp_path, "whole.log", "".join(lines))
    assert log.notes.skipped == {"damaged lines": 2}
    assert len(log.places) == len(whole.places) - 1


@pytest.mark.parametrize("formats", [True, False])
def test_two_starts_in_a_text_are_refused_with_their_line(formats, flown, tmp_path):
    first, second = (dataflash_text(dataflash(flown, 11, late_us=us)) for us in (0, 464_900_000))
    lines = second.splitlines(keepends=True)
    second = "".join(lines if formats else [line for line in lines if not line.startswith(("FMT", "PARM"))])
    begins = first.count("\n") + 1
    with pytest.raises(ImportFileError, match=rf"started again at line {begins}; .* head -n {begins - 1},"):
        read(tmp_path, "rover.log", first + second)


def test_text_from_before_2015(flown, tmp_path):
    (good,) = read(tmp_path, "new.log", dataflash_text(dataflash(flown, 11)))
    old = []
    for line in dataflash_text(dataflash(flown, 11)).splitlines():
        line = line.replace("TimeUS,I,Status,GMS,GWk", "T,I,Status,TimeMS,Week") if "FMT" in line else line
        cells = line.split(", ")
        if cells[0] != "FMT":
            cells[1] = str(int(cells[1]) // 1000)
        old.append(", ".join(cells).replace("TimeUS", "TimeMS").replace("RelHomeAlt", "RelAlt"))
    (log,) = read(tmp_path, "old.log", "\n".join(old))
    assert log.places.t_us == pytest.approx(good.places.t_us, abs=1000)
    assert log.places.height_m == pytest.approx(good.places.height_m)


@pytest.mark.parametrize(
    ("name", "writer"),
    [
        ("rover.txt", lambda flown: nmea(flown, 11)),
        ("rover.log", lambda flown: "".join(f"12:00:01 {line}\n" for line in nmea(flown, 11).splitlines())),
        ("rover.bin", lambda flown: dataflash_text(dataflash(flown, 11))),
        ("rover.xml", lambda flown: kml(flown, (11,))),
    ],
)
def test_what_a_file_is_is_told_by_how_it_begins(name, writer, flown, tmp_path):
    (log,) = read(tmp_path, name, writer(flown))
    places = wire_places(flown, 11)
    assert log.places.t_us == pytest.approx(places["t_us"], abs=5000)
    assert log.places.lat_deg == pytest.approx(places["lat"], abs=4e-7)
    assert log.places.alt_m == pytest.approx(places["alt_m"], abs=0.01)


def test_a_receivers_velocity(flown, tmp_path):
    (log,) = read(tmp_path, "rover.nmea", nmea(flown, 11))
    places = wire_places(flown, 11)
    assert log.places.v_ned[:, 0] == pytest.approx(places["vn"], abs=0.01)
    assert log.places.v_ned[:, 1] == pytest.approx(places["ve"], abs=0.01)
    assert log.places.std_m == pytest.approx(1.2)  # a dilution of 0.8


def test_a_receivers_other_sentences(tmp_path):
    """Another constellation, a date by ZDA that is told before midnight only, south and west, 1σ, and no fix."""
    lines = [sentence("GNZDA,235959.00,08,10,2025,00,00")]
    for k, clock in enumerate(("235959.00", "235959.50", "000000.00", "000000.50")):
        lines.append(sentence(f"GNGNS,{clock},3330.00000{k},S,07030.000000,W,AN,12,0.80,430.0,47.1,,"))
        lines.append(sentence(f"GNGST,{clock},0.5,,,,0.03,0.04,0.09"))
    lines.append(sentence("GNGGA,000001.00,,,,,0,00,99.9,,,,,,"))
    (log,) = read(tmp_path, "rover.nmea", "".join(lines))
    assert when(int(log.places.t_us[0])) == "2025-10-08T23:59:59.000000Z"
    assert np.diff(log.places.t_us).tolist() == [500_000] * 3
    assert (log.places.lat_deg[0], log.places.lon_deg[0]) == pytest.approx((-33.5, -70.5))
    assert log.places.std_m == pytest.approx(0.05 / np.sqrt(2.0))
    assert log.notes.skipped == {"times without a fix": 1}


def test_a_damaged_sentence_is_counted(flown, tmp_path):
    text = nmea(flown, 11)
    (log,) = read(tmp_path, "rover.nmea", text.replace("GGA,", "GGA,1", 1))
    assert log.notes.skipped == {"sentences with a wrong checksum": 1}


def test_what_loggers_write_behind_a_sentence_is_passed_over(flown, tmp_path):
    lines = nmea(flown, 11).splitlines()
    (whole,) = read(tmp_path, "whole.nmea", "\n".join(lines))
    phone = "\n".join(f"NMEA,{line},{1_760_000_000_000 + k}" for k, line in enumerate(lines))
    (log,) = read(tmp_path, "phone.txt", phone)
    assert (log.places.t_us == whole.places.t_us).all() and not log.notes.skipped


def test_sentences_that_are_cut_off_are_counted(flown, tmp_path):
    lines = [line for line in nmea(flown, 11).splitlines(keepends=True) if "GGA" in line or "RMC" in line]
    # one sentence runs into the next, another one ends with the file
    (log,) = read(tmp_path, "rover.nmea", "".join([*lines[:5], lines[5][:20], *lines[6:-1], lines[-1][:30], "*"]))
    assert log.notes.skipped == {"sentences that are cut off": 2}


def test_positions_without_a_date_are_refused(flown, tmp_path):
    text = "".join(line for line in nmea(flown, 11).splitlines(keepends=True) if "GGA" in line)
    with pytest.raises(ImportFileError, match="nothing in it tells the date: record RMC or ZDA"):
        read(tmp_path, "rover.nmea", text)


def placemarks(*marks, name="UGV-12"):
    return f"<kml><Document><Folder><name>{name}</name>{''.join(marks)}</Folder></Document></kml>"


def coordinates(*rows):
    return " ".join(f"{8.1:.7f},{47.1 + 1e-5 * k:.7f},430" for k in rows)


def point(k):
    stamp = f"<TimeStamp><when>{when(T0_US + k * 1_000_000)}</when></TimeStamp>"
    place = f"<altitudeMode>absolute</altitudeMode><coordinates>{coordinates(k)}</coordinates>"
    return f"<Placemark><name>{k}</name>{stamp}<Point>{place}</Point></Placemark>"


def line(first, *further, timed=True):
    begin, end = (when(T0_US + k * 1_000_000) for k in (first, further[-1]))
    span = f"<TimeSpan><begin>{begin}</begin><end>{end}</end></TimeSpan>" if timed else ""
    mode = "<altitudeMode>absolute</altitudeMode>"
    path = f"<LineString>{mode}<coordinates>{coordinates(first, *further)}</coordinates></LineString>"
    return f"<Placemark>{span}{path}</Placemark>"


@pytest.mark.parametrize("shape", [point, lambda k: line(k, k + 1)])
def test_points_and_lines_of_a_folder_are_one_track(shape, tmp_path):
    (log,) = read(tmp_path, "rover.kml", placemarks(*map(shape, range(20))))
    rows = np.arange(len(log.places))
    assert len(rows) >= 20 and log.system_id == 12 and not log.notes.skipped
    assert (log.places.t_us == T0_US + rows * 1_000_000).all()
    assert log.places.lat_deg == pytest.approx(47.1 + 1e-5 * rows)
    assert log.places.alt_m == pytest.approx(430.0)


@pytest.mark.parametrize(
    ("timed", "words"), [(True, "1 lines with times at their ends alone"), (False, "1 lines with no times")]
)
def test_a_line_that_does_not_tell_when_it_was_where_is_refused(timed, words, tmp_path):
    with pytest.raises(ImportFileError, match=f"no point with a place and a time in it; {words}"):
        read(tmp_path, "rover.kml", placemarks(line(*range(5), timed=timed)))


def test_altitude_modes(flown, tmp_path):
    text = kml(flown, (11,))
    (above,) = read(tmp_path, "a.kml", text.replace("absolute", "relativeToGround"))
    assert np.isnan(above.places.alt_m).all() and np.isfinite(above.places.height_m).all()
    (drawn,) = read(tmp_path, "b.kml", text.replace("absolute", "clampToGround"))
    assert np.isnan(drawn.places.alt_m).all()
    assert drawn.notes.assumed == ("altitudes that are not drawn (clampToGround) are not known",)


def test_an_altitude_mode_may_stand_behind_the_points(flown, tmp_path):
    """A KML track by simplekml, whose altitude mode stands behind its points."""
    text, mode = kml(flown, (11, 12)), "<altitudeMode>absolute</altitudeMode>"
    before = read(tmp_path, "before.kml", text)
    behind = text.replace(mode, "").replace("</gx:Track>", f"{mode}</gx:Track>")
    for log, other in zip(read(tmp_path, "behind.kml", behind), before, strict=True):
        assert log.notes == other.notes and (log.places.alt_m == other.places.alt_m).all()
    cut = behind[: behind.rindex("<gx:coord>")]
    logs = read(tmp_path, "cut.kml", cut)
    assert [len(log.places) for log in logs] == [len(before[0].places), len(before[1].places) - 1]
    assert logs[1].notes.skipped["ends in the middle"] == 1


@pytest.mark.parametrize(
    ("name", "head", "words"),
    [
        ("a.kmz", b"PK\x03\x04", "unzip it"),
        ("a.fit", b"\x0e\x10", "GPX"),
        ("a.doc", b"\xd0\xcf", r"give .*\.nmea"),
        ("a.bin", b"PK\x03\x04", r"a packed file \(zip\): unpack it first"),
        ("a.csv", b"\x1f\x8b\x08", r"a packed file \(gzip\): unpack it first"),
        ("a.ulg.7z", b"7z\xbc\xaf", r"a packed file \(7z\): unpack it first"),
    ],
)
def test_what_is_not_read_says_what_would_be(name, head, words, tmp_path):
    with pytest.raises(ImportFileError, match=words):
        read(tmp_path, name, head)
