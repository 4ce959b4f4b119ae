"""GeoPackage 1.3: one SQLite file with the layers ``boxes`` (points) and ``tracks`` (lines), WGS-84.

Tables and binary geometry: OGC 12-128r17, annexes C and clause 2.1.3, https://www.geopackage.org/spec130/.
"""

from __future__ import annotations

import math
import sqlite3
import struct
import weakref
from itertools import chain
from typing import Final

from gcs.export.job import ExportJob
from gcs.export.maps.ways import Way, Ways, placed, time_utc
from gcs.export.unfinished import Unfinished, writing_to
from gcs.missing import may_be
from gcs.snapshot import Box, Snapshot
from infra.plain_text import plain

WGS_84: Final = 4326
"""EPSG's number; also the one that the tables here have."""
_WKT: Final = (
    'GEOGCS["WGS 84",DATUM["WGS_1984",SPHEROID["WGS 84",6378137,298.257223563,AUTHORITY["EPSG","7030"]],'
    'AUTHORITY["EPSG","6326"]],PRIMEM["Greenwich",0,AUTHORITY["EPSG","8901"]],'
    'UNIT["degree",0.0174532925199433,AUTHORITY["EPSG","9122"]],AUTHORITY["EPSG","4326"]]'
)
_TABLES: Final = """
PRAGMA application_id = 1196444487;
PRAGMA user_version = 10300;
PRAGMA journal_mode = MEMORY;
CREATE TABLE gpkg_spatial_ref_sys (srs_name TEXT NOT NULL, srs_id INTEGER NOT NULL PRIMARY KEY,
  organization TEXT NOT NULL, organization_coordsys_id INTEGER NOT NULL, definition TEXT NOT NULL, description TEXT);
CREATE TABLE gpkg_contents (table_name TEXT NOT NULL PRIMARY KEY, data_type TEXT NOT NULL, identifier TEXT UNIQUE,
  description TEXT DEFAULT '', last_change DATETIME NOT NULL DEFAULT (strftime('%Y-%m-%dT%H:%M:%fZ','now')),
  min_x DOUBLE, min_y DOUBLE, max_x DOUBLE, max_y DOUBLE, srs_id INTEGER,
  CONSTRAINT fk_gc_r_srs_id FOREIGN KEY (srs_id) REFERENCES gpkg_spatial_ref_sys(srs_id));
CREATE TABLE gpkg_geometry_columns (table_name TEXT NOT NULL, column_name TEXT NOT NULL,
  geometry_type_name TEXT NOT NULL, srs_id INTEGER NOT NULL, z TINYINT NOT NULL, m TINYINT NOT NULL,
  CONSTRAINT pk_geom_cols PRIMARY KEY (table_name, column_name), CONSTRAINT uk_gc_table_name UNIQUE (table_name),
  CONSTRAINT fk_gc_tn FOREIGN KEY (table_name) REFERENCES gpkg_contents(table_name),
  CONSTRAINT fk_gc_srs FOREIGN KEY (srs_id) REFERENCES gpkg_spatial_ref_sys (srs_id));
CREATE TABLE boxes (fid INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, geom POINT, time_utc DATETIME, frame INTEGER,
  track_id INTEGER, system_id INTEGER, name TEXT, confidence DOUBLE, place_std_m DOUBLE, residual_m DOUBLE,
  stated BOOLEAN, may_be TEXT);
CREATE TABLE tracks (fid INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, geom LINESTRING, first_utc DATETIME,
  last_utc DATETIME, boxes INTEGER, track_id INTEGER, system_id INTEGER, name TEXT, confidence_mean DOUBLE,
  confidence_min DOUBLE, place_std_m_max DOUBLE);
BEGIN;
"""
_SYSTEMS: Final = (
    ("Undefined cartesian SRS", -1, "NONE", -1, "undefined", "undefined cartesian coordinate reference system"),
    ("Undefined geographic SRS", 0, "NONE", 0, "undefined", "undefined geographic coordinate reference system"),
    ("WGS 84 geodetic", WGS_84, "EPSG", WGS_84, _WKT, "longitude and latitude in degrees"),
)
_Bounds = tuple[float, float, float, float]
"""West, south, east, north."""
_NOWHERE: Final[_Bounds] = (math.inf, math.inf, -math.inf, -math.inf)


