"""The files of a recording, ``telemetry.tlog``, then ``telemetry.1.tlog``, …, and one while it is appended to."""

from __future__ import annotations

import contextlib
import errno
import os
from pathlib import Path

from infra.files.disk import Disk


def segment_path(path: Path, segment: int) -> Path:
    """``telemetry.tlog`` for segment 0, ``telemetry.1.tlog`` for segment 1."""
    return path.with_name(f"{path.stem}.{segment}{path.suffix}") if segment else path


def segments(path: Path) -> list[Path]:
    """All segments that exist of a recording, in the order they were written."""
    rest = path.parent.glob(f"{path.stem}.*{path.suffix}")
    numbered = [(int(number), file) for file in rest if (number := file.stem.removeprefix(f"{path.stem}.")).isdecimal()]
    return [path] * path.is_file() + [file for _, file in sorted(numbered) if file.is_file()]


class Segment:
    """A new file that holds whole rows and nothing else, as far as the disk lets it.

    Args:
        recording: path of the recording's first segment.
        number: which segment this is.
        disk: the operating system, or a test's.

    Attributes:
        number: which segment this is.
        size: bytes of its whole rows, with the header.

    Raises:
        OSError: the file exists or cannot be made.
    """

    def __init__(self, recording: Path, number: int, disk: Disk) -> None:
        self.number, self.size = number, 0
        self._path = segment_path(recording, number)
        self._disk = disk
        self._fd = disk.open(self._path)
        self._is_torn = self._is_name_synced = False

    def append(self, data: bytes) -> None:
        """Hand all bytes to the kernel, or leave the file as it was.

        Raises:
            OSError: the disk does not take them.
        """
        if self._is_torn:
            self._disk.ftruncate(self._fd, self.size)
            self._is_torn = False
        try:
            written = self._disk.write(self._fd, data)
            while written < len(data):
                more = self._disk.write(self._fd, data[written:])
                if not more:
                    raise OSError(errno.EIO, os.strerror(errno.EIO))
                written += more
        except OSError:
            self._cut()
            raise
        self.size += len(data)

    def sync(self) -> None:
        """Wait until the disk has all of it, and its name.

        Raises:
            OSError: it has not; the kernel reports it once and forgets what it could not write.
        """
        self._disk.fsync(self._fd)
        if not self._is_name_synced:
            self._disk.fsync_folder(self._path.parent)
            self._is_name_synced = True

    def check(self) -> None:
        """Look whether the file is still there and whole.

        Raises:
            OSError: it is not; ENOENT where it was deleted or moved.
        """
        size = self.size  # before the file is asked: it only grows
        if not self._disk.named(self._fd, self._path):
            raise OSError(errno.ENOENT, "deleted or moved while it was written")
        if (left := self._disk.size(self._fd)) < size:
            raise OSError(errno.EIO, f"cut short by another program, {size - left} bytes are gone")

    def read(self, size: int, offset: int) -> bytes:
        """Read bytes back, deleted or not."""
        return self._disk.read(self._fd, size, offset)

    def close(self) -> None:
        """Close the file; any error was raised by the sync before."""
        with contextlib.suppress(OSError):
            self._disk.close(self._fd)

    def _cut(self) -> None:
        """Cut the file back to the last whole row."""
        try:
            self._disk.ftruncate(self._fd, self.size)
        except OSError:
            self._is_torn = True  # tried again before the next row; a reader skips a torn one
