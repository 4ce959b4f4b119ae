"""A file that is only ever appended to, and that outlives full disks, failing disks and the death of the program.

Rows go to the kernel with one system call before they count as accepted: SIGKILL loses none of them. A second thread
(:class:`infra.files.flusher.Caretaker`) has them put on the disk and repairs what fails, so that nobody who writes ever
waits for the disk:

- full, failing or read-only disk: the file is cut back to its last whole row, rows wait in memory and are written in
  order when there is space again;
- a failed sync: the kernel forgets what it could not write and says so once, so whatever the sync may have lost is
  written again into a new segment (``name.1.ext``, ``name.2.ext``, …) next to the old one, which is left as it is;
- a file or folder that was deleted, moved, or unmounted: it is made anew and filled from the file that is still open;
- a file that another program cut short: it is told, and a new segment is begun.
"""

from __future__ import annotations

import contextlib
import errno
import math
import os
import threading
import time
from pathlib import Path

from infra.files.disk import OS_DISK, Disk
from infra.files.record_state import RecordState
from infra.files.segments import segment_path
from infra.files.write_buffer import Backlog, Piece

__all__ = ["RAM_BYTES", "AppendFile"]

RAM_BYTES = 64 << 20
"""Rows kept while the disk fails: 60 s of 5,000 packets/s of 220 bytes each."""
RETRY_S = 1.0
HANG_S = 5.0
"""Closing waits so long for a disk that hangs."""
_COPY_BYTES = 1 << 20
_SPACE_MAY_RETURN = (errno.ENOSPC, errno.EDQUOT, errno.EROFS)
"""After these the same file goes on; after any other a new segment is begun."""


