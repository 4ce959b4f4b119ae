"""GPX tracks, versions 1.0 and 1.1: one vehicle a track, by its name.

Schema: https://www.topografix.com/GPX/1/1/. Points need a time.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from gcs.importing.checks.row_times import NO_ZONE, unix_seconds
from gcs.importing.formats.point_tracks import PointTracks, read_xml_tracks
from gcs.importing.vehicle_log import VehicleLog
from infra.text_numbers import number_or_nan

_MAX_TEXT = 200


class _GpxReader:
    """Collects points as the parser meets them."""

    def __init__(self, tracks: PointTracks) -> None:
        self._tracks = tracks
        self._ele = self._time = math.nan

    def ended(self, names: Sequence[str], attributes: Mapping[str, str], text: str) -> None:
        name, above = names[-1], names[-2] if len(names) > 1 else ""
        if name == "name" and above == "trk":
            self._tracks.name(text)
        elif name == "ele" and above == "trkpt":
            self._ele = number_or_nan(text)
            self._tracks.skipped["altitudes that are no numbers"] += bool(text.strip() and math.isnan(self._ele))
        elif name == "time" and above == "trkpt":
            self._time, zoned = unix_seconds(text)
            if not zoned:
                self._tracks.assumed[NO_ZONE] = None
        elif name == "trkpt":
            place = number_or_nan(attributes.get("lat", "")), number_or_nan(attributes.get("lon", ""))
            self._tracks.add(self._time, place, alt_m=self._ele)
            self._ele = self._time = math.nan
        elif name == "trk":
            self._tracks.end()
        elif name in ("wpt", "rtept"):
            self._tracks.skipped["points that are of no track"] += 1


def read_gpx(path: Path) -> list[VehicleLog]:
    """The vehicles of a file: system ids are the last number in a track's name, 0 without one.

    Raises:
        ImportFileError: it cannot be read, is not XML, or has no point with a time.
    """
    tracks = PointTracks(path, "GPX track")
    return read_xml_tracks(path, "GPX", tracks, _GpxReader(tracks).ended, _MAX_TEXT)
