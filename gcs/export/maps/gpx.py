"""GPX 1.1: a track for each vehicle and each stranger, a segment for each way, with times.

Confidence and 1σ stand in extensions, where the schema has room for them. Heights are unknown and left out.

Reference: https://www.topografix.com/GPX/1/1/.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final
from xml.sax.saxutils import escape

from gcs.export.job import ExportJob
from gcs.export.maps.ways import Way, Ways, by_owner, time_utc
from gcs.export.unfinished import Unfinished
from gcs.session.line_file import open_new
from gcs.snapshot import Snapshot
from infra.plain_text import plain

NAMESPACE: Final = "urn:rollcall:export:1"
_HEAD: Final = f"""<?xml version="1.0" encoding="UTF-8"?>
<gpx version="1.1" creator="Rollcall" xmlns="http://www.topografix.com/GPX/1/1" xmlns:rollcall="{NAMESPACE}">
"""


class GpxExport:
    """Tracks as GPX; the unknown is left out."""

    def __init__(self, job: ExportJob) -> None:
        self._unfinished = Unfinished(job.path)
        self._name = plain(job.name)
        self._ways = Ways()

    def write(self, snapshot: Snapshot) -> None:
        """Continue lines by the boxes seen in a frame."""
        self._ways.add(snapshot)

    def close(self) -> None:
        """Write the file."""
        owners = by_owner(self._ways)
        with open_new(self._unfinished.path, _HEAD) as file:
            starts = [way.t_us[0] for way in self._ways]
            time = f"<time>{time_utc(min(starts))}</time>" if starts else ""
            file.write(f"<metadata><name>{escape(self._name)}</name>{time}</metadata>\n")
            for title, ways in owners:
                file.writelines(_track(title, ways))
            file.write("</gpx>\n")
        self._unfinished.finish()


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
        told = _element("confidence", confidence, 4) + _element("place_std_m", std_m, 3)
        extensions = f"<extensions>{told}</extensions>" if told else ""
        yield f'<trkpt lat="{lat:.7f}" lon="{lon:.7f}"><time>{time_utc(t_us)}</time>{extensions}</trkpt>\n'


def _element(name: str, value: float, digits: int) -> str:
    return f"<rollcall:{name}>{value:.{digits}f}</rollcall:{name}>" if math.isfinite(value) else ""
