"""A file that is only ever appended to, and that outlives full disks, failing disks and the death of the program.

Rows go to the kernel with one system call before they count as accepted: SIGKILL loses none of them. A second thread
(:class:`Flusher`) has them put on the disk and repairs what fails, so that no writer ever
waits for the disk:

- full, failing or read-only disk: the file is cut back to its last whole row, rows wait in memory and are written in
  order when there is space again;
- a failed sync: the kernel forgets what it could not write and reports it once, so whatever the sync may have lost is
  written again into a new segment (``name.1.ext``, ``name.2.ext``, …) next to the old one, which is left as it is;
- a file or folder that was deleted, moved, or unmounted: it is made again and filled from the file that is still open;
- a file that another program cut short: it is reported, and a new segment is begun.
"""

from __future__ import annotations

import errno
import math
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

from infra.files.disk import OS_DISK, Disk
from infra.files.record_state import RecordState
from infra.files.segment import Segment, segment_path
from infra.files.write_buffer import Chunk, WriteBuffer

RAM_BYTES = 64 << 20
"""Rows kept while the disk fails: 60 s of 5,000 packets/s of 220 bytes each."""
RETRY_S = 1.0
HANG_S = 5.0
"""Closing waits this long for a disk that hangs."""
_COPY_BYTES = 1 << 20
_SPACE_MAY_RETURN = (errno.ENOSPC, errno.EDQUOT, errno.EROFS)
"""Errors after which the same file goes on; after any other a new segment is started."""
_CLOSE_S = 5.0


class _Mode(Enum):
    """Destination of accepted rows now."""

    WRITING = "to the kernel"
    RETRYING = "to memory, until the disk takes them"
    REPLACING = "to memory, until a new segment follows the present one, which is not to be trusted"
    CLOSED = "nowhere: they are lost"


_WRITING, _RETRYING, _REPLACING, _CLOSED = _Mode
_FAILING = (_RETRYING, _REPLACING)


@dataclass(frozen=True, slots=True)
class _Failures:
    """Failures so far. Replaced as a whole: whoever asks sees no failure without its reason."""

    count: int = 0
    reason: str = ""
    """Reason of the last failure."""
    began_s: float = -math.inf
    last_s: float = -math.inf


