"""Maps, read back by gpxpy, SQLite, and parsers of JSON and XML; by GDAL: bench/results/interop/maps.md."""

import csv
import json
import math
import sqlite3
import struct
from dataclasses import replace
from xml.etree import ElementTree

import gpxpy
import pytest

from gcs.errors import SessionError
from gcs.export.formats import FORMATS, format_for
from gcs.export.job import ExportJob
from gcs.playback.analysis import Analysis
from gcs.session.session import open_session
from tests.support.bundled import SWARM, shortened
from tests.support.command_line import run_gcs
from tests.support.snapshots import box, snapshot

MAPS = ("geojson", "gpkg", "kml", "gpx")
PLACE = {"lat_deg": 47.1234567, "lon_deg": -8.5, "place_std_m": 1.234}
KML = {"k": "http://www.opengis.net/kml/2.2", "gx": "http://www.google.com/kml/ext/2.2"}


@pytest.fixture(scope="module")
def flight(tmp_path_factory):
    """The first 40 frames of the swarm, exported to all maps and as a table."""
    folder = tmp_path_factory.mktemp("maps")
    analysis = Analysis(open_session(shortened(SWARM, folder / "flight", 40)))
    sinks = [FORMATS[name].open(ExportJob(path=folder / f"a.{name}", name="flight")) for name in (*MAPS, "csv")]
    for shown in analysis.snapshots(images=False):
        for sink in sinks:
            sink.write(shown)
    for sink in sinks:
        sink.close()
    analysis.close()
    return folder


@pytest.fixture(scope="module")
def rows(flight):
    with (flight / "a.csv").open() as file:
        return list(csv.DictReader(file))


def written(path, *snapshots):
    sink = format_for(path).open(ExportJob(path=path, name="a <b>"))
    for each in snapshots:
        sink.write(each)
    sink.close()
    return path


def features(path, layer):
    return [one for one in json.loads(path.read_text())["features"] if one["properties"]["layer"] == layer]


def test_geojson_has_each_box_and_lines_through_them(flight, rows):
    points, lines = (features(flight / "a.geojson", layer) for layer in ("box", "track"))
    told = [(*one["geometry"]["coordinates"], one["properties"]["place_std_m"]) for one in points]
    assert told == [tuple(float(row[key]) for key in ("lon", "lat", "place_std_m")) for row in rows]
    assert [one["properties"]["name"] or "" for one in points] == [row["name"] for row in rows]
    assert {one["properties"]["name"] for one in lines} >= {"UGV-2", "UGV-6", None}
    for one in lines:
        along = one["properties"]["coordinateProperties"]
        assert len(one["geometry"]["coordinates"]) == len(along["times"]) == len(along["confidence"]) > 1
        assert along["times"] == sorted(along["times"])
        assert along["times"][0] == one["properties"]["first_utc"]


def test_the_geopackage_has_each_box_and_each_line(flight, rows):
    with sqlite3.connect(f"file:{flight / 'a.gpkg'}?mode=ro", uri=True) as table:
        assert table.execute("PRAGMA integrity_check").fetchone() == ("ok",)
        assert table.execute("PRAGMA foreign_key_check").fetchall() == []
        points = table.execute("SELECT geom, name, place_std_m FROM boxes ORDER BY fid").fetchall()
        lines = table.execute("SELECT geom, boxes, name FROM tracks").fetchall()
        layers = table.execute("SELECT table_name, min_x, max_y FROM gpkg_contents").fetchall()
    table.close()
    assert [name or "" for _, name, _ in points] == [row["name"] for row in rows]
    for (blob, _, std_m), row in zip(points, rows, strict=True):
        magic, flags, system, _, kind, lon, lat = struct.unpack("<3sBiBIdd", blob)
        assert (magic, flags, system, kind) == (b"GP\0", 1, 4326, 1)
        assert (lon, lat) == pytest.approx((float(row["lon"]), float(row["lat"])), abs=1e-7)
        assert std_m == pytest.approx(float(row["place_std_m"]), abs=1e-3)
    assert sorted(name or "" for *_, name in lines) == sorted(
        one["properties"]["name"] or "" for one in features(flight / "a.geojson", "track")
    )
    for blob, count, _ in lines:
        assert struct.unpack_from("<BII", blob, 40) == (1, 2, count)
        assert len(blob) == 49 + 16 * count
    longitudes = [float(row["lon"]) for row in rows]
    assert layers[0][0] == "boxes"
    assert layers[0][1] == pytest.approx(min(longitudes), abs=1e-7)


def test_gpxpy_reads_each_vehicle_with_times(flight, rows):
    gpx = gpxpy.parse((flight / "a.gpx").read_text())
    names = {row["name"] for row in rows if row["name"]}
    assert {one.name for one in gpx.tracks if not one.name.startswith("unknown ")} == names
    points = [point for track in gpx.tracks for segment in track.segments for point in segment.points]
    assert len(points) == sum(bool(row["track_id"]) for row in rows)
    times = {1e-6 * int(row["time_us"]) for row in rows}
    assert all(min(abs(p.time.timestamp() - t) for t in times) < 0.02 for p in points[::50])
    told = {child.tag.partition("}")[2] for child in points[0].extensions}
    assert told == {"confidence", "place_std_m"}


