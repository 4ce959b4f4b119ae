"""A disk that fails when it is told to, on top of the real one."""

import errno
import os
import time

from mavlink.disk import Disk


class FaultyDisk(Disk):
    """Set the attributes to have it fail.

    Attributes:
        room: bytes that still fit, None without end; past it writes are short, then fail with ``write_error``.
        write_error, sync_error, truncate_error, open_error: errno of every such call, 0 for none.
        most: bytes that one write takes.
        stall_s: how long a sync takes.
    """

    def __init__(self):
        self.room = self.most = None
        self.write_error = self.sync_error = self.truncate_error = self.open_error = 0
        self.stall_s = 0.0
        self.syncs = 0

    def open(self, path):
        fail(self.open_error)
        return super().open(path)

    def write(self, fd, data):
        if self.room is None:
            fail(self.write_error)
        elif self.room == 0:
            fail(self.write_error or errno.ENOSPC)
        else:
            data = data[: self.room]
        written = super().write(fd, data[: self.most])
        if self.room is not None:
            self.room -= written
        return written

    def fsync(self, fd):
        self.syncs += 1
        time.sleep(self.stall_s)
        fail(self.sync_error)
        super().fsync(fd)

    def ftruncate(self, fd, size):
        fail(self.truncate_error)
        super().ftruncate(fd, size)


def fail(code):
    if code:
        raise OSError(code, os.strerror(code))
