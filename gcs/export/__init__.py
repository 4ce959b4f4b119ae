"""Identity logs in forms that other people's tools read: one file per format, all fed with snapshots."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar, Protocol

from gcs.errors import GcsError
from gcs.export.csv import CsvExport
from gcs.export.jsonl import JsonlExport
from gcs.export.video import VideoExport
from gcs.snapshot import Snapshot

__all__ = ["FORMATS", "CsvExport", "Export", "JsonlExport", "VideoExport", "export_format"]


class Export(Protocol):
    """An open export file."""

    needs_images: ClassVar[bool]
    """Whether snapshots must come with their frame's image: decoding takes longer than all the rest."""

    def __init__(self, path: Path) -> None:
        """Open a file that does not exist yet."""

    def write(self, snapshot: Snapshot) -> None:
        """Append one frame."""

    def close(self) -> None:
        """Finish the file."""


FORMATS: dict[str, type[Export]] = {"csv": CsvExport, "jsonl": JsonlExport, "mp4": VideoExport}


def export_format(name: str) -> type[Export]:
    """The export of that name; to be opened with the path of a new file.

    Raises:
        GcsError: no such format.
    """
    if name not in FORMATS:
        raise GcsError(f"no export format {name!r}; there are {', '.join(FORMATS)}")
    return FORMATS[name]
