"""Files of a job that are there when they are whole: written aside, then put into their place, never over another."""

from __future__ import annotations

import errno
import os
import tempfile
from pathlib import Path

__all__ = ["make_aside", "put_all_in_place", "put_in_place"]

_NO_LINKS = (errno.EPERM, errno.ENOTSUP, errno.ENOSYS, errno.EMLINK, errno.EXDEV)
"""What file systems without hard links answer."""


def make_aside(folder: Path) -> Path:
    """A new hidden folder in ``folder``, which is made where it is missing.

    Raises:
        OSError: it cannot be made.
    """
    folder.mkdir(parents=True, exist_ok=True)
    return Path(tempfile.mkdtemp(prefix=".aside-", dir=folder))


def put_all_in_place(hidden: Path, folder: Path, *, last: str = "") -> None:
    """Put all files of one folder into another of the same disk.

    Args:
        hidden: where they are.
        folder: where they come to.
        last: name of the file that comes last: where it is, all the others are.

    Raises:
        FileExistsError: a file of one of the names is there.
        OSError: one cannot be put there.
    """
    for path in sorted(hidden.iterdir(), key=lambda path: (path.name == last, path.name)):
        put_in_place(path, folder / path.name)


def put_in_place(path: Path, place: Path) -> None:
    """Give a whole file of the same disk its name; what it holds is on the disk before.

    Raises:
        FileExistsError: something of that name is there.
        OSError: it cannot be put there.
    """
    with path.open("rb") as file:
        os.fsync(file.fileno())
    try:
        os.link(path, place)
    except OSError as error:
        if error.errno not in _NO_LINKS:
            raise
        if place.exists():
            raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(place)) from None
        path.rename(place)
    else:
        path.unlink()
