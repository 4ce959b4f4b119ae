"""Telemetry logs, written."""

from __future__ import annotations

import os
import struct
from pathlib import Path
from types import TracebackType

from mavlink.errors import TlogError
from mavlink.packet import Packet

__all__ = ["TlogWriter"]

_TIME = struct.Struct(">Q")


class TlogWriter:
    """Appends packets to a new log, one system call each: what was accepted survives the death of the process.

    Args:
        path: must not exist; nothing recorded is ever overwritten.

    Raises:
        TlogError: the file exists or cannot be made.
    """

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0)
        try:
            self._fd = os.open(self.path, flags, 0o644)
        except FileExistsError:
            raise TlogError(f"{self.path}: exists already, and recordings are never overwritten") from None
        except OSError as error:
            raise TlogError(f"{self.path}: cannot be made: {error.strerror}") from error
        self.records = 0
        self._size = 0

    def write(self, packet: Packet) -> None:
        """Appends one packet.

        Raises:
            TlogError: the disk is full or gone; the log still ends with a whole record, and write may be tried again.
        """
        record = _TIME.pack(packet.t_us) + packet.raw
        try:
            written = os.write(self._fd, record)
            while written < len(record):
                written += os.write(self._fd, record[written:])
        except OSError as error:
            self._cut_torn_record()
            raise TlogError(f"{self.path}: cannot be written: {error.strerror}") from error
        self._size += len(record)
        self.records += 1

    def sync(self) -> None:
        """Waits until the disk has everything.

        Raises:
            TlogError: the disk says it has not.
        """
        try:
            os.fsync(self._fd)
        except OSError as error:
            raise TlogError(f"{self.path}: not safely on disk: {error.strerror}") from error

    def close(self) -> None:
        """Closes the file; closing twice does nothing."""
        if self._fd >= 0:
            os.close(self._fd)
            self._fd = -1

    def _cut_torn_record(self) -> None:
        try:
            os.ftruncate(self._fd, self._size)
        except OSError:
            return  # a reader skips a torn record; the write's own error is the one to report

    def __enter__(self) -> TlogWriter:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, tb: TracebackType | None) -> None:
        self.close()
