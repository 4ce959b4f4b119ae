"""GPX tracks, versions 1.0 and 1.1: one vehicle a track, by its name, or all points of a file.

Schema: https://www.topografix.com/GPX/1/1/. Points need a time. A document type definition is refused: it may expand
to any size, and no GPX has one.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.parsers import expat

import numpy as np

from gcs.errors import ImportFileError
from gcs.importing.formats.text_file import open_file
from gcs.importing.row_times import NO_ZONE, row_times, unix_seconds
from gcs.importing.vehicle_log import ImportNotes, PlaceTrack, VehicleLog, whole_places
from infra.plain_text import plain

__all__ = ["read_gpx"]

_MOST_POINTS = 1_000_000
_MOST_TRACKS = 255
_MOST_TEXT, _MOST_DEPTH = 200, 64
_CHUNK = 1 << 16
_NUMBER = re.compile(r"(?<!\d)(\d{1,3})(?!.*\d)")
_DATES = re.compile(r"\d{5,}|\d{1,4}(?:[-._:/T]\d{1,2}){2,}")
"""Dates and times in a name: no number of a vehicle."""


@dataclass(slots=True)
class _GpxTrack:
    name: str = ""
    points: list[tuple[float, float, float, float]] = field(default_factory=list)
    """Unix seconds, latitude, longitude, metres above sea level."""


class _GpxReader:
    """Collects points as the parser meets them."""

    def __init__(self, path: Path) -> None:
        self.tracks: list[_GpxTrack] = []
        self.skipped: Counter[str] = Counter()
        self._path, self._count = path, 0
        self._open: list[str] = []
        self._text = ""
        self._place = (math.nan, math.nan)
        self._ele = self._time = math.nan
        self.zoneless = False

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        name = tag.rpartition(":")[2]
        self._open.append(name)
        if len(self._open) > _MOST_DEPTH:
            raise ImportFileError(f"{self._path}: nested too deeply for a GPX file")
        self._text = ""
        if name == "trk":
            if len(self.tracks) >= _MOST_TRACKS:
                raise ImportFileError(f"{self._path}: more than {_MOST_TRACKS} tracks")
            self.tracks.append(_GpxTrack())
        elif name == "trkpt":
            self._place = _number(attributes.get("lat", "")), _number(attributes.get("lon", ""))
            self._ele = self._time = math.nan

    def text(self, data: str) -> None:
        if len(self._text) < _MOST_TEXT:
            self._text += data

    def end(self, tag: str) -> None:
        name = self._open.pop()
        above = self._open[-1] if self._open else ""
        if name == "name" and above == "trk" and self.tracks:
            self.tracks[-1].name = plain(self._text.strip()[:_MOST_TEXT])
        elif name == "ele" and above == "trkpt":
            self._ele = _number(self._text)
        elif name == "time" and above == "trkpt":
            self._time, zoned = unix_seconds(self._text)
            self._time = self._time if self._time >= 0.0 else math.nan
            self.zoneless |= not zoned
        elif name == "trkpt" and self.tracks:
            self._add()
        self._text = ""

    def _add(self) -> None:
        self._count += 1
        if self._count > _MOST_POINTS:
            raise ImportFileError(f"{self._path}: more than {_MOST_POINTS} points; cut it where the flight ends")
        if not math.isfinite(self._time):
            self.skipped["points without a time"] += 1
        elif not whole_places(np.array([self._place[0]]), np.array([self._place[1]]))[0]:
            self.skipped["points that are no place"] += 1
        else:
            self.tracks[-1].points.append((self._time, *self._place, self._ele))

    def refuse(self, *_: Any) -> None:  # noqa: ANN401 - as the parser calls it
        raise ImportFileError(f"{self._path}: has a document type definition, which no GPX file has")


def read_gpx(path: Path) -> list[VehicleLog]:
    """The vehicles of a file: system ids are the last number in a track's name, 0 without one.

    Raises:
        ImportFileError: it cannot be read, is not XML, or has no point with a time.
    """
    reader, parser = _GpxReader(path), expat.ParserCreate()
    parser.StartElementHandler, parser.EndElementHandler = reader.start, reader.end
    parser.CharacterDataHandler, parser.StartDoctypeDeclHandler = reader.text, reader.refuse
    parser.buffer_text = True
    with open_file(path) as file:
        try:
            while chunk := file.read(_CHUNK):
                parser.Parse(chunk, False)
            parser.Parse(b"", True)
        except (expat.ExpatError, ValueError, LookupError) as error:
            if not any(track.points for track in reader.tracks):
                raise ImportFileError(f"{path}: not a GPX file: {error}") from None
            reader.skipped["ends in the middle"] += 1
    notes = ImportNotes(assumed=(NO_ZONE,) if reader.zoneless else (), skipped=reader.skipped)
    logs = [_log(path, track, notes) for track in reader.tracks if track.points]
    if not logs:
        raise ImportFileError(f"{path}: no track point with a place and a time in it")
    return logs


def _log(path: Path, track: _GpxTrack, notes: ImportNotes) -> VehicleLog:
    table = np.array(track.points)
    source = f"{path.name} ({track.name})" if track.name else path.name
    ordered = row_times(np.rint(table[:, 0] * 1e6).astype(np.int64), table[:, 1:3], source)
    table, number = table[ordered.rows], _NUMBER.search(_DATES.sub("", track.name))
    system_id = int(number.group(1)) if number else 0
    return VehicleLog(
        source=source,
        clock="utc",
        system_id=system_id if system_id <= 255 else 0,
        places=PlaceTrack.of(ordered.t_us, table[:, 1], table[:, 2], alt_m=table[:, 3]),
        notes=ImportNotes(
            found=(f"GPX track, {len(table)} points",),
            assumed=(*notes.assumed, *ordered.assumed),
            skipped={**notes.skipped, **ordered.skipped},
        ),
    )


def _number(text: str) -> float:
    try:
        value = float(text) if len(text) < 40 else math.nan
    except ValueError:
        return math.nan
    return value if math.isfinite(value) else math.nan
