"""Files of a job that appear only when they are complete: written to a hidden folder, then moved into place, never over
another file."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import shutil
import tempfile
import time
from pathlib import Path

PREFIX = ".aside-"
YOUNG_S = 60.0
"""Age below which a file that was just made may not be held yet."""
_held: dict[Path, int] = {}
"""Descriptors that lock the hidden folders of this process."""
_NO_LINKS = (errno.EPERM, errno.ENOTSUP, errno.ENOSYS, errno.EMLINK, errno.EXDEV)
"""Errors that file systems without hard links answer."""


def make_aside(folder: Path) -> Path:
    """A new hidden folder in ``folder``, which is made where it is missing; ``remove_aside`` ends it.

    What a job that was killed left there before is removed.

    Raises:
        OSError: it cannot be made.
    """
    folder.mkdir(parents=True, exist_ok=True)
    _remove_left(folder)
    hidden = Path(tempfile.mkdtemp(prefix=PREFIX, dir=folder))
    with contextlib.suppress(OSError):  # file systems without locks: nobody removes it there
        _held[hidden] = _locked(hidden)
    return hidden


def remove_aside(hidden: Path) -> None:
    """Remove what is left of a hidden folder; twice does nothing."""
    shutil.rmtree(hidden, ignore_errors=True)
    fd = _held.pop(hidden, -1)
    if fd >= 0:
        os.close(fd)


def _remove_left(folder: Path) -> None:
    for hidden in folder.glob(f"{PREFIX}*"):
        with contextlib.suppress(OSError):
            status = hidden.lstat()
            if status.st_uid == os.geteuid() and time.time() - status.st_mtime > YOUNG_S:
                fd = _locked(hidden)
                shutil.rmtree(hidden, ignore_errors=True)
                os.close(fd)


def _locked(hidden: Path) -> int:
    """Descriptor of a folder that no other process holds.

    Raises:
        OSError: one does, or it is no folder.
    """
    fd = os.open(hidden, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC)
    try:
        fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(fd)
        raise
    return fd


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
    """Give a complete file of the same disk its name; its content is synced to the disk first.

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
