"""Calls of a recording to the operating system, in one place: tests put a failing disk here."""

from __future__ import annotations

import errno
import os
from pathlib import Path

from infra.files.safe_open import open_folder

OF_THE_DISK = frozenset((errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EIO, errno.EFBIG))
"""Errors that tell of a disk and of no fault in the program."""

_sync = getattr(os, "fdatasync", os.fsync)
_NEW = os.O_RDWR | os.O_APPEND | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0)


class Disk:
    """The operating system's files; every method raises OSError as the call below it does."""

    def open(self, path: Path) -> int:
        """Make a file that must not exist yet, to append to and to read back; in no folder that a link stands for."""
        folder = open_folder(path.parent)
        try:
            return os.open(path.name, _NEW, 0o644, dir_fd=folder)
        finally:
            os.close(folder)

    def write(self, fd: int, data: bytes) -> int:
        """Hand bytes to the kernel; returns how many it took."""
        return os.write(fd, data)

    def fsync(self, fd: int) -> None:
        """Wait until the file's bytes and its length are on the disk."""
        _sync(fd)

    def fsync_folder(self, path: Path) -> None:
        """Wait until the names of a folder's files are on the disk."""
        fd = os.open(path, os.O_RDONLY)
        try:
            os.fsync(fd)
        finally:
            os.close(fd)

    def ftruncate(self, fd: int, size: int) -> None:
        """Cut a file to ``size`` bytes."""
        os.ftruncate(fd, size)

    def named(self, fd: int, path: Path) -> bool:
        """Tell whether the file is where it was made; False: deleted, moved, or gone with its disk.

        Any file of that name will do: not every file system numbers its files so that two answers can be compared.
        Where a link has taken the folder's place the file stays where it is.
        """
        if not os.fstat(fd).st_nlink:
            return False
        if path.parent.is_symlink():
            return True
        try:
            path.stat()
        except (FileNotFoundError, NotADirectoryError):
            return False
        except OSError:
            return True  # unknown; writing will show it
        return True

    def size(self, fd: int) -> int:
        """Length of a file in bytes."""
        return os.fstat(fd).st_size

    def read(self, fd: int, size: int, offset: int) -> bytes:
        """Read bytes back."""
        return os.pread(fd, size, offset)

    def close(self, fd: int) -> None:
        """Let go of a file."""
        os.close(fd)


OS_DISK = Disk()
