"""The table of signed streams on disk, so that what was received before a restart cannot be replayed after it.

Two files are written in turn, each with its number and a checksum: whatever happens while one is written, the other is
whole. A thread of its own writes them every second while a flight runs, when a stream is new, and at the end.

What came after the last save is in a journal in memory (:mod:`mavlink.signing.journal`), which outlives the process.
In a power cut it is lost, and with it up to two seconds: then a stream is accepted again once a frame proves that it
was made later than that.
"""

from __future__ import annotations

import fcntl
import hashlib
import os
import struct
import threading
import time
from collections.abc import Callable, Collection
from dataclasses import dataclass
from pathlib import Path

from mavlink.errors import SigningError
from mavlink.protocol.dialect import RADIO_STATUS
from mavlink.signing.journal import RUN_BYTES, StreamJournal
from mavlink.signing.keys import read_ring
from mavlink.signing.streams import SECOND, StreamRow, Streams, ticks_of
from mavlink.signing.verifier import Keyless, Verifier

SLOTS = ("streams.0", "streams.1")
PERIOD_S = 1.0
"""Seconds between saves."""
CHECK_S = 0.02
"""Seconds between checks for a new stream, which is saved at once."""
_MAX_SAVING = 0.1
"""Share of the time that saving may take."""
_MAGIC, _OLD_MAGIC = b"RCSTRM2\n", b"RCSTRM1\n"
_HEAD = struct.Struct("<8sQQQ?8sI")  # magic, number, saved at, proven, whether at the end, run, rows
_OLD_HEAD = struct.Struct("<8sQQQ?I")
_ROW, _OLD_ROW = struct.Struct("<BBBQQQ"), struct.Struct("<BBBQQ")
_SUM = 32
_LOST = 2 * SECOND
"""Frames that may be missing in the file: those of a second between two saves, and of the save itself."""


def open_verifier(
    folder: Path,
    *,
    unsigned: Collection[int] = (RADIO_STATUS,),
    keyless: Keyless = "refused",
    accept_late: Collection[int] = (),
) -> tuple[Verifier, StreamStore]:
    """Read the keys of a folder and the table of their streams.

    To be called in the process that verifies, once for all links; there, close the store at the end.

    Args:
        unsigned: as the verifier has it, as the next.
        accept_late: as :class:`mavlink.signing.streams.Streams` has it.

    Raises:
        SigningError: no key in it, or what :func:`mavlink.signing.keys.read_ring`, the verifier and the store raise.
    """
    ring = read_ring(folder)
    if not ring:
        raise SigningError(f"{folder}: no key in it, so nothing could be refused; make one with gcs keys new")
    store = StreamStore(folder, accept_late=accept_late)
    try:
        return Verifier(ring, unsigned=unsigned, keyless=keyless, streams=store.streams), store
    except SigningError:
        store.close()
        raise


@dataclass(frozen=True, slots=True, kw_only=True)
class _Saved:
    number: int
    at: int
    proven: int
    ended: bool
    run: bytes
    rows: tuple[StreamRow, ...]