def test_kml_has_a_place_for_each_time(flight, rows):
    marks = ElementTree.parse(flight / "a.kml").getroot().findall("k:Document/k:Placemark", KML)
    names = [mark.findtext("k:name", namespaces=KML) for mark in marks]
    assert {name for name in names if not name.startswith("unknown ")} == {row["name"] for row in rows if row["name"]}
    tracks = [track for mark in marks for track in mark.findall("gx:MultiTrack/gx:Track", KML)]
    counts = [
        [len(track.findall(what, KML)) for what in ("k:when", "gx:coord")]
        + [len(column.findall("gx:value", KML)) for column in track.iter(f"{{{KML['gx']}}}SimpleArrayData")]
        for track in tracks
    ]
    assert all(len(set(count)) == 1 and len(count) == 4 for count in counts)
    assert sum(count[0] for count in counts) == sum(bool(row["track_id"]) for row in rows)


def test_strangers_have_no_name_and_a_line_ends_where_nobody_saw_the_vehicle(tmp_path):
    stranger = box(9, 0, **PLACE, runner_up=2, runner_up_confidence=0.6)
    shown = [snapshot(frame, boxes=[box(4, 2, **PLACE), stranger]) for frame in (0, 1, 2, 40, 41)]
    shown[3] = replace(shown[3], boxes=(box(4, 2, **PLACE, coasting=True),))
    lines = [one["properties"] for one in features(written(tmp_path / "a.geojson", *shown), "track")]
    told = [(one["name"], one["system_id"], len(one["coordinateProperties"]["times"])) for one in lines]
    assert told == [("Alpha", 2, 3), (None, None, 3)]
    gpx = gpxpy.parse(written(tmp_path / "a.gpx", *shown).read_text())
    assert gpx.name == "a <b>"
    assert [(one.name, len(one.segments)) for one in gpx.tracks] == [("Alpha", 2), ("unknown 9", 2)]


def test_frames_that_are_far_apart_are_joined(tmp_path):
    shown = [snapshot(frame, boxes=[box(4, 2, **PLACE)]) for frame in (0, 100, 200)]
    gpx = gpxpy.parse(written(tmp_path / "a.gpx", *shown).read_text())
    assert [len(segment.points) for segment in gpx.tracks[0].segments] == [3]


def test_a_line_does_not_go_round_the_world(tmp_path):
    east, west = (box(4, 2, lat_deg=0.0, lon_deg=lon) for lon in (179.99999, -179.99999))
    gpx = gpxpy.parse(written(tmp_path / "a.gpx", snapshot(0, boxes=[east]), snapshot(1, boxes=[west])).read_text())
    assert [len(segment.points) for segment in gpx.tracks[0].segments] == [1, 1]


@pytest.mark.parametrize("name", MAPS)
def test_what_is_unknown_is_no_number(tmp_path, name):
    nowhere = replace(box(5, 3), confidence=math.nan)
    unsure = replace(box(4, 2, **PLACE | {"place_std_m": math.nan}), confidence=math.nan)
    path = written(tmp_path / f"a.{name}", *(snapshot(frame, boxes=[unsure, nowhere]) for frame in range(2)))
    assert b"nan" not in path.read_bytes().lower().replace(b"nance", b"")
    if name == "geojson":
        points = features(path, "box")
        assert [one["geometry"] is None for one in points] == [False, True] * 2
        assert points[0]["properties"]["confidence"] is None
    if name == "gpkg":
        with sqlite3.connect(path) as table:
            rows = table.execute("SELECT geom IS NULL, confidence, place_std_m FROM boxes").fetchall()
            (line,) = table.execute("SELECT confidence_mean, place_std_m_max, name FROM tracks").fetchall()
        table.close()
        assert rows == [(0, None, None), (1, None, None)] * 2
        assert line == (None, None, "Alpha")


@pytest.mark.parametrize("name", MAPS)
def test_an_empty_flight_makes_a_whole_file_and_one_broken_off_none(tmp_path, name):
    path = written(tmp_path / f"a.{name}", snapshot())
    if name == "geojson":
        assert json.loads(path.read_text())["features"] == []
    elif name == "gpkg":
        with sqlite3.connect(path) as table:
            assert table.execute("SELECT min_x FROM gpkg_contents").fetchall() == [(None,), (None,)]
        table.close()
    else:
        assert ElementTree.parse(path).getroot().tag.endswith(f"}}{name}")
    before = path.read_bytes()
    with pytest.raises(SessionError, match="exists already"):
        FORMATS[name].open(ExportJob(path=path))
    broken = FORMATS[name].open(ExportJob(path=tmp_path / f"b.{name}"))
    broken.write(snapshot(boxes=[box(4, 2, **PLACE)]))
    if name == "geojson":
        broken._file.close()
    del broken
    assert list(tmp_path.iterdir()) == [path]
    assert path.read_bytes() == before


@pytest.mark.slow
def test_the_ending_names_the_format(tmp_path):
    code, _, err = run_gcs("export", shortened(SWARM, tmp_path / "flight", 20), "-o", tmp_path / "a.gpx", "--every", 2)
    assert code == 0, err
    assert "10 frames" in err
    assert gpxpy.parse((tmp_path / "a.gpx").read_text()).get_points_no() > 10
