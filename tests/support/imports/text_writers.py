"""Logs of receivers and of autopilots as text, by their published layouts."""

from __future__ import annotations

import datetime
import math
import struct
from functools import reduce
from operator import xor

from tests.support.imports.flown import Flown
from tests.support.imports.log_writers import DATAFLASH, SIZES, wire_places

SCALES = {"c": 0.01, "C": 0.01, "e": 0.01, "L": 1e-7}


def dataflash_text(data: bytes) -> str:
    """A binary ArduPilot log as Mission Planner writes it in text."""
    kinds = {kind: (name, chars) for name, (kind, chars, _) in DATAFLASH.items()}
    lines, at = [], 0
    while at < len(data):
        name, chars = kinds[data[at + 2]]
        layout = "<" + "".join(SIZES[char] for char in chars)
        cells = [
            value.rstrip(b"\0").decode() if isinstance(value, bytes) else _scaled(value, char)
            for value, char in zip(struct.unpack_from(layout, data, at + 3), chars, strict=True)
        ]
        lines.append(", ".join([name, *cells]))
        at += 3 + struct.calcsize(layout)
    return "\r\n".join(lines) + "\r\n"


def _scaled(value: float, char: str) -> str:
    if char == "L":
        return f"{value * SCALES[char]:.7f}"
    return f"{value * SCALES[char]:.2f}" if char in SCALES else repr(value)


def nmea(flown: Flown, system_id: int) -> str:
    """A receiver's sentences: each fix as GGA and RMC."""
    places, lines = wire_places(flown, system_id), []
    for k, t in enumerate(places["t_us"].tolist()):
        when = datetime.datetime.fromtimestamp(t // 1_000_000, datetime.UTC)
        clock = f"{when:%H%M%S}.{t % 1_000_000:06d}"
        place = f"{_minutes(places['lat'][k], 2, 'NS')},{_minutes(places['lon'][k], 3, 'EW')}"
        north, east = places["vn"][k], places["ve"][k]
        course = math.degrees(math.atan2(east, north)) % 360.0
        knots = math.hypot(north, east) * 3600.0 / 1852.0
        lines.append(sentence(f"GNGGA,{clock},{place},1,12,0.80,{places['alt_m'][k]:.3f},M,47.1,M,,"))
        lines.append(sentence(f"GNRMC,{clock},A,{place},{knots:.4f},{course:.3f},{when:%d%m%y},,,A"))
    return "".join(lines)


def sentence(body: str) -> str:
    """With its checksum."""
    return f"${body}*{reduce(xor, body.encode()):02X}\r\n"


def _minutes(degrees: float, digits: int, sides: str) -> str:
    whole, part = divmod(round(abs(degrees) * 60e8), 60 * 10**8)
    return f"{whole:0{digits}d}{part // 10**8:02d}.{part % 10**8:08d},{sides[int(degrees < 0.0)]}"


def kml(flown: Flown, system_ids: tuple[int, ...]) -> str:
    """KML with a ``gx:Track`` for each vehicle."""
    rows = [
        '<?xml version="1.0" encoding="UTF-8"?>\n<kml xmlns="http://www.opengis.net/kml/2.2" '
        'xmlns:gx="http://www.google.com/kml/ext/2.2"><Document><name>A day of 2025</name>\n'
    ]
    for system_id in system_ids:
        places = wire_places(flown, system_id)
        rows.append(f"<Placemark><name>UGV-{system_id}</name><gx:Track><altitudeMode>absolute</altitudeMode>\n")
        rows += [f"<when>{when(t)}</when>\n" for t in places["t_us"].tolist()]
        spots = zip(*(places[name].tolist() for name in ("lon", "lat", "alt_m")), strict=True)
        rows += [f"<gx:coord>{lon:.8f} {lat:.8f} {alt:.3f}</gx:coord>\n" for lon, lat, alt in spots]
        rows.append("</gx:Track></Placemark>\n")
    return "".join([*rows, "</Document></kml>\n"])


def when(t_us: int) -> str:
    """ISO 8601 of Unix µs."""
    at = datetime.datetime.fromtimestamp(t_us // 1_000_000, datetime.UTC)
    return f"{at:%Y-%m-%dT%H:%M:%S}.{t_us % 1_000_000:06d}Z"
