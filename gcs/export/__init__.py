"""Identity logs in forms that other people's tools read: one file per format, all fed with snapshots."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Protocol

from gcs.errors import GcsError
from gcs.export.csv import CsvExport
from gcs.export.jsonl import JsonlExport
from gcs.export.video import VideoExport
from gcs.snapshot import Snapshot

__all__ = ["FORMATS", "CsvExport", "Export", "JsonlExport", "VideoExport", "open_export"]


class Export(Protocol):
    """An open export file."""

    def write(self, snapshot: Snapshot) -> None:
        """Append one frame."""

    def close(self) -> None:
        """Finish the file."""


FORMATS: dict[str, Callable[[Path], Export]] = {"csv": CsvExport, "jsonl": JsonlExport, "mp4": VideoExport}


def open_export(form: str, path: Path) -> Export:
    """Open an export; the file must not exist yet.

    Raises:
        GcsError: no such format.
        SessionError: the file exists or cannot be written.
    """
    if form not in FORMATS:
        raise GcsError(f"no export format {form!r}; there are {', '.join(FORMATS)}")
    return FORMATS[form](path)