class AppendFile:
    """File that takes whole rows and, where one file does not do, goes on in further segments.

    Args:
        header: begins every segment.
        ram_bytes: most bytes kept while the disk fails; past it the oldest rows are lost, and counted.
        first: running number of the first row.
        lazy: make the file with the first row, not now; rows may go into a further segment of files that exist.
        disk: the operating system, or a test's.

    Raises:
        OSError: the file exists or cannot be made. Later faults never raise; ``state`` reports them.
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
        self._maintaining = threading.Lock()
        self._mode = _WRITING
        self._failures = _Failures()
        self._retry_s = self._synced_s = time.monotonic()
        self._segment: Segment | None = None
        self._deleted: Segment | None = None
        """Segment whose name is gone, until its content is in the present one."""
        self._next_number = 0
        self._earlier_bytes = 0
        self._accepted = first
        self._waiting = WriteBuffer(ram_bytes)
        self._unsynced = WriteBuffer(ram_bytes)
        self._syncing = False
        self._writing_since_s: float | None = None
        if not lazy:
            self._segment, self._next_number = Segment(path, 0, disk), 1
            self.write(b"", 0)  # the header

    def write(self, data: bytes, rows: int = 1) -> int:
        """Accept whole rows.

        Returns:
            The running number of the first of them, from 0, over all segments.
        """
        with self._lock:
            first = self._accepted
            self._accepted += rows
            if self._mode is not _WRITING or not self._put(data, rows):
                self._waiting.append(data, rows)
        return first

    def maintain(self) -> None:
        """Sync, notice a deleted or cut file, repair; to be called some times a second, not by who writes."""
        with self._maintaining:
            if (segment := self._segment) is not None:
                self._sync()
                self._check_file(segment)
            if self._mode in _FAILING and time.monotonic() >= self._retry_s:
                self._repair()

    def close(self) -> RecordState:
        """Try once more what failed, sync, and close; what waits then or comes later is lost. Twice does nothing."""
        if self._maintaining.acquire(timeout=HANG_S):
            try:
                if self._mode is not _CLOSED:
                    self._finish()
            finally:
                self._maintaining.release()
        self._mode = _CLOSED  # a disk that hangs is left alone: what the kernel has taken is not ours to save
        return self.state

    @property
    def rows(self) -> int:
        """Number of rows accepted so far."""
        return self._accepted

    @property
    def has_waiting_rows(self) -> bool:
        """True if rows wait in memory for a disk that did not take them."""
        return bool(self._waiting)

    @property
    def state(self) -> RecordState:
        """State of the file now; without the lock, since who asks must not hang with the disk."""
        mode = self._mode  # before the failures, which are set before it
        failures, segment, waiting = self._failures, self._segment, self._waiting
        since_s, now_s = self._writing_since_s, time.monotonic()
        closed = mode is _CLOSED
        return RecordState(
            name=segment_path(self.path, max(self._next_number - 1, 0)).name,
            rows=self._accepted,
            bytes=self._earlier_bytes + (segment.size if segment else 0),
            failing_s=max(now_s - failures.began_s, 1e-3) if mode in _FAILING else 0.0,
            reason=failures.reason,
            faults=failures.count,
            failed_ago_s=max(now_s - failures.last_s, 0.0),
            waiting=0 if closed else waiting.rows,
            waiting_bytes=0 if closed else waiting.bytes,
            lost=waiting.dropped + (waiting.rows if closed else 0),
            sync_age_s=now_s - self._synced_s if self._unsynced or self._syncing or since_s is not None else 0.0,
            stalled_s=0.0 if since_s is None else now_s - since_s,
        )

    # ---- by who writes and by who maintains, under the lock

    def _put(self, data: bytes, rows: int) -> bool:
        """Write rows at once; False: the disk did not take them."""
        if not self._unsynced and not self._syncing:
            self._synced_s = time.monotonic()
        self._writing_since_s = time.monotonic()
        try:
            segment = self._segment or self._begin_segment()
            segment.append(data if segment.size else self._header + data)
        except OSError as error:
            self._fail(error)
            return False
        finally:
            self._writing_since_s = None
        self._unsynced.append(data, rows)
        return True

    def _fail(self, error: OSError, *, synced: bool = True) -> None:
        """Rows wait from now on; where the segment cannot be trusted any more, for the next one."""
        now_s, before, began = time.monotonic(), self._failures, self._mode is _WRITING
        reason = error.strerror or str(error) or type(error).__name__
        self._failures = _Failures(before.count + began, reason, now_s if began else before.began_s, now_s)
        segment = self._segment
        has_rows = segment is not None and segment.size > len(self._header)
        untrusted = not synced or (has_rows and error.errno not in _SPACE_MAY_RETURN)
        if segment is not None and untrusted:
            self._enter(_REPLACING)
            self._retry_s = now_s
        else:
            self._enter(_RETRYING)
            self._retry_s = now_s + RETRY_S

    def _enter(self, mode: _Mode) -> None:
        if self._mode is not _CLOSED:
            self._mode = mode

    def _begin_segment(self) -> Segment:
        """Make the file with the first name that is free."""
        while True:
            number = self._next_number
            try:
                self._segment = Segment(self.path, number, self._disk)
            except FileExistsError:
                self._next_number += 1
                continue
            self._next_number += 1
            return self._segment

    # ---- by who maintains alone

    def _sync(self) -> None:
        with self._lock:
            segment = self._segment
            if not self._unsynced or segment is None:
                return
            held, self._unsynced = self._unsynced, WriteBuffer(self._ram_bytes)
            self._syncing = True
            began_s = time.monotonic()
        try:
            segment.sync()
        except OSError as error:
            with self._lock:
                self._syncing = False
                self._unsynced.put_before(held)
                self._fail(error, synced=False)
        else:
            with self._lock:
                self._syncing = False
                self._synced_s = began_s

    def _check_file(self, segment: Segment) -> None:
        """Notice that a file is gone or was cut short."""
        try:
            segment.check()
        except OSError as error:
            with self._lock:
                self._fail(error, synced=error.errno == errno.ENOENT)
                if error.errno == errno.ENOENT and self._deleted is None:
                    self._deleted, self._segment = segment, None
                    self._next_number = segment.number  # the same name again
                    self._enter(_RETRYING)
                    self._retry_s = time.monotonic()

    def _repair(self) -> None:
        """Retry what failed: a new segment, the deleted file's content, the rows that wait; then all is well."""
        try:
            if self._mode is _REPLACING:
                self._end_segment()
            segment = self._segment
            if segment is None:
                segment_path(self.path, self._next_number).parent.mkdir(mode=0o755, parents=True, exist_ok=True)
                segment = self._begin_segment()
            if self._deleted is not None:
                self._restore(self._deleted, segment)
            while (chunk := self._take_oldest()) is not None:
                self._write_waiting(segment, chunk)
        except OSError as error:
            with self._lock:
                self._fail(error)

    def _end_segment(self) -> None:
        """Leave a segment that is not to be trusted; what is perhaps not on the disk goes into the next one."""
        with self._lock:
            if self._deleted is None:  # else all is copied again
                self._waiting.put_before(self._unsynced)
                self._unsynced = WriteBuffer(self._ram_bytes)
            if (segment := self._segment) is not None:
                self._segment = None
                self._earlier_bytes += segment.size
                segment.close()
            self._enter(_RETRYING)

    def _restore(self, deleted: Segment, segment: Segment) -> None:
        """Copy what a deleted file held, its header too."""
        while segment.size < deleted.size:
            data = deleted.read(min(_COPY_BYTES, deleted.size - segment.size), segment.size)
            if not data:
                break
            segment.append(data)
        self._deleted = None
        deleted.close()

    def _take_oldest(self) -> Chunk | None:
        """The rows that have waited longest; None ends the failure: who writes may use the file again."""
        with self._lock:
            if self._waiting:
                return self._waiting.pop()
            self._enter(_WRITING)
            return None

    def _write_waiting(self, segment: Segment, chunk: Chunk) -> None:
        try:
            segment.append(bytes(chunk.data) if segment.size else self._header + chunk.data)
        except OSError:
            with self._lock:
                self._waiting.put_back(chunk)
            raise
        with self._lock:
            if not self._unsynced:
                self._synced_s = time.monotonic()
            self._unsynced.append(chunk.data, chunk.rows)

    def _finish(self) -> None:
        for _ in range(2):  # again where the last sync failed
            if self._mode in _FAILING:
                self._repair()
            self._sync()
        with self._lock:
            self._mode = _CLOSED
            open_segments = [segment for segment in (self._segment, self._deleted) if segment is not None]
            self._segment = self._deleted = None
        for segment in open_segments:
            segment.close()


class Flusher:
    """Thread that maintains some files until it is stopped.

    Args:
        files: maintained in this order, one after the other.
        period_s: from the end of one round to the start of the next.
    """

    def __init__(self, files: Sequence[AppendFile], period_s: float) -> None:
        self._files = files
        self._period_s = period_s
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="disk", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """End the thread; a disk that hangs is left after five seconds."""
        self._stop.set()
        self._thread.join(_CLOSE_S)

    def _run(self) -> None:
        while not self._stop.wait(self._period_s):
            for file in self._files:
                file.maintain()
