"""KML: ``gx:Track``, points with a ``TimeStamp``, and lines of two points with a ``TimeSpan``.

Reference: OGC 12-007r2; https://developers.google.com/kml/documentation/kmlreference. A line of more points tells when
it begins and ends, but not when the vehicle was where on it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import zip_longest
from pathlib import Path

from gcs.importing.checks.row_times import NO_ZONE, unix_seconds
from gcs.importing.formats.point_tracks import MAX_POINTS, PointTracks, read_xml_tracks
from gcs.importing.vehicle_log import VehicleLog
from infra.text_numbers import number_or_nan

_MAX_TEXT = 400
"""Letters of a value: three coordinates of two points have less."""
_SHAPES = ("Point", "LineString", "Track")
_FOLDERS = ("Document", "Folder")
_Spot = tuple[float, float, float]
"""Latitude, longitude, altitude by the altitude mode."""
_NOWHERE = (math.nan, math.nan, math.nan)


class _KmlReader:
    """Collects points as the parser meets them."""

    def __init__(self, tracks: PointTracks) -> None:
        self._tracks = tracks
        self._folders: dict[int, str] = {}
        """Names of the folders that are open, by depth."""
        self._last: tuple[float, tuple[float, float]] = (math.nan, (math.nan, math.nan))
        self._begin_placemark()

    def _begin_placemark(self) -> None:
        self._name = self._shape = ""
        self._when = math.nan
        self._span = [math.nan, math.nan]
        self._coordinates = ""
        self._tracked = False
        self._begin_shape()

    def _begin_shape(self) -> None:
        self._mode = "clampToGround"
        self._times = list[float]()
        self._spots = list[tuple[_Spot, int]]()
        """Points of a track, and the line of each: how their altitudes count may stand behind them."""

    def ended(self, names: Sequence[str], _attributes: Mapping[str, str], text: str) -> None:
        """Take in an element."""
        name, above = names[-1], names[-2] if len(names) > 1 else ""
        if name == "name" and above == "Placemark":
            self._name = text
        elif name == "name" and above in _FOLDERS:
            self._folders[len(names) - 1] = text
        elif name == "altitudeMode":
            self._mode = text.strip()
        elif name in ("when", "begin", "end"):
            self._add_time(name, above, text)
        elif name == "coord":
            self._spots.append((_spot(text.split()), self._tracks.line))
            self._check_kept()
        elif name == "coordinates":
            self._coordinates = text
        elif name in _SHAPES:
            self._end_shape(name)
        elif name == "Placemark":
            self._end_placemark()
        elif name in _FOLDERS:
            self._end_loose()
            self._folders.pop(len(names), None)

    def _add_time(self, name: str, above: str, text: str) -> None:
        if above == "Track":
            self._times.append(self._seconds(text))
            self._check_kept()
        elif above == "TimeStamp":
            self._when = self._seconds(text)
        elif above == "TimeSpan" and name != "when":
            self._span[name == "end"] = self._seconds(text)

    def _seconds(self, text: str) -> float:
        seconds, zoned = unix_seconds(text)
        if not zoned:
            self._tracks.assumed[NO_ZONE] = None
        return seconds

    def _check_kept(self) -> None:
        """Let a track of too many points be refused before it ends."""
        if max(len(self._times), len(self._spots)) > MAX_POINTS:
            self.end_track()

    def _end_shape(self, shape: str) -> None:
        self._shape = shape
        if shape == "Track":
            self.end_track()

    def end_track(self) -> None:
        """Add the points of a track, once all that is said of them was read."""
        if not self._tracked and (self._times or self._spots):
            self._end_loose()
            self._tracks.name(self._name.strip() or self._folder())
            self._tracked = True
        nowhere = (_NOWHERE, self._tracks.line)
        for seconds, placed in zip_longest(self._times, self._spots):
            spot, self._tracks.line = placed or nowhere
            self._add(math.nan if seconds is None else seconds, spot)
        self._begin_shape()

    def _end_placemark(self) -> None:
        spots = [_spot(each.split(",")) for each in self._coordinates.split()]
        if self._tracked:
            self._tracks.end()
        elif self._shape == "Point":
            self._add(self._when, spots[0] if spots else _NOWHERE)
        elif self._shape == "LineString" and len(spots) == 2 and not any(map(math.isnan, self._span)):
            for seconds, spot in zip(self._span, spots, strict=True):
                # the next line begins where and when this one ends
                if (seconds, spot[:2]) != self._last:
                    self._add(seconds, spot)
        elif self._shape == "LineString":
            timed = "times at their ends alone" if not any(map(math.isnan, self._span)) else "no times"
            self._tracks.skipped[f"lines with {timed}"] += 1
        self._begin_placemark()

    def _end_loose(self) -> None:
        """End a track of points and lines that follow each other in a folder."""
        self._tracks.name(self._folder())
        self._tracks.end()
        self._last = (math.nan, (math.nan, math.nan))

    def _folder(self) -> str:
        return next(reversed(self._folders.values()), "")

    def _add(self, seconds: float, spot: _Spot) -> None:
        lat, lon, up = spot
        self._last = seconds, (lat, lon)
        if self._mode == "clampToGround" and up and math.isfinite(up):
            self._tracks.assumed["altitudes that are not drawn (clampToGround) are not known"] = None
        self._tracks.add(
            seconds,
            (lat, lon),
            alt_m=up if self._mode == "absolute" else math.nan,
            height_m=up if self._mode == "relativeToGround" else math.nan,
        )


def _spot(cells: Sequence[str]) -> _Spot:
    if len(cells) > 3:
        return _NOWHERE  # with decimal commas nobody knows which of them separate
    lon, lat, up = ([*map(number_or_nan, cells[:3])] + [math.nan] * 3)[:3]
    return lat, lon, up


def read_kml(path: Path) -> list[VehicleLog]:
    """The vehicles of a file: system ids are the last number in a track's name, 0 without one.

    Raises:
        ImportFileError: it cannot be read, is not XML, or has no point with a time.
    """
    tracks = PointTracks(path, "KML")
    reader = _KmlReader(tracks)
    return read_xml_tracks(path, "KML", tracks, reader.ended, _MAX_TEXT, reader.end_track)
