"""Names and words from outside, in every format that there is: a new one is tried here without being added.

Each file is read back by the reader of its ending; a format with another ending has to bring one (``READERS``).
"""

import csv
import json
import sqlite3
from contextlib import closing
from dataclasses import replace
from xml.etree import ElementTree

import av
import cv2
import numpy as np
import pyarrow.parquet
import pytest
from mcap.reader import make_reader

from gcs.export.formats import FORMATS
from gcs.export.job import ExportJob
from gcs.snapshot import Candidate, VehicleRow
from infra.plain_text import from_cell, plain
from mavlink.geodesy import LocalFrame
from tests.support.fake_station import HOSTILE
from tests.support.snapshots import box

NAMES = (
    *(name if len(name) < 1000 else name[:300] for name in HOSTILE if name),
    '=HYPERLINK("http://x")',
    "@SUM(1+1)*cmd|' /C calc'!A0",
    "+1-1",
    "<script>alert(1)</script>",
    "]]><b a='\"'>&amp;&lt;&#0;",
    "{\\an8}{\\pos(0,0)}\\N\\h",
    "1\n00:00:00,000 --> 00:00:09,000\nx",
    "'); DROP TABLE boxes; --",
    'a,b"c;d\te',
    "../../../etc/passwd",
    "nan",
)
FIRST = 11
NEVER_NAMED = "Zebra of nobody"
FRAMES = 3


DRAWN = ("mp4", "mkv", "mcap", "rosbag", "klv", "ass", "srt", "vtt")
"""Formats that draw names, spell them with twins of letters, or have them in messages: how is in their own tests."""


def as_bytes(name):
    return name.encode(errors="surrogatepass")


def json_texts(value):
    if isinstance(value, dict):
        return [text for key, one in value.items() for text in (key, *json_texts(one))]
    if isinstance(value, list):
        return [text for one in value for text in json_texts(one)]
    return [value] if isinstance(value, str) else []


def read_json(path):
    lines = path.read_text().splitlines() if path.suffix == ".jsonl" else [path.read_text()]
    return [text for line in lines for text in json_texts(json.loads(line))]


def read_xml(path):
    texts = (text for one in ElementTree.parse(path).iter() for text in (one.text, *one.attrib.values()))
    return [text for text in texts if text and text.strip()]


def read_csv(path):
    with path.open(newline="") as file:
        rows = list(csv.reader(file))
    assert len({len(row) for row in rows}) == 1
    for cell in (cell for row in rows for cell in row):
        assert not cell.startswith(("=", "+", "@", "\t", "\r")), cell
        assert not cell.startswith("-") or np.isfinite(float(cell)), cell
    return [cell for row in rows for cell in row]


def read_text(path):
    return path.read_text().split("\n")


def read_sqlite(path):
    with closing(sqlite3.connect(path)) as table:
        assert table.execute("PRAGMA integrity_check").fetchone() == ("ok",)
        tables = [name for (name,) in table.execute("SELECT name FROM sqlite_master WHERE type = 'table'")]
        rows = [row for name in tables for row in table.execute(f'SELECT * FROM "{name}"')]
    return [line for row in rows for cell in row if isinstance(cell, str) for line in lines_of(path, cell)]


def lines_of(path, cell):
    """A bag has the definitions of its messages, many lines each."""
    return cell.splitlines() if path.suffix == ".db3" else [cell]


def read_parquet(path):
    table = pyarrow.parquet.read_table(path)
    return [cell for row in table.to_pylist() for cell in row.values() if isinstance(cell, str)]


def read_mcap(path):
    texts = []
    with path.open("rb") as file:
        for _, channel, message in make_reader(file, validate_crcs=True).iter_messages():
            texts.append(channel.topic)
            assert not [name for name in NAMES if not name.isprintable() and as_bytes(name) in message.data]
            if channel.message_encoding == "json":
                texts += json_texts(json.loads(message.data))
    return texts


