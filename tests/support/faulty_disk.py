"""A disk that fails when it is told to, on top of the real one, and a recorder on it."""

import errno
import os
import shutil
import threading

from gcs.session.recorder import Recorder
from infra.files.disk import OS_DISK, Disk
from mavlink.tlog.writer import TlogWriter

HANG_S = 120.0
"""A hanging disk that nobody frees gives up, so that a test which waits for it fails and ends."""


class FaultyDisk(Disk):
    """Set the attributes to have it fail.

    Attributes:
        room: bytes that still fit, None without end; past it writes are short, then fail with ``write_error``.
        write_error, sync_error, truncate_error, open_error: errno of every such call, 0 for none.
        most: bytes that one write takes.
        may_sync: while cleared, every sync hangs.
    """

    def __init__(self):
        self.room = self.most = None
        self.write_error = self.sync_error = self.truncate_error = self.open_error = 0
        self.may_sync = threading.Event()
        self.may_sync.set()
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
        assert self.may_sync.wait(HANG_S)
        fail(self.sync_error)
        super().fsync(fd)

    def ftruncate(self, fd, size):
        fail(self.truncate_error)
        super().ftruncate(fd, size)


class HangingDisk(FaultyDisk):
    """While ``may_write`` is cleared, no write returns."""

    def __init__(self):
        super().__init__()
        self.may_write = threading.Event()
        self.may_write.set()

    def write(self, fd, data):
        assert self.may_write.wait(HANG_S)
        return super().write(fd, data)


def delete(folder):
    """All at once: what is deleted file by file may be made anew before the last is gone."""
    shutil.rmtree(folder.rename(folder.with_name("deleted")))


def fail(code):
    if code:
        raise OSError(code, os.strerror(code))


class WholeRecorder(Recorder):
    def __init__(self, parent, mission, *, video, disk=OS_DISK):
        super().__init__(parent, mission, video=video, disk=disk)
        self._tlog = TlogWriter(self.tlog_path, disk=disk)
        self.packet = self._tlog.write

    def states(self, telemetry=None):
        return super().states(self._tlog.state)

    def close(self, telemetry=None, **notes):
        self._tlog.close()
        return super().close(**notes)