class StreamStore:
    """Keeps one table of streams in a folder.

    Args:
        folder: exists; the keys' own is a good one.
        accept_late: as :class:`mavlink.signing.streams.Streams` has it.
        wall_ns: the computer's clock, Unix ns.

    Raises:
        SigningError: both files are damaged, the folder cannot be written, or another station keeps its table there.
    """

    def __init__(
        self,
        folder: Path,
        *,
        period_s: float = PERIOD_S,
        accept_late: Collection[int] = (),
        wall_ns: Callable[[], int] = time.time_ns,
    ) -> None:
        self.folder = folder
        self.streams = Streams(accept_late)
        self.warning = ""
        """Fault of the files at the start; empty for nothing."""
        self.trouble = ""
        """Reason why nothing can be saved now; empty where it can."""
        self._number = self._births = 0
        self._period_s, self._wall_ns = period_s, wall_ns
        self._run_id = os.urandom(RUN_BYTES)
        self._lock = self._locked()
        try:
            self._journal = StreamJournal(folder)
            try:
                self._load()
                self._save(ended=False)
            except BaseException:
                self._journal.close(needed=bool(self._journal.run()))
                raise
        except BaseException:
            os.close(self._lock)
            raise
        # now the files hold what the journal held
        self._journal.begin(self._run_id)
        self.streams.write_to(self._journal)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="signing store", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Save the last state; closing twice does nothing.

        Raises:
            SigningError: it could not be saved.
        """
        if self._stop.is_set():
            return
        self._stop.set()
        self._thread.join()
        self.streams.journal = None
        saved = False
        try:
            self._save(ended=True)
            saved = True
        finally:
            self._journal.close(needed=not saved)
            os.close(self._lock)

    def _run(self) -> None:
        start_s, pause_s = time.monotonic(), CHECK_S
        while not self._stop.wait(pause_s):
            pause_s = CHECK_S
            if self.streams.births == self._births and time.monotonic() - start_s < self._period_s:
                continue
            start_s = time.monotonic()
            try:
                self._save(ended=False)
                self.trouble = ""
            except SigningError as error:
                self.trouble = str(error)
            # a sender with a key could make streams without end
            pause_s = min(max(CHECK_S, (time.monotonic() - start_s) / _MAX_SAVING), self._period_s)

    def _locked(self) -> int:
        path = self.folder / "streams.lock"
        try:
            lock = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o600)
        except OSError as error:
            raise SigningError(f"{path}: cannot be made: {error.strerror}; the key folder must be writable") from None
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            os.close(lock)
            raise SigningError(
                f"{self.folder}: another station uses these keys now; end it, or fly with a copy of the folder"
            ) from None
        return lock

    def _load(self) -> None:
        slots = [_read(self.folder / name) for name in SLOTS]
        whole = [slot for slot in slots if isinstance(slot, _Saved)]
        damaged = [str(self.folder / name) for name, slot in zip(SLOTS, slots, strict=True) if slot == "damaged"]
        if damaged and not whole:
            raise SigningError(
                f"{' and '.join(damaged)}: damaged, so recorded frames could be replayed; move both away to start anew"
            )
        if damaged:
            self.warning = f"{damaged[0]}: damaged, written anew; its twin was used, which may be a second older"
        if whole:
            self._restore(max(whole, key=lambda slot: slot.number))

    def _restore(self, saved: _Saved) -> None:
        exact = bool(saved.run) and saved.run == self._journal.run()
        newest = {row[:3]: row for row in saved.rows}
        for row in self._journal.rows() if exact else ():
            if row[:3] not in newest or newest[row[:3]].timestamp < row.timestamp:
                newest[row[:3]] = row
        # where the clock was set back since, the earlier time is the safe one
        lost_until = min(saved.at, ticks_of(self._wall_ns() // 1000)) + _LOST
        for row in newest.values():
            self.streams.restore(row, not_before=0 if exact or saved.ended else lost_until)
        self.streams.proven = saved.proven
        self._number = saved.number

    def _save(self, *, ended: bool) -> None:
        self._number += 1
        path = self.folder / SLOTS[self._number % 2]
        self._births, kept = self.streams.births, list(self.streams.rows())
        rows = [_ROW.pack(*row) for row in kept]
        # where the computer's clock was set back, the streams went on
        at = max([ticks_of(self._wall_ns() // 1000), *(row.received for row in kept)])
        head = _HEAD.pack(_MAGIC, self._number, at, self.streams.proven, ended, self._run_id, len(rows))
        data = head + b"".join(rows)
        try:
            _write(path, data + hashlib.sha256(data).digest())
        except OSError as error:
            raise SigningError(
                f"{path}: cannot be saved: {error.strerror}; after a restart recorded frames could be replayed"
            ) from None


def _write(path: Path, data: bytes) -> None:
    fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_NOFOLLOW, 0o600)
    try:
        while data:
            data = data[os.write(fd, data) :]
        os.ftruncate(fd, os.lseek(fd, 0, os.SEEK_CUR))
        os.fsync(fd)
    finally:
        os.close(fd)


def _read(path: Path) -> _Saved | str:
    """A file's contents; ``absent``, or ``damaged``."""
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        return "absent"
    except OSError as error:
        raise SigningError(f"{path}: cannot be read: {error.strerror}") from None
    body = data[:-_SUM]
    old = body.startswith(_OLD_MAGIC)
    head, row = (_OLD_HEAD, _OLD_ROW) if old else (_HEAD, _ROW)
    if len(body) < head.size or hashlib.sha256(body).digest() != data[-_SUM:]:
        return "damaged"
    magic, number, at, proven, ended, *run, count = head.unpack_from(body)
    if magic not in (_MAGIC, _OLD_MAGIC) or len(body) != head.size + count * row.size:
        return "damaged"
    rows = tuple(StreamRow(*fields) for fields in row.iter_unpack(body[head.size :]))
    return _Saved(number=number, at=at, proven=proven, ended=ended, run=b"".join(run), rows=rows)
