"""Which reader reads which file."""

from __future__ import annotations

from pathlib import Path

from gcs.errors import ImportFileError
from gcs.importing.formats.dji_srt import log_of_cues
from gcs.importing.formats.subtitles import read_cues
from gcs.importing.vehicle_log import VehicleLog

__all__ = ["read_uav"]


def read_uav(path: Path) -> VehicleLog:
    """The UAV's log, by the file's suffix.

    Raises:
        ImportFileError: no such file, or none that can be read.
    """
    suffix = path.suffix.lower()
    if suffix == ".srt":
        return log_of_cues(path.name, read_cues(path))
    raise ImportFileError(f"{path}: not a kind of file that is known; give .srt")