def read_film(path):
    texts = []
    with av.open(str(path)) as film:
        texts += [*film.metadata.values(), *(word for one in film.streams for word in one.metadata.values())]
        streams = [one for one in film.streams if one.type == "subtitle"]
        for packet in film.demux(*streams) if streams else ():
            texts += bytes(packet).decode().split("\n")
    return texts


def read_image(path):
    assert cv2.imread(str(path)) is not None
    return []


READERS = (
    {suffix: read_json for suffix in (".json", ".jsonl", ".geojson")}
    | {suffix: read_xml for suffix in (".xml", ".kml", ".gpx", ".cot")}
    | {suffix: read_text for suffix in (".txt", ".ini", ".yaml", ".ass", ".srt", ".vtt")}
    | {suffix: read_film for suffix in (".mp4", ".mkv", ".ts")}
    | {suffix: read_sqlite for suffix in (".gpkg", ".db3")}
    | {".csv": read_csv, ".parquet": read_parquet, ".mcap": read_mcap, ".jpg": read_image}
)


@pytest.fixture(scope="module")
def shown(shots):
    """Three frames with a box for each name, and a stranger that may be one more vehicle but is not called so."""
    image = np.full((1080, 1920, 3), 90, np.uint8)
    places = {"lat_deg": 47.1, "lon_deg": 8.5, "place_std_m": 1.0, "p_enu": np.array([1.0, 2.0, 0.0])}
    boxes = [
        box(k, FIRST + k, **places | {"cx": 60.0 + 64.0 * k, "cy": 100.0 + 20.0 * k}) for k in range(1, len(NAMES) + 1)
    ]
    nobody = FIRST + len(NAMES) + 1
    candidates = (Candidate(system_id=nobody, confidence=0.4),)
    may_be = {"runner_up": nobody, "runner_up_confidence": 0.4, "candidates": candidates}
    boxes.append(box(90, 0, **places | may_be | {"cx": 900.0, "cy": 900.0}))
    vehicles = [VehicleRow(system_id=FIRST + k, name=name, role="ugv") for k, name in enumerate(NAMES, 1)]
    vehicles.append(VehicleRow(system_id=nobody, name=NEVER_NAMED, role="ugv"))
    origin = LocalFrame(lat_deg=47.0, lon_deg=8.5, alt_m=0.0) if shots[0].origin is None else shots[0].origin
    return [
        replace(one, boxes=tuple(boxes), vehicles=(one.vehicles[0], *vehicles), image=image, origin=origin, events=())
        for one in shots[:FRAMES]
    ]


CODED = ("mcap", "mkv", "klv", "rosbag")
"""With the film, which takes seconds."""


@pytest.mark.parametrize(
    "form",
    [pytest.param(form, marks=[pytest.mark.slow] * (name in CODED)) for name, form in FORMATS.items()],
    ids=FORMATS,
)
@pytest.mark.parametrize(
    "called",
    [pytest.param("flight", marks=pytest.mark.slow), NAMES[3] + NAMES[-2] + "<&\"'=,"],
    ids=["plain", "hostile"],
)
def test_names_do_no_harm(form, called, shown, shots, flight, tmp_path):
    out = tmp_path / f"out{form.suffix}"
    times_us = np.array([one.t_us for one in shots])
    sink = form.open(ExportJob(path=out, name=called, video=flight / "video.mp4", times_us=times_us))
    for one in shown:
        sink.write(one)
    sink.close()
    assert list(tmp_path.iterdir()) == [out]
    files = [path for path in ([out] if out.is_file() else out.rglob("*")) if path.is_file()]
    assert files
    words = set()
    for path in files:
        assert str(path.relative_to(tmp_path)).isprintable()
        texts = READERS[path.suffix](path)
        words |= {from_cell(text)[:64] for text in texts}
        assert [text for text in texts if not text.isprintable()] == []
        data = path.read_bytes()
        for name in (*NAMES, called):
            assert name.isprintable() or as_bytes(name) not in data
    assert not [word for word in words if "Zebra" in word]
    if form.name not in DRAWN:
        assert {plain(name)[:64] for name in NAMES} <= words
