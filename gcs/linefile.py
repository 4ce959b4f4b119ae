"""A text file of a flight: its lines outlive a full or failing disk, as the telemetry's records do."""

from __future__ import annotations

from pathlib import Path

from gcs.errors import SessionError
from mavlink.append import AppendFile
from mavlink.disk import OS_DISK, Disk
from mavlink.record_state import RecordState

__all__ = ["LineFile"]

RAM_BYTES = 16 << 20
"""Over a minute of the evidence of twenty boxes at thirty frames a second."""


class LineFile:
    """Takes whole lines; only making the file can fail.

    Args:
        path: must not exist; nothing recorded is ever overwritten.
        header: first line of every segment, with its line end.
        disk: the operating system, or a test's.

    Raises:
        SessionError: the file exists or cannot be made.
    """

    def __init__(self, path: Path, header: str = "", *, disk: Disk = OS_DISK) -> None:
        try:
            self.file = AppendFile(path, header=header.encode(), ram_bytes=RAM_BYTES, disk=disk)
        except OSError as error:
            raise SessionError(f"{path}: cannot be made: {error.strerror}; choose another place") from error

    def write(self, text: str, /) -> None:
        """Append whole lines."""
        if text:
            self.file.write(text.encode(errors="replace"), text.count("\n"))

    def flush(self) -> None:
        """Do nothing: what was written is with the system already."""

    def close(self) -> None:
        """Write what still waits and let go; ``state`` then tells what was lost."""
        self.file.close()

    @property
    def state(self) -> RecordState:
        """How it is doing."""
        return self.file.state
