"""The reader of each file: a table, by how files begin, else by their suffix."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from gcs.errors import ImportFileError
from gcs.importing.checks.plausible import plausible
from gcs.importing.fleet_log import read_tlog_vehicles
from gcs.importing.formats.ardupilot_log import read_ardupilot
from gcs.importing.formats.csv_table import read_csv
from gcs.importing.formats.dataflash import is_dataflash
from gcs.importing.formats.dji_srt import log_of_cues
from gcs.importing.formats.gpx import read_gpx
from gcs.importing.formats.kml import read_kml
from gcs.importing.formats.nmea import is_nmea, read_nmea
from gcs.importing.formats.px4_log import read_px4
from gcs.importing.formats.subtitles import read_cues
from gcs.importing.formats.text_file import LOOKED_AT, open_file
from gcs.importing.vehicle_log import VehicleLog
from mavlink.tlog.file_type import looks_like

OTHERWISE: Final = {
    ".kmz": "a KML in a ZIP archive: unzip it and give the .kml that is in it",
    ".fit": "Garmin's FIT is not read: give a GPX made of it",
}
"""Suffixes of what is not read, and what to give instead."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LogFormat:
    """A kind of file that tells where vehicles were."""

    suffixes: tuple[str, ...]
    """Endings of file names in lower case, the usual one first."""
    read: Callable[[Path], list[VehicleLog]]
    begins: Callable[[bytes], bool] = lambda _: False
    """True if the beginning of a file is one of this format, whatever its suffix; never, where no beginning tells."""
    maker: str = ""


def _begins(*marks: bytes) -> Callable[[bytes], bool]:
    return lambda head: any(mark in head for mark in marks)


TLOG = LogFormat(suffixes=(".tlog", ".rlog", ".raw", ".mavlink"), read=read_tlog_vehicles)
"""Telemetry logs: frames are found in whatever lies around them, and where there are none that is told."""
FORMATS = (
    LogFormat(suffixes=(".srt",), maker="DJI", read=lambda path: [log_of_cues(path.name, read_cues(path))]),
    LogFormat(
        suffixes=(".bin", ".log"), maker="ArduPilot", begins=is_dataflash, read=lambda path: [read_ardupilot(path)]
    ),
    LogFormat(suffixes=(".ulg",), maker="PX4", begins=_begins(b"ULog\x01\x12\x35"), read=lambda path: [read_px4(path)]),
    TLOG,
    LogFormat(suffixes=(".gpx",), begins=_begins(b"<gpx"), read=read_gpx),
    LogFormat(suffixes=(".kml",), begins=_begins(b"<kml"), read=read_kml),
    LogFormat(suffixes=(".nmea",), begins=is_nmea, read=read_nmea),
    LogFormat(suffixes=(".csv", ".tsv", ".txt"), read=read_csv),
)
"""Tried in this order."""


def read_vehicle_logs(path: Path) -> list[VehicleLog]:
    """The vehicles in a file; the place in the file of each is the place in the list.

    Raises:
        ImportFileError, TlogError: no such file, or none that can be read.
    """
    return [plausible(log) for log in _format_of(path).read(path)]


def _format_of(path: Path) -> LogFormat:
    """Find the reader of a file by how it begins, else by its suffix.

    Raises:
        ImportFileError: no such file, or none that can be read.
    """
    suffix = path.suffix.lower()
    with open_file(path) as file:
        head = file.read(LOOKED_AT)
    if begun := [each for each in FORMATS if each.begins(head)]:
        return begun[0]
    known = [each for each in FORMATS if suffix in each.suffixes]
    other = looks_like(np.frombuffer(head, np.uint8))
    if other and suffix not in OTHERWISE and TLOG not in known:
        raise ImportFileError(f"{path}: it begins like {other}")
    if known:
        return known[0]
    kinds = [f"{each.suffixes[0]} ({each.maker})" if each.maker else each.suffixes[0] for each in FORMATS]
    why = OTHERWISE.get(suffix, "by its suffix not a log that can be read")
    raise ImportFileError(f"{path}: {why}; give {', '.join(kinds[:-1])} or {kinds[-1]}")
