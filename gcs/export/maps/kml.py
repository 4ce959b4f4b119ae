"""KML 2.2 with Google's ``gx:Track``: each vehicle in its colour, with times, so that map programs can play them.

Reference: OGC 07-147r2; https://developers.google.com/kml/documentation/kmlreference#gxtrack.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import Final
from xml.sax.saxutils import escape

from gcs.export.maps.ways import Owners, Way, WaysExport, time_utc

COLOURS: Final = ("e69f00", "56b4e9", "009e73", "f0e442", "0072b2", "d55e00", "cc79a7")
"""Colours that everybody can tell apart (Okabe and Ito 2008), red green blue; with more vehicles they start again."""
STRANGER: Final = "999999"
_HEAD: Final = """<?xml version="1.0" encoding="UTF-8"?>
<kml xmlns="http://www.opengis.net/kml/2.2" xmlns:gx="http://www.google.com/kml/ext/2.2">
<Document>
"""
_SCHEMA: Final = """<Schema id="seen">
<gx:SimpleArrayField name="confidence" type="float"><displayName>confidence</displayName></gx:SimpleArrayField>
<gx:SimpleArrayField name="place_std_m" type="float"><displayName>1σ of the place, m</displayName></gx:SimpleArrayField>
</Schema>
"""


class KmlExport(WaysExport):
    """Export to KML; an empty value is unknown."""

    def lines(self, name: str, owners: Owners) -> Iterator[str]:
        """Yield the lines of the file."""
        yield f"{_HEAD}<name>{escape(name)}</name>\n"
        yield from map(_style_rule, dict.fromkeys(_style(ways[0]) for _, ways in owners))
        yield _SCHEMA
        for title, ways in owners:
            yield from _placemark(title, ways)
        yield "</Document>\n</kml>\n"


def _style(way: Way) -> str:
    """Return the style of a vehicle's colour, which is the same in all exports."""
    return COLOURS[(way.system_id - 1) % len(COLOURS)] if way.system_id else STRANGER


def _style_rule(colour: str) -> str:
    red, green, blue = colour[:2], colour[2:4], colour[4:]
    ink = f"<color>ff{blue}{green}{red}</color>"  # alpha blue green red
    line = f"<LineStyle>{ink}<width>3</width></LineStyle>"
    return f'<Style id="c{colour}"><IconStyle>{ink}</IconStyle><LabelStyle>{ink}</LabelStyle>{line}</Style>\n'


def _placemark(title: str, ways: list[Way]) -> Iterator[str]:
    yield f"<Placemark><name>{escape(title)}</name><styleUrl>#c{_style(ways[0])}</styleUrl>\n<ExtendedData>"
    if ways[0].system_id:
        yield f'<Data name="system_id"><value>{ways[0].system_id}</value></Data>'
    tracks = ",".join(str(track) for track in dict.fromkeys(way.track_id for way in ways))
    yield f'<Data name="track_id"><value>{tracks}</value></Data></ExtendedData>\n'
    yield "<gx:MultiTrack><altitudeMode>clampToGround</altitudeMode><gx:interpolate>0</gx:interpolate>\n"
    for way in ways:
        yield "<gx:Track><altitudeMode>clampToGround</altitudeMode>\n"
        yield from (f"<when>{time_utc(t_us)}</when>\n" for t_us in way.t_us)
        places = zip(way.lon_deg, way.lat_deg, strict=True)
        yield from (f"<gx:coord>{lon:.7f} {lat:.7f} 0</gx:coord>\n" for lon, lat in places)
        yield '<ExtendedData><SchemaData schemaUrl="#seen">\n'
        yield from _array("confidence", way.confidence, 4)
        yield from _array("place_std_m", way.place_std_m, 3)
        yield "</SchemaData></ExtendedData>\n</gx:Track>\n"
    yield "</gx:MultiTrack></Placemark>\n"


def _array(name: str, values: Iterable[float], digits: int) -> Iterator[str]:
    yield f'<gx:SimpleArrayData name="{name}">\n'
    for value in values:
        yield f"<gx:value>{f'{value:.{digits}f}' if math.isfinite(value) else ''}</gx:value>\n"
    yield "</gx:SimpleArrayData>\n"
