"""Which reader reads which file."""

from __future__ import annotations

from pathlib import Path

from gcs.errors import ImportFileError
from gcs.importing.formats.ardupilot_log import read_ardupilot
from gcs.importing.formats.csv_table import read_csv
from gcs.importing.formats.dji_srt import log_of_cues
from gcs.importing.formats.gpx import read_gpx
from gcs.importing.formats.px4_log import read_px4
from gcs.importing.formats.subtitles import read_cues
from gcs.importing.plausible import plausible
from gcs.importing.tlog_vehicles import read_tlog_vehicles
from gcs.importing.vehicle_log import VehicleLog

__all__ = ["read_vehicle_logs"]

_TABLES = (".csv", ".tsv", ".txt")
KINDS = ".srt (DJI), .bin (ArduPilot), .ulg (PX4), .tlog, .csv or .gpx"


def read_vehicle_logs(path: Path) -> list[VehicleLog]:
    """The vehicles in a file, by the file's suffix; the place in the file of each is the place in the list.

    Raises:
        ImportFileError, TlogError: no such file, or none that can be read.
    """
    return [plausible(log) for log in _logs(path)]


def _logs(path: Path) -> list[VehicleLog]:
    suffix = path.suffix.lower()
    if suffix == ".srt":
        return [log_of_cues(path.name, read_cues(path))]
    if suffix == ".bin":
        return [read_ardupilot(path)]
    if suffix == ".ulg":
        return [read_px4(path)]
    if suffix == ".tlog":
        return read_tlog_vehicles(path)
    if suffix in _TABLES:
        return read_csv(path)
    if suffix == ".gpx":
        return read_gpx(path)
    raise ImportFileError(f"{path}: by its suffix not a log that can be read; give {KINDS}")