class GeoPackageExport:
    """Export to a GeoPackage; NULL is unknown, and a box of which no place is known has no geometry."""

    def __init__(self, job: ExportJob) -> None:
        self._path = job.path
        self._unfinished = Unfinished(job.path)
        self._ways = Ways()
        self._bounds = _NOWHERE
        self._last_us = 0
        self._table = sqlite3.connect(self._unfinished.path, isolation_level=None)
        self._close = weakref.finalize(self, self._table.close)
        with writing_to(job.path):
            self._table.executescript(_TABLES)
            self._table.executemany("INSERT INTO gpkg_spatial_ref_sys VALUES (?, ?, ?, ?, ?, ?)", _SYSTEMS)

    def write(self, snapshot: Snapshot) -> None:
        """Append the boxes seen in a frame."""
        self._last_us = max(self._last_us, snapshot.t_us)
        self._ways.add(snapshot)
        boxes = [box for box in snapshot.new_boxes if not box.coasting]
        for box in filter(placed, boxes):
            self._bounds = _around(self._bounds, (box.lon_deg, box.lat_deg, box.lon_deg, box.lat_deg))
        with writing_to(self._path):
            rows = (_box_row(snapshot, box) for box in boxes)
            self._table.executemany(f"INSERT INTO boxes VALUES (NULL{', ?' * 11})", rows)

    def close(self) -> None:
        """Append the lines and what describes the layers."""
        lines = [way for way in self._ways if len(way.t_us) > 1]
        with writing_to(self._path):
            self._table.executemany(f"INSERT INTO tracks VALUES (NULL{', ?' * 10})", map(_track_row, lines))
            self._describe("boxes", "POINT", "each box of each frame, by its place on the ground", self._bounds)
            bounds = _NOWHERE
            for way in lines:
                bounds = _around(bounds, _bounds(way))
            self._describe("tracks", "LINESTRING", "the ways of vehicles and strangers, without gaps", bounds)
            self._table.execute("COMMIT")
        self._close()
        self._unfinished.finish()

    def _describe(self, name: str, kind: str, words: str, bounds: _Bounds) -> None:
        known = bounds if bounds != _NOWHERE else (None,) * 4
        about = (name, "features", name, words, time_utc(self._last_us), *known, WGS_84)
        self._table.execute(f"INSERT INTO gpkg_contents VALUES (?{', ?' * 9})", about)
        columns = (name, "geom", kind, WGS_84, 0, 0)
        self._table.execute("INSERT INTO gpkg_geometry_columns VALUES (?, ?, ?, ?, ?, ?)", columns)


def _box_row(snapshot: Snapshot, box: Box) -> tuple[object, ...]:
    return (
        _geometry(struct.pack("<BIdd", 1, 1, box.lon_deg, box.lat_deg)) if placed(box) else None,
        time_utc(snapshot.t_us),
        snapshot.frame,
        box.track_id or None,
        box.system_id or None,
        plain(snapshot.name_of(box.system_id)) if box.system_id else None,
        _number(box.confidence),
        _number(box.place_std_m),
        _number(box.residual_m),
        box.stated,
        plain(may_be(snapshot, box)) or None,
    )


def _track_row(way: Way) -> tuple[object, ...]:
    summary = way.summary()
    places = chain.from_iterable(zip(way.lon_deg, way.lat_deg, strict=True))
    line = struct.pack(f"<BII{2 * len(way.t_us)}d", 1, 2, len(way.t_us), *places)
    return (
        _geometry(line, _bounds(way)),
        time_utc(way.t_us[0]),
        time_utc(way.t_us[-1]),
        len(way.t_us),
        way.track_id,
        way.system_id or None,
        way.name if way.system_id else None,
        *map(_number, (summary.confidence_mean, summary.confidence_min, summary.place_std_m_max)),
    )


def _geometry(wkb: bytes, bounds: _Bounds | None = None) -> bytes:
    """GeoPackage's own header (magic, version, flags, reference system, envelope) and a shape, all little endian."""
    envelope = struct.pack("<4d", bounds[0], bounds[2], bounds[1], bounds[3]) if bounds else b""
    return struct.pack("<2sBBi", b"GP", 0, 0b11 if bounds else 0b01, WGS_84) + envelope + wkb


def _bounds(way: Way) -> _Bounds:
    return min(way.lon_deg), min(way.lat_deg), max(way.lon_deg), max(way.lat_deg)


def _around(a: _Bounds, b: _Bounds) -> _Bounds:
    return min(a[0], b[0]), min(a[1], b[1]), max(a[2], b[2]), max(a[3], b[3])


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None
