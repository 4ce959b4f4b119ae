"""Stores for a batch's results: a folder of this machine, or whatever fsspec writes. A file in a store is complete.

Names are relative, with ``/`` between folders. A file of the same name is replaced at once or not at all: the results
of one flight from the same input are the same bytes, whoever was quicker.

One batch at a time may write into a store. A lock file says which, and is rewritten every few seconds while that batch
runs. A lock file that stays the same is of a batch that was killed: another batch takes over after watching it for a
while. No clock is compared, as those of two machines differ. Where two take over at the same moment only work is lost.
"""

from __future__ import annotations

import contextlib
import fcntl
import logging
import os
import platform
import shutil
import tempfile
import threading
import time
import uuid
from abc import ABC, abstractmethod
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import psutil

from gcs.batch.addresses import is_remote, local_path, remote_files, store_errors
from gcs.errors import StoreError
from infra.files.safe_open import open_to_append

UNREADABLE = (msgspec.DecodeError, UnicodeDecodeError, RecursionError)
"""Errors of a file that others may have written."""
RENEW_S = 10.0
WATCH_S = 30.0
"""A batch that has not renewed its object for this long is over."""
POLL_S = 1.0
ASIDE = ".aside"
"""Folder of files that are not complete yet."""
LOCK = ".lock"
_PUT_WHOLE = frozenset(("s3", "s3a", "gs", "gcs", "abfs", "abfss", "az", "adl", "oci", "memory"))
"""Protocols of stores that show a file only once all of it has come."""
_log = logging.getLogger(__name__)


class LockHolder(msgspec.Struct, frozen=True, kw_only=True):
    """Batch that writes into a store, as its lock file has it."""

    host: str
    pid: int
    began_s: float
    """Start of the process by its own clock, Unix s: another process may have its number later."""
    key: str
    """Key of this one batch."""
    renewed: int = 0


@contextlib.contextmanager
def held(files: Any, path: str, address: str) -> Iterator[None]:  # noqa: ANN401 - fsspec has no types
    """Hold a store while a block runs.

    Raises:
        StoreError: another batch holds it, or it cannot be written.
    """
    me = LockHolder(host=platform.node(), pid=os.getpid(), began_s=psutil.Process().create_time(), key=uuid.uuid4().hex)
    _take(files, path, address, me)
    done = threading.Event()
    renewing = threading.Thread(target=_renew, args=(files, path, me, done), name="lock", daemon=True)
    renewing.start()
    try:
        yield
    finally:
        done.set()
        renewing.join()
        with contextlib.suppress(Exception):  # what is left stands still, and is taken over
            if (holder := _read(files, path)) and holder.key == me.key:
                files.rm_file(path)


def _take(files: Any, path: str, address: str, me: LockHolder) -> None:  # noqa: ANN401
    stop_s = time.monotonic() + WATCH_S
    first = _read(files, path)
    while first is not None and not _is_dead(first) and time.monotonic() < stop_s:
        time.sleep(min(POLL_S, WATCH_S / 10))
        now = _read(files, path)
        if now is not None and now != first:
            raise StoreError(
                f"{address}: another batch is writing into it (process {now.pid} of {now.host}); wait for its end"
            )
        first = now
    if first is not None:
        _log.warning("%s: process %s of %s left it; taken over", address, first.pid, first.host)
    _write(files, path, me)


def _is_dead(holder: LockHolder) -> bool:
    """Tell whether the holder is a process of this machine that has ended."""
    if holder.host != platform.node():
        return False
    try:
        return abs(psutil.Process(holder.pid).create_time() - holder.began_s) > 1.0
    except psutil.NoSuchProcess:
        return True


def _renew(files: Any, path: str, me: LockHolder, done: threading.Event) -> None:  # noqa: ANN401
    while not done.wait(RENEW_S):
        try:
            holder = _read(files, path)
            if holder is not None and holder.key != me.key:
                _log.warning("%s: process %s of %s writes there too", path, holder.pid, holder.host)
                return
            me = msgspec.structs.replace(me, renewed=me.renewed + 1)
            _write(files, path, me)
        except Exception as error:  # noqa: BLE001 - the results tell whether the store answers
            _log.warning("%s: not renewed: %s", path, error)


def _write(files: Any, path: str, holder: LockHolder) -> None:  # noqa: ANN401
    with store_errors(path):
        try:
            files.pipe_file(path, msgspec.json.encode(holder))
        except FileNotFoundError:  # of those that have folders
            files.makedirs(path.rpartition("/")[0], exist_ok=True)
            files.pipe_file(path, msgspec.json.encode(holder))


def _read(files: Any, path: str) -> LockHolder | None:  # noqa: ANN401
    """Read the holder of the store's lock; None for nobody, or for a file that is no lock."""
    with store_errors(path), contextlib.suppress(FileNotFoundError, *UNREADABLE):
        files.invalidate_cache()
        return msgspec.json.decode(files.cat_file(path), type=LockHolder)
    return None


class _Results(ABC):
    """Files by name, complete or not there. Every function raises StoreError where the store does not answer or
    refuses.

    Attributes:
        address: absolute path or address of the folder.
    """

    address: str

    @abstractmethod
    def scratch(self, name: str) -> Path:
        """Make a new folder of this machine for a flight's results; the caller removes it."""

    @abstractmethod
    def put(self, path: Path, name: str) -> None:
        """Put a file of a scratch folder into place; it may be gone from there afterwards."""

    def write(self, data: bytes, name: str) -> None:
        """Put bytes into place."""
        scratch = self.scratch("write")
        try:
            with store_errors(f"{self.address}/{name}"):
                (scratch / "data").write_bytes(data)
            self.put(scratch / "data", name)
        finally:
            shutil.rmtree(scratch, ignore_errors=True)


