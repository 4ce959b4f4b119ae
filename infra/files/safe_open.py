"""Files in folders that others may write to: only regular files are opened, and no link leads a writer elsewhere.

A named pipe in a file's place would be waited on for ever, a device may do anything when it is opened, and a symbolic
link would have a writer change a file that another user chose.
"""

from __future__ import annotations

import errno
import grp
import os
import pwd
import stat
from pathlib import Path

_OPEN = os.O_CLOEXEC | os.O_NONBLOCK | os.O_NOCTTY  # a pipe is not waited on, a terminal does not become ours


def open_to_read(path: Path | str, *, links: bool = True, folder: int | None = None) -> int:
    """Open a regular file.

    Returns:
        The file descriptor.

    Raises:
        OSError: no such file, or it is a pipe, device or folder.
    """
    fd = os.open(path, os.O_RDONLY | _OPEN | (0 if links else os.O_NOFOLLOW), dir_fd=folder)
    return _regular(fd, path)


def read_small(path: Path | str, most_bytes: int) -> bytes:
    """Read all of a regular file.

    Raises:
        OSError: it cannot be opened or waited for, or has more than ``most_bytes``.
    """
    with os.fdopen(open_to_read(path), "rb") as file:
        data: bytes | None = file.read(most_bytes + 1)
    if data is None:  # a file of the system that waits for what comes
        raise BlockingIOError(errno.EAGAIN, os.strerror(errno.EAGAIN), str(path))
    if len(data) > most_bytes:
        raise OSError(errno.EFBIG, f"larger than {most_bytes >> 10} KiB", str(path))
    return data


def create(path: Path | str, *, folder: int | None = None) -> int:
    """Make a file, to write and to read back, where nothing is, not even a link.

    Returns:
        The file descriptor.

    Raises:
        OSError: something of that name is there, or it cannot be made.
    """
    return os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o644, dir_fd=folder)


def open_folder(path: Path | str, *, folder: int | None = None) -> int:
    """Descriptor of a folder that no link stands for, to open files relative to.

    Raises:
        OSError: no such folder, or a link in its place.
    """
    return os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC, dir_fd=folder)


def open_to_append(path: Path | str, *, links: bool = True) -> int:
    """Open a file of ours at its end, made where there is none.

    Args:
        links: follow a symbolic link in the place of its folder; one in its own place is never followed.

    Returns:
        The file descriptor.

    Raises:
        OSError: it cannot be opened or made, or in its place is a link or another's file.
    """
    flags = os.O_WRONLY | os.O_CREAT | os.O_APPEND | os.O_NOFOLLOW | _OPEN
    if links:
        opened = os.open(path, flags, 0o644)
    else:
        folder = open_folder(Path(path).parent)
        try:
            opened = os.open(Path(path).name, flags, 0o644, dir_fd=folder)
        finally:
            os.close(folder)
    fd = _regular(opened, path)
    status = os.fstat(fd)
    if status.st_uid != os.geteuid() or status.st_nlink > 1:
        os.close(fd)
        raise OSError(errno.EPERM, "belongs to another user, or has another name too", str(path))
    return fd


def is_shared(folder: Path) -> bool:
    """Tell whether others than its owner, who is this user or root, may make and rename files in a folder.

    A group of which this user is the only member, as many systems make for each user, is no other.
    """
    status = folder.stat()
    mode, user = stat.S_IMODE(status.st_mode), os.geteuid()
    if status.st_uid not in (user, 0) or mode & stat.S_IWOTH:
        return True
    return bool(mode & stat.S_IWGRP) and not _is_private(status.st_gid)


def _is_private(group_id: int) -> bool:
    """Tell whether a group has no member but this user."""
    try:
        user, group = pwd.getpwuid(os.geteuid()), grp.getgrgid(group_id)
    except KeyError:
        return False
    return group.gr_name == user.pw_name and set(group.gr_mem) <= {user.pw_name}


def _regular(fd: int, path: Path | str) -> int:
    mode = os.fstat(fd).st_mode
    if stat.S_ISREG(mode):
        return fd
    os.close(fd)
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    raise OSError(errno.EINVAL, "not a regular file", str(path))
