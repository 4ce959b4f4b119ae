"""GeoJSON (RFC 7946): each box a point, each way a line, WGS-84.

Features are told apart by their property ``layer``, ``box`` or ``track``. A line has its times, confidences and 1σ for
each of its positions in ``coordinateProperties``, the place that converters of GPX and KML use.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable

from gcs.export.job import ExportJob
from gcs.export.maps.ways import Way, Ways, placed, time_utc
from gcs.export.unfinished import Unfinished
from gcs.missing import may_be
from gcs.session.line_file import open_new
from gcs.snapshot import Box, Snapshot
from infra.plain_text import plain


class GeoJsonExport:
    """Export to GeoJSON; null is unknown, and a box of which no place is known has no geometry."""

    def __init__(self, job: ExportJob) -> None:
        self._unfinished = Unfinished(job.path)
        self._file = open_new(self._unfinished.path, '{"type": "FeatureCollection", "features": [')
        self._before = "\n"
        self._ways = Ways()

    def write(self, snapshot: Snapshot) -> None:
        """Append the boxes seen in a frame."""
        self._ways.add(snapshot)
        for box in snapshot.new_boxes:
            if not box.coasting:
                at = [round(box.lon_deg, 7), round(box.lat_deg, 7)] if placed(box) else None
                self._feature("Point", at, _box(snapshot, box))

    def close(self) -> None:
        """Append the lines and finish the file."""
        for way in self._ways:
            if len(way.t_us) > 1:
                line = [[round(lon, 7), round(lat, 7)] for lon, lat in zip(way.lon_deg, way.lat_deg, strict=True)]
                self._feature("LineString", line, _track(way))
        self._file.write("\n]}\n")
        self._file.close()
        self._unfinished.finish()

    def _feature(self, kind: str, coordinates: object, properties: dict[str, object]) -> None:
        shape = {"type": kind, "coordinates": coordinates} if coordinates is not None else None
        feature = {"type": "Feature", "geometry": shape, "properties": properties}
        self._file.write(self._before + json.dumps(feature, allow_nan=False))
        self._before = ",\n"


def _box(snapshot: Snapshot, box: Box) -> dict[str, object]:
    return {
        "layer": "box",
        "time_utc": time_utc(snapshot.t_us),
        "frame": snapshot.frame,
        "track_id": box.track_id or None,
        "system_id": box.system_id or None,
        "name": plain(snapshot.name_of(box.system_id)) if box.system_id else None,
        "confidence": _number(box.confidence, 4),
        "place_std_m": _number(box.place_std_m, 3),
        "residual_m": _number(box.residual_m, 3),
        "stated": box.stated,
        "may_be": plain(may_be(snapshot, box)) or None,
    }


def _track(way: Way) -> dict[str, object]:
    summary = way.summary()
    return {
        "layer": "track",
        "track_id": way.track_id,
        "system_id": way.system_id or None,
        "name": way.name if way.system_id else None,
        "first_utc": time_utc(way.t_us[0]),
        "last_utc": time_utc(way.t_us[-1]),
        "confidence_mean": _number(summary.confidence_mean, 4),
        "confidence_min": _number(summary.confidence_min, 4),
        "place_std_m_max": _number(summary.place_std_m_max, 3),
        "coordinateProperties": {
            "times": [time_utc(t_us) for t_us in way.t_us],
            "confidence": _column(way.confidence, 4),
            "place_std_m": _column(way.place_std_m, 3),
        },
    }


def _column(values: Iterable[float], digits: int) -> list[float | None]:
    return [_number(value, digits) for value in values]


def _number(value: float, digits: int) -> float | None:
    return round(value, digits) + 0.0 if math.isfinite(value) else None