class AppendFile:
    """Whole rows into a new file and, where one file does not do, into further segments of it.

    Args:
        path: of the first segment.
        header: begins every segment.
        ram_bytes: most bytes kept while the disk fails; past it the oldest rows are lost, and counted.
        first: running number of the first row.
        lazy: make the file with the first row, not now; rows may go into a further segment of files that exist.
        disk: the operating system, or a test's.

    Raises:
        OSError: the file exists or cannot be made. Later faults never raise; ``state`` tells them.
    """

    def __init__(
        self,
        path: Path,
        *,
        header: bytes = b"",
        ram_bytes: int = RAM_BYTES,
        first: int = 0,
        lazy: bool = False,
        disk: Disk = OS_DISK,
    ) -> None:
        self.path = path
        self._header = header
        self._ram_bytes = ram_bytes
        self._disk = disk
        self._lock = threading.Lock()  # all that follows; never held while the disk syncs or repairs
        self._tending = threading.Lock()
        self._fd = self._deleted_fd = -1
        self._segment = -1
        self._size = self._earlier_bytes = self._deleted_size = 0
        self._torn = self._retire = self._named = self._closed = False
        self._accepted = first
        self._faults = 0
        self._failed_s = -math.inf
        self._reason = self._last_reason = ""
        self._failing_since_s = self._retry_s = self._synced_s = time.monotonic()
        self._waiting = Backlog(ram_bytes)
        self._unsynced = Backlog(ram_bytes)
        self._syncing = False
        self._writing_since_s: float | None = None
        if not lazy:
            self._fd = disk.open(path)
            self._segment = 0
            self.write(b"", 0)  # the header

    def write(self, data: bytes, rows: int = 1) -> int:
        """Accept whole rows.

        Returns:
            The running number of the first of them, from 0, over all segments.
        """
        with self._lock:
            first = self._accepted
            self._accepted += rows
            if self._reason or not self._put(data, rows):
                self._waiting.append(data, rows)
        return first

    def tend(self) -> None:
        """Sync, notice a deleted or cut file, repair; to be called some times a second, not by who writes."""
        with self._tending:
            if self._fd >= 0:
                self._sync()
                self._look_for_harm()
            if self._reason and not self._closed and time.monotonic() >= self._retry_s:
                self._repair()

    def sync(self) -> None:
        """Wait until the disk has every row.

        Raises:
            OSError: it has not.
        """
        with self._tending:
            if self._reason and not self._closed:
                self._repair()
            self._sync()
        if self._reason:
            raise OSError(errno.EIO, self._reason)

    def close(self) -> RecordState:
        """Try once more what failed, sync, and let go; what waits then or comes later is lost. Twice does nothing."""
        if self._tending.acquire(timeout=HANG_S):
            try:
                if not self._closed:
                    self._finish()
            finally:
                self._tending.release()
        self._closed = True  # a disk that hangs is left alone: what the kernel has taken is not ours to save
        return self.state

    @property
    def rows(self) -> int:
        """Accepted so far."""
        return self._accepted

    @property
    def holds(self) -> bool:
        """Whether rows wait in memory for a disk that did not take them."""
        return bool(self._waiting)

    @property
    def state(self) -> RecordState:
        """How it is doing now; without the lock, since who asks must not hang with the disk."""
        faults = self._faults  # before the reason, which is set before them
        since_s = self._writing_since_s
        now_s, waiting, closed = time.monotonic(), self._waiting, self._closed
        failing = bool(self._reason) and not closed
        return RecordState(
            name=segment_path(self.path, max(self._segment, 0)).name,
            rows=self._accepted,
            bytes=self._earlier_bytes + self._size,
            failing_s=max(now_s - self._failing_since_s, 1e-3) if failing else 0.0,
            reason=self._last_reason,
            faults=faults,
            failed_ago_s=max(now_s - self._failed_s, 0.0),
            waiting=0 if closed else waiting.rows,
            waiting_bytes=0 if closed else waiting.bytes,
            lost=waiting.dropped + (waiting.rows if closed else 0),
            sync_age_s=now_s - self._synced_s if self._unsynced or self._syncing or since_s is not None else 0.0,
            stalled_s=0.0 if since_s is None else now_s - since_s,
        )

    # ---- by who writes and by the caretaker, under the lock

    def _put(self, data: bytes, rows: int) -> bool:
        """Write rows at once; False: the disk did not take them."""
        if not self._unsynced and not self._syncing:
            self._synced_s = time.monotonic()
        self._writing_since_s = time.monotonic()
        try:
            if self._fd < 0:
                self._begin_segment()
            self._append(data)
        except OSError as error:
            self._fail(error)
            return False
        finally:
            self._writing_since_s = None
        self._unsynced.append(data, rows)
        return True

    def _append(self, data: bytes) -> None:
        """Hand all bytes to the kernel, or leave the file as it was."""
        disk, fd = self._disk, self._fd
        if self._torn:
            disk.ftruncate(fd, self._size)
            self._torn = False
        if not self._size:
            data = self._header + data
        try:
            written = disk.write(fd, data)
            while written < len(data):
                more = disk.write(fd, data[written:])
                if not more:
                    raise OSError(errno.EIO, os.strerror(errno.EIO))
                written += more
        except OSError:
            self._cut()
            raise
        self._size += len(data)

    def _cut(self) -> None:
        """Back to the last whole row."""
        try:
            self._disk.ftruncate(self._fd, self._size)
        except OSError:
            self._torn = True  # tried again before the next row; a reader skips a torn one

    def _fail(self, error: OSError, *, synced: bool = True) -> None:
        now_s = time.monotonic()
        began = not self._reason
        if began:
            self._failing_since_s = now_s
        # in this order: who reads the state does not take the lock, and is to see no failure without its reason
        self._failed_s = now_s
        self._last_reason = error.strerror or str(error) or type(error).__name__
        self._reason = self._last_reason
        self._faults += began
        self._retire = self._fd >= 0 and (
            not synced or (self._size > len(self._header) and error.errno not in _SPACE_MAY_RETURN)
        )
        self._retry_s = now_s if self._retire else now_s + RETRY_S

    def _begin_segment(self) -> None:
        """Open the first name that is free."""
        while True:
            try:
                self._fd = self._disk.open(segment_path(self.path, self._segment + 1))
            except FileExistsError:
                self._segment += 1
                continue
            self._segment += 1
            self._earlier_bytes += self._size
            self._size, self._torn, self._named = 0, False, False
            return

    # ---- by the caretaker alone

    def _sync(self) -> None:
        with self._lock:
            if not self._unsynced or self._fd < 0:
                return
            held, self._unsynced = self._unsynced, Backlog(self._ram_bytes)
            self._syncing = True
            began_s = time.monotonic()
        try:
            self._disk.fsync(self._fd)
            if not self._named:
                self._disk.fsync_folder(self.path.parent)
                self._named = True
        except OSError as error:
            with self._lock:
                self._syncing = False
                self._unsynced.put_before(held)
                self._fail(error, synced=False)
        else:
            with self._lock:
                self._syncing = False
                self._synced_s = began_s

    def _look_for_harm(self) -> None:
        size = self._size  # before the file is asked: it only grows
        try:
            if not self._disk.named(self._fd, segment_path(self.path, self._segment)):
                error = OSError(errno.ENOENT, "deleted or moved while it was written")
            elif (left := self._disk.size(self._fd)) < size:
                error = OSError(errno.EIO, f"cut short by another program, {size - left} bytes are gone")
            else:
                return
        except OSError as failed:
            error = failed
        with self._lock:
            self._fail(error, synced=error.errno == errno.ENOENT)
            if error.errno == errno.ENOENT and self._deleted_fd < 0:
                self._deleted_fd, self._deleted_size = self._fd, self._size
                self._fd, self._size, self._retire = -1, 0, False
                self._segment -= 1  # the same name again
                self._retry_s = time.monotonic()

    def _repair(self) -> None:
        """What failed once more: a new segment, the deleted file's content, the rows that wait; then all is well."""
        try:
            if self._retire:
                self._end_segment()
            if self._fd < 0:
                segment_path(self.path, self._segment + 1).parent.mkdir(mode=0o755, parents=True, exist_ok=True)
                self._begin_segment()
            if self._deleted_fd >= 0:
                self._copy_deleted()
            while (piece := self._oldest()) is not None:
                self._write_waiting(piece)
        except OSError as error:
            with self._lock:
                self._fail(error)

    def _end_segment(self) -> None:
        """Leave a segment that is not to be trusted; what is perhaps not on the disk goes into the next one."""
        with self._lock:
            if self._deleted_fd < 0:  # else all is copied again
                self._waiting.put_before(self._unsynced)
                self._unsynced = Backlog(self._ram_bytes)
            fd, self._fd, self._retire = self._fd, -1, False
            self._let_go(fd)

    def _finish(self) -> None:
        for _ in range(2):  # again where the last sync failed
            if self._reason:
                self._repair()
            self._sync()
        with self._lock:
            self._closed = True
            self._reason = self._reason or "closed"
            fds = [fd for fd in (self._fd, self._deleted_fd) if fd >= 0]
            self._fd = self._deleted_fd = -1
        for fd in fds:
            self._let_go(fd)

    def _let_go(self, fd: int) -> None:
        with contextlib.suppress(OSError):  # what it may say was said by the sync before
            self._disk.close(fd)

    def _copy_deleted(self) -> None:
        while self._size < self._deleted_size:
            data = self._disk.read(self._deleted_fd, min(_COPY_BYTES, self._deleted_size - self._size), self._size)
            if not data:
                break
            header, self._header = self._header, b""  # it is in the data
            try:
                self._append(data)
            finally:
                self._header = header
        fd, self._deleted_fd = self._deleted_fd, -1
        self._let_go(fd)

    def _oldest(self) -> Piece | None:
        """The rows that have waited longest; None ends the failure: who writes may use the file again."""
        with self._lock:
            if self._waiting:
                return self._waiting.pop()
            self._reason = ""
            return None

    def _write_waiting(self, piece: Piece) -> None:
        try:
            self._append(bytes(piece.data))
        except OSError:
            with self._lock:
                self._waiting.put_back(piece)
            raise
        with self._lock:
            if not self._unsynced:
                self._synced_s = time.monotonic()
            self._unsynced.append(piece.data, piece.rows)
