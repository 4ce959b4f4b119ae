"""GPX 1.1: a track for each vehicle and each stranger, a segment for each way, with times.

Confidence and 1σ stand in extensions, where the schema has room for them. Heights are unknown and left out.

Reference: https://www.topografix.com/GPX/1/1/.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final
from xml.sax.saxutils import escape

from gcs.export.maps.ways import Owners, Way, WaysExport, time_utc

NAMESPACE: Final = "urn:rollcall:export:1"
_HEAD: Final = f"""<?xml version="1.0" encoding="UTF-8"?>
<gpx version="1.1" creator="Rollcall" xmlns="http://www.topografix.com/GPX/1/1" xmlns:rollcall="{NAMESPACE}">
"""


class GpxExport(WaysExport):
    """Export of tracks to GPX; unknown values are left out."""

    def lines(self, name: str, owners: Owners) -> Iterator[str]:
        """Yield the lines of the file."""
        yield _HEAD
        starts = [way.t_us[0] for _, ways in owners for way in ways]
        time = f"<time>{time_utc(min(starts))}</time>" if starts else ""
        yield f"<metadata><name>{escape(name)}</name>{time}</metadata>\n"
        for title, ways in owners:
            yield from _track(title, ways)
        yield "</gpx>\n"


def _track(title: str, ways: list[Way]) -> Iterator[str]:
    yield f"<trk><name>{escape(title)}</name>"
    if ways[0].system_id:
        yield f"<extensions><rollcall:system_id>{ways[0].system_id}</rollcall:system_id></extensions>"
    for way in ways:
        yield "\n<trkseg>\n"
        yield from _points(way)
        yield "</trkseg>"
    yield "</trk>\n"


def _points(way: Way) -> Iterator[str]:
    columns = (way.t_us, way.lat_deg, way.lon_deg, way.confidence, way.place_std_m)
    for t_us, lat, lon, confidence, std_m in zip(*columns, strict=True):
        values = _element("confidence", confidence, 4) + _element("place_std_m", std_m, 3)
        extensions = f"<extensions>{values}</extensions>" if values else ""
        yield f'<trkpt lat="{lat:.7f}" lon="{lon:.7f}"><time>{time_utc(t_us)}</time>{extensions}</trkpt>\n'


def _element(name: str, value: float, digits: int) -> str:
    return f"<rollcall:{name}>{value:.{digits}f}</rollcall:{name}>" if math.isfinite(value) else ""
