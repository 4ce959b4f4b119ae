"""NMEA 0183 as receivers write it: GGA or GNS and RMC, with GST and ZDA where there are some; one vehicle a file.

Sentences of one time belong to one fix; RMC and ZDA tell the date.
"""

from __future__ import annotations

import math
import re
from datetime import UTC, datetime
from functools import reduce
from operator import xor
from pathlib import Path

from gcs.errors import ImportFileError
from gcs.importing.formats.point_tracks import PointTracks
from gcs.importing.formats.text_file import text_lines
from gcs.importing.vehicle_log import M_PER_HDOP, VehicleLog
from infra.text_numbers import number, number_or_nan

_SENTENCE = re.compile(r"\$([A-Z]{2})(GGA|GNS|RMC|GST|ZDA),([^*$]*)(?:\*([0-9A-Fa-f]{2})(?:[,;\s].*)?)?$")
_BEGIN = re.compile(r"\$[A-Z]{2}(?:GGA|GNS|RMC|GST|ZDA)\b")
_FIRST = re.compile(rb"(?:^|[\r\n])[^\r\n$]{0,40}\$[A-Z]{2}(?:GGA|GNS|RMC|GSA|GSV|GLL|VTG|GST|ZDA|TXT),")
_TIME = re.compile(r"([01]\d|2[0-3])([0-5]\d)([0-5]\d(?:\.\d{1,9})?)$", re.ASCII)
_DATE = re.compile(r"(\d\d)(\d\d)(\d\d)$", re.ASCII)
_MPS_PER_KNOT = 1852.0 / 3600.0
_DAY_S = 86_400.0
_MIN_FIELDS = {"GGA": 9, "GNS": 9, "RMC": 9, "GST": 7, "ZDA": 4}
_NAN2 = (math.nan, math.nan)


def is_nmea(head: bytes) -> bool:
    """Tell whether a file begins as one of a receiver; loggers may put something around each sentence."""
    return _FIRST.search(head) is not None


class _NmeaFix:
    """Fix that sentences of one time tell."""

    def __init__(self, time_s: float) -> None:
        self.time_s = time_s
        self.place = _NAN2
        self.alt_m = self.hdop = self.std_m = math.nan
        self.v_mps = _NAN2
        self.valid = False
        self.heard: set[str] = set()


class _NmeaReader:
    """Puts sentences together."""

    def __init__(self, tracks: PointTracks) -> None:
        self._tracks = tracks
        self._fix = _NmeaFix(math.nan)
        self._date = _NAN2
        """Unix seconds of midnight, and the time of day at which it was reported."""

    def take(self, line: str) -> None:
        """Read the next line."""
        found = _SENTENCE.search(line)
        self._tracks.skipped["sentences that are cut off"] += len(_BEGIN.findall(line)) - (found is not None)
        if found is None:
            return
        talker, kind, body, check = found.groups()
        if check is not None and reduce(xor, f"{talker}{kind},{body}".encode("utf-8", "replace")) != int(check, 16):
            self._tracks.skipped["sentences with a wrong checksum"] += 1
            return
        fields = body.split(",")
        time_s = _time_s(fields[0])
        if len(fields) < _MIN_FIELDS[kind] or math.isnan(time_s):
            self._tracks.skipped["sentences without a time"] += 1
            return
        if time_s != self._fix.time_s or kind in self._fix.heard:
            self.end_fix()
            self._fix = _NmeaFix(time_s)
        self._fix.heard.add(kind)
        if kind in ("GGA", "GNS"):
            self._position(fields)
        elif kind == "RMC":
            self._recommended(fields)
        elif kind == "GST":
            self._fix.std_m = math.hypot(number_or_nan(fields[5]), number_or_nan(fields[6])) / math.sqrt(2.0)
        else:
            self._dated(fields[1], fields[2], fields[3])

    def _position(self, fields: list[str]) -> None:
        if fields[5].strip("0N"):
            fix = self._fix
            fix.valid, fix.place = True, _place(fields[1:5])
            fix.hdop, fix.alt_m = number_or_nan(fields[7]), number_or_nan(fields[8])

    def _recommended(self, fields: list[str]) -> None:
        if date := _DATE.match(fields[8]):
            day, month, year = date.groups()
            self._dated(day, month, ("20" if year < "80" else "19") + year)
        if fields[1] == "A":
            fix, speed = self._fix, number_or_nan(fields[6]) * _MPS_PER_KNOT
            fix.place = fix.place if fix.valid else _place(fields[2:6])
            fix.valid = True
            course = math.radians(number_or_nan(fields[7]))
            # receivers that stand tell no course
            fix.v_mps = (0.0, 0.0) if speed == 0.0 else (speed * math.cos(course), speed * math.sin(course))

    def _dated(self, day: str, month: str, year: str) -> None:
        try:
            when = [int(number(part)) for part in (year, month, day)]
            midnight = datetime(when[0], when[1], when[2], tzinfo=UTC).timestamp()
        except (ValueError, OverflowError):
            # empty before the first fix
            self._tracks.skipped["dates that cannot be"] += bool(day or month or year)
            return
        self._date = midnight, self._fix.time_s

    def end_fix(self) -> None:
        """Keep the fix once all sentences of a time were read."""
        fix = self._fix
        if not fix.heard & {"GGA", "GNS", "RMC"}:
            return
        if not fix.valid:
            self._tracks.skipped["times without a fix"] += 1
            return
        midnight, date_s = self._date
        # the date may have been told before midnight
        days = round((date_s - fix.time_s) / _DAY_S) if math.isfinite(date_s) else 0
        std_m = fix.std_m if fix.std_m > 0.0 else M_PER_HDOP * fix.hdop
        self._tracks.add(
            midnight + days * _DAY_S + fix.time_s, fix.place, alt_m=fix.alt_m, std_m=std_m, v_mps=fix.v_mps
        )


def _time_s(text: str) -> float:
    found = _TIME.match(text)
    if found is None:
        return math.nan
    hours, minutes, seconds = found.groups()
    return int(hours) * 3600.0 + int(minutes) * 60.0 + float(seconds)


def _place(cells: list[str]) -> tuple[float, float]:
    """Degrees of ``ddmm.mmm, N, dddmm.mmm, E``."""
    found = []
    for text, side, negative in ((cells[0], cells[1], "S"), (cells[2], cells[3], "W")):
        value = number_or_nan(text)
        degrees = math.trunc(value / 100.0) if math.isfinite(value) else 0
        minutes = value - 100.0 * degrees
        angle = degrees + minutes / 60.0 if 0.0 <= minutes < 60.0 and side else math.nan
        found.append(-angle if side == negative else angle)
    return found[0], found[1]


def read_nmea(path: Path) -> list[VehicleLog]:
    """The vehicle of a file, without a system id.

    Raises:
        ImportFileError: it cannot be read, or has no position with a date.
    """
    tracks = PointTracks(path, "NMEA 0183")
    reader = _NmeaReader(tracks)
    for tracks.line, line in enumerate(text_lines(path)):
        # a fix is whole once the line behind it is read
        reader.take(line)
    reader.end_fix()
    if not len(tracks) and tracks.skipped["points without a time"]:
        raise ImportFileError(f"{path}: nothing in it tells the date: record RMC or ZDA beside GGA")
    tracks.skipped = +tracks.skipped
    return tracks.logs()
