"""One subtitle of a DJI or Autel drone: what its text says, in whichever of the published layouts it is.

    keyed        [latitude: 41.4247] [longitude: 2.2341] [rel_alt: 15.1 abs_alt: 127.6] [gb_yaw: −12.3 gb_pitch: −45 …]
                 spelled ``longtitude`` by some; [altitude: …] alone by others; focal_len 24.00, or 240 in tenths
                 [drone_yaw: … drone_pitch: … drone_roll: …] or [Drone: Yaw:…, Pitch:…, Roll:…] of the body
    positional   F/2.8, SS 206, ISO 100, EV 0, GPS (lon, lat, satellites), D 24.1m, H 45.0m, H.S 0.0m/s, V.S 0.0m/s
                 with HOME (lon, lat, altitude), F.PRY (…) of the body and G.PRY (…) of the gimbal, or RTK for GPS
    barometer    HOME(lon,lat) 2017.07.29 15:18:50 / GPS(lon,lat,satellites) BAROMETER:0.5
    metres       GPS(lat,lon,0.0M) BAROMETER:0.3M: with the unit the latitude comes first (Matrice 300)
    letters      GPS(W: 109.339287, N: 40.768574, 2371.76m): an altitude above the sea in metres (Autel Evo II)

Sources: the samples beside JuanIrache/DJI_SRT_Parser, and what users of other readers quote.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from datetime import UTC, datetime

_NUMBER = r"[-+]?[0-9]{1,9}+(?:[.,][0-9]{1,12}+)?+"
_KEYED = re.compile(rf"\b([a-z_]{{2,16}})\s*:\s*({_NUMBER})(?=m{{0,2}}(?![\w/]))", re.IGNORECASE)
_BLOCK = re.compile(r"\b(drone|gimbal)\s?:\s?([a-z][^\[\]<]{4,80})", re.IGNORECASE)
_TUPLE = re.compile(r"\b(GPS|RTK|HOME|F\.PRY|G\.PRY)\s{0,4}\(([^()]{3,80})\)", re.IGNORECASE)
_BAROMETER = re.compile(rf"\bBAROMETER\s*[:(]\s*({_NUMBER})", re.IGNORECASE)
_HEIGHT = re.compile(rf"(?:^|[\s,])H:?\s?({_NUMBER})\s?m\b")
_PLAIN = re.compile(r"[-+]?[0-9]{1,9}(?:\.[0-9]{1,12})?")
_WITH_COMMAS = re.compile(r"[-+]?[0-9]{1,9}(?:,[0-9]{1,12})?")
_LETTERED = re.compile(r"\b([NSEW]):?\s?([0-9]{1,9}(?:\.[0-9]{1,12})?)", re.IGNORECASE)
_METRES = re.compile(r"[0-9]\s?m\s*$", re.IGNORECASE)
_DATE = re.compile(
    r"\b(\d{4})[-./](\d{1,2})[-./](\d{1,2})[ T]+(\d{1,2}):(\d{1,2}):(\d{1,2})(?:[.,:](\d{1,3}))?(?:[.,](\d{1,3}))?",
    re.ASCII,
)
_TENTHS_FROM = 100.0
"""Focal length from which on a number without a decimal point is in tenths of millimetres."""
_SHORTEST_MM, _LONGEST_MM = 4.0, 5000.0


@dataclass(frozen=True, slots=True, kw_only=True)
class DjiCue:
    """Numbers of one subtitle, NaN where it has none; angles in degrees."""

    family: str
    lat_deg: float
    lon_deg: float
    decimals: int
    """Digits behind the point of the coordinates."""
    alt_m: float = math.nan
    height_m: float = math.nan
    gimbal_deg: tuple[float, float, float] = (math.nan,) * 3
    """Roll, pitch, yaw from north."""
    body_deg: tuple[float, float, float] = (math.nan,) * 3
    focal_mm: float = math.nan
    """Equivalent on 36 × 24 mm."""
    zoom: float = 1.0
    """Factor of the digital zoom."""
    unix_us: int = 0
    """Date of the cue taken as UTC, 0 without one."""


def read_cue(text: str) -> DjiCue | None:
    """Read the numbers of a subtitle; None without a position."""
    keyed = {name.lower(): value for name, value in _KEYED.findall(text)}
    for whose, angles in _BLOCK.findall(text):
        keyed |= {f"{whose.lower()}_{name.lower()}": value for name, value in _KEYED.findall(angles)}
    lat, lon = keyed.get("latitude"), keyed.get("longitude") or keyed.get("longtitude")
    tuples = {name.upper(): value for name, value in _TUPLE.findall(text)}
    if lat and lon:
        return _keyed(keyed, lat, lon, text)
    return _positional(tuples, text)


def _keyed(keyed: dict[str, str], lat: str, lon: str, text: str) -> DjiCue:
    def number(*names: str) -> float:
        return next((_value(keyed[name]) for name in names if name in keyed), math.nan)

    gimbal = [number(f"gb_{name}", f"gimbal_{name}") for name in ("roll", "pitch", "yaw")]
    body = [number(f"drone_{name}") for name in ("roll", "pitch", "yaw")]
    of = [name for name, angles in (("gimbal", gimbal), ("body", body)) if math.isfinite(angles[1])]
    return DjiCue(
        family=f"keyed, with the angles of the {' and the '.join(of)}" if of else "keyed",
        lat_deg=_value(lat),
        lon_deg=_value(lon),
        decimals=min(_decimals(lat), _decimals(lon)),
        alt_m=number("abs_alt", "altitude"),
        height_m=number("rel_alt"),
        gimbal_deg=(gimbal[0], gimbal[1], gimbal[2]),
        body_deg=(body[0], body[1], body[2]),
        focal_mm=_focal_mm(keyed.get("focal_len", "")),
        zoom=_zoom(keyed.get("dzoom_ratio", keyed.get("dzoom", ""))),
        unix_us=_unix_us(text),
    )


def _positional(tuples: dict[str, str], text: str) -> DjiCue | None:
    place = tuples.get("GPS") or tuples.get("RTK") or ""
    values = _values(place)
    if len(values) < 2:
        return None
    letters = {letter.upper(): value for letter, value in _LETTERED.findall(place)}
    if letters.keys() & {"N", "S"} and letters.keys() & {"E", "W"}:
        return _with_letters(letters, values, tuples, text)
    # the third number is how many satellites there are, or with the unit an altitude, which stays at 0
    metres = bool(_METRES.search(place))
    first, second = values[0], values[1]
    home, body, gimbal = (_values(tuples.get(name, "")) for name in ("HOME", "F.PRY", "G.PRY"))
    barometer, above = _BAROMETER.search(text), _HEIGHT.search(text)
    height = _value(barometer.group(1)) if barometer else _value(above.group(1)) if above else math.nan
    home_alt = _value(home[2]) if len(home) == 3 else math.nan
    family = "metres" if metres else "barometer" if barometer else "positional"
    if len(gimbal) == 3:
        family += ", with the gimbal's angles"
    return DjiCue(
        family=family,
        lat_deg=_value(first if metres else second),
        lon_deg=_value(second if metres else first),
        decimals=min(_decimals(first), _decimals(second)),
        alt_m=home_alt + height,
        height_m=height,
        gimbal_deg=_from_pry(gimbal),
        body_deg=_from_pry(body),
        unix_us=_unix_us(text),
    )


def _with_letters(letters: dict[str, str], values: list[str], tuples: dict[str, str], text: str) -> DjiCue:
    lat, lon = letters.get("N") or f"-{letters['S']}", letters.get("E") or f"-{letters['W']}"
    body, gimbal = (_values(tuples.get(name, "")) for name in ("F.PRY", "G.PRY"))
    return DjiCue(
        family="letters, with the gimbal's angles" if len(gimbal) == 3 else "letters",
        lat_deg=_value(lat),
        lon_deg=_value(lon),
        decimals=min(_decimals(lat), _decimals(lon)),
        alt_m=_value(values[2]) if len(values) == 3 else math.nan,
        gimbal_deg=_from_pry(gimbal),
        body_deg=_from_pry(body),
        unix_us=_unix_us(text),
    )


def _from_pry(values: list[str]) -> tuple[float, float, float]:
    """Roll, pitch, yaw from pitch, roll, yaw."""
    if len(values) != 3:
        return (math.nan,) * 3
    pitch, roll, yaw = map(_value, values)
    return roll, pitch, yaw


def _values(text: str) -> list[str]:
    """Numbers in brackets; without any point commas are those of decimals where a space or semicolon separates."""
    commas = "." not in text and re.search(r"\d,\d+\s*(?:[;,]\s|$)", text)
    return (_WITH_COMMAS if commas else _PLAIN).findall(text)


def _value(text: str) -> float:
    return float(text.replace(",", "."))


def _decimals(text: str) -> int:
    return len(text.replace(",", ".").partition(".")[2])


def _focal_mm(text: str) -> float:
    if not text:
        return math.nan
    value = _value(text)
    if _decimals(text) == 0 and value >= _TENTHS_FROM:
        value /= 10.0
    return value if _SHORTEST_MM <= value <= _LONGEST_MM else math.nan


def _zoom(text: str) -> float:
    """Digital zoom; written as 1.00, or as 10000 for one."""
    value = _value(text) if text else 1.0
    value = value / 10_000.0 if value >= 1000.0 else value
    return value if value >= 1.0 else 1.0


def _unix_us(text: str) -> int:
    date = _DATE.search(text)
    if date is None:
        return 0
    year, month, day, hour, minute, second, milli, micro = date.groups()
    try:
        when = datetime(int(year), int(month), int(day), int(hour), int(minute), int(second), tzinfo=UTC)
    except ValueError:
        return 0
    part_us = int((milli or "0").ljust(3, "0")) * 1000 + int((micro or "0").ljust(3, "0"))
    return max(0, round(when.timestamp()) * 1_000_000 + part_us)