class LocalResults(_Results):
    """A folder of this machine, or of a disk that several share."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder.absolute()
        self.address = str(self._folder)

    @contextlib.contextmanager
    def claim(self, *, older_s: float) -> Iterator[None]:
        """Hold the folder while a block runs, so that no other batch writes into it; remove what others left aside
        before."""
        with store_errors(self.address):
            self._folder.mkdir(parents=True, exist_ok=True)
            lock = open_to_append(self._folder / LOCK)
        try:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                raise StoreError(f"{self.address}: another batch is writing into it; wait for its end") from None
            self._clean(time.time() - older_s)
            yield
        finally:
            os.close(lock)

    def _clean(self, before_s: float) -> None:
        with contextlib.suppress(FileNotFoundError):
            for path in (self._folder / ASIDE).iterdir():
                with contextlib.suppress(FileNotFoundError):
                    if max(file.stat().st_mtime for file in [path, *path.iterdir()]) < before_s:
                        shutil.rmtree(path, ignore_errors=True)

    def scratch(self, name: str) -> Path:
        """Make a new folder of this machine for a flight's results; the caller removes it."""
        with store_errors(self.address):
            (self._folder / ASIDE).mkdir(parents=True, exist_ok=True)
            return Path(tempfile.mkdtemp(prefix=f"{name}-", dir=self._folder / ASIDE))

    def put(self, path: Path, name: str) -> None:
        """Put a file of a scratch folder into place; it may be gone from there afterwards."""
        with store_errors(f"{self.address}/{name}"):
            place = self._folder / name
            place.parent.mkdir(parents=True, exist_ok=True)
            with path.open("rb") as file:
                os.fsync(file.fileno())
            path.replace(place)

    def read(self, name: str) -> bytes | None:
        """Return the content of a file, None where there is none."""
        with store_errors(f"{self.address}/{name}"), contextlib.suppress(FileNotFoundError):
            return (self._folder / name).read_bytes()
        return None

    def size(self, name: str) -> int | None:
        """Return the bytes of a file, None where there is none."""
        with store_errors(f"{self.address}/{name}"), contextlib.suppress(FileNotFoundError):
            return (self._folder / name).stat().st_size
        return None

    def remove(self, name: str) -> None:
        """Remove a file, if there is one."""
        with store_errors(f"{self.address}/{name}"):
            (self._folder / name).unlink(missing_ok=True)

    def names(self, folder: str) -> list[str]:
        """Return the names of the files and folders in a folder, in order; none where there is no such folder."""
        with store_errors(f"{self.address}/{folder}"), contextlib.suppress(FileNotFoundError):
            return sorted(path.name for path in (self._folder / folder).iterdir())
        return []


class RemoteResults(_Results):
    """A folder of whatever fsspec writes.

    Raises:
        StoreError: what reads it is not installed.
    """

    def __init__(self, address: str) -> None:
        self.address = address.rstrip("/")
        self._files, self._folder = remote_files(self.address)
        self._whole = address.partition("://")[0] in _PUT_WHOLE

    def claim(self, *, older_s: float) -> contextlib.AbstractContextManager[None]:
        """Hold the folder while a block runs, against batches of other machines too; nothing is left aside in a
        store."""
        return held(self._files, f"{self._folder}/{LOCK}", self.address)

    def scratch(self, name: str) -> Path:
        """Make a new folder of this machine for a flight's results; the caller removes it."""
        return Path(tempfile.mkdtemp(prefix=f"gcs-batch-{name}-"))

    def put(self, path: Path, name: str) -> None:
        """Put a file of a scratch folder into place; it may be gone from there afterwards."""
        with store_errors(f"{self.address}/{name}"):
            place = f"{self._folder}/{name}"
            if self._whole:
                self._files.put_file(str(path), place)
                return
            written = f"{self._folder}/{ASIDE}/{path.parent.name}-{path.name}"
            self._files.makedirs(f"{self._folder}/{ASIDE}", exist_ok=True)
            self._files.makedirs(place.rpartition("/")[0], exist_ok=True)
            self._files.put_file(str(path), written)
            self._files.mv(written, place)

    def read(self, name: str) -> bytes | None:
        """Return the content of a file, None where there is none."""
        with store_errors(f"{self.address}/{name}"), contextlib.suppress(FileNotFoundError):
            data = self._files.cat_file(f"{self._folder}/{name}")
            if isinstance(data, bytes):
                return data
        return None

    def size(self, name: str) -> int | None:
        """Return the bytes of a file, None where there is none."""
        with store_errors(f"{self.address}/{name}"), contextlib.suppress(FileNotFoundError):
            self._files.invalidate_cache()
            return int(self._files.size(f"{self._folder}/{name}"))
        return None

    def remove(self, name: str) -> None:
        """Remove a file, if there is one."""
        with store_errors(f"{self.address}/{name}"), contextlib.suppress(FileNotFoundError):
            self._files.rm_file(f"{self._folder}/{name}")

    def names(self, folder: str) -> list[str]:
        """Return the names of the files and folders in a folder, in order; none where there is no such folder."""
        with store_errors(f"{self.address}/{folder}"), contextlib.suppress(FileNotFoundError):
            self._files.invalidate_cache()
            found = self._files.ls(f"{self._folder}/{folder}".rstrip("/"), detail=False)
            return sorted(str(path).rstrip("/").rpartition("/")[2] for path in found)
        return []


ResultStore = LocalResults | RemoteResults


def open_results(address: str) -> ResultStore:
    """The store at an absolute path or address.

    Raises:
        StoreError: what reads it is not installed.
    """
    return RemoteResults(address) if is_remote(address) else LocalResults(local_path(address))
