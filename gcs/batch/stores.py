"""Where a batch's results are: a folder of this machine, or a store that fsspec writes. What is there is whole.

Names are relative, with ``/`` between folders. What has a name already is replaced at once or not at all: the results
of one flight from the same input are the same bytes, whoever was quicker.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import shutil
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Protocol

from gcs.batch.addresses import is_remote, local_path, remote_files, store_errors
from gcs.batch.store_lock import held
from gcs.errors import StoreError
from infra.files.safe_open import open_to_append

ASIDE = ".aside"
"""Folder of what is not whole yet."""
LOCK = ".lock"
_PUT_WHOLE = frozenset(("s3", "s3a", "gs", "gcs", "abfs", "abfss", "az", "adl", "oci", "memory"))
"""Protocols of stores that show a file when all of it has come."""


class ResultStore(Protocol):
    """Files by name, whole or not there.

    Attributes:
        address: absolute path or address of the folder.

    Every function raises StoreError where the store does not answer or refuses.
    """

    address: str

    def claim(self, *, older_s: float) -> contextlib.AbstractContextManager[None]:
        """Hold it while a block runs, so that no other batch writes into it.

        Args:
            older_s: what others left aside and has not been touched for so long is removed.
        """

    def scratch(self, name: str) -> Path:
        """A new folder of this machine to make a flight's results in; who asks removes it."""

    def put(self, path: Path, name: str) -> None:
        """Put a file of a scratch folder into place; it may be gone from there afterwards."""

    def write(self, data: bytes, name: str) -> None:
        """Put bytes into place."""

    def read(self, name: str) -> bytes | None:
        """Content of a file, None where there is none."""

    def size(self, name: str) -> int | None:
        """Bytes of what is there, None for nothing."""

    def remove(self, name: str) -> None:
        """Remove what is there, if anything is."""

    def names(self, folder: str) -> list[str]:
        """Names of the files and folders in a folder, in order; none where there is no such folder."""


def open_results(address: str) -> ResultStore:
    """The store at an absolute path or address.

    Raises:
        StoreError: what reads it is not installed.
    """
    return RemoteResults(address) if is_remote(address) else LocalResults(local_path(address))


class LocalResults:
    """A folder of this machine, or of a disk that several share."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder.absolute()
        self.address = str(self._folder)

    @contextlib.contextmanager
    def claim(self, *, older_s: float) -> Iterator[None]:
        """Implements the protocol."""
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
        """Implements the protocol."""
        with store_errors(self.address):
            (self._folder / ASIDE).mkdir(parents=True, exist_ok=True)
            return Path(tempfile.mkdtemp(prefix=f"{name}-", dir=self._folder / ASIDE))

    def put(self, path: Path, name: str) -> None:
        """Implements the protocol."""
        with store_errors(f"{self.address}/{name}"):
            place = self._folder / name
            place.parent.mkdir(parents=True, exist_ok=True)
            with path.open("rb") as file:
                os.fsync(file.fileno())
            path.replace(place)

    def write(self, data: bytes, name: str) -> None:
        """Implements the protocol."""
        scratch = self.scratch("write")
        try:
            with store_errors(f"{self.address}/{name}"):
                (scratch / "data").write_bytes(data)
            self.put(scratch / "data", name)
        finally:
            shutil.rmtree(scratch, ignore_errors=True)

    def read(self, name: str) -> bytes | None:
        """Implements the protocol."""
        with store_errors(f"{self.address}/{name}"), contextlib.suppress(FileNotFoundError):
            return (self._folder / name).read_bytes()
        return None

    def size(self, name: str) -> int | None:
        """Implements the protocol."""
        with store_errors(f"{self.address}/{name}"), contextlib.suppress(FileNotFoundError):
            return (self._folder / name).stat().st_size
        return None

    def remove(self, name: str) -> None:
        """Implements the protocol."""
        with store_errors(f"{self.address}/{name}"):
            (self._folder / name).unlink(missing_ok=True)

    def names(self, folder: str) -> list[str]:
        """Implements the protocol."""
        with store_errors(f"{self.address}/{folder}"), contextlib.suppress(FileNotFoundError):
            return sorted(path.name for path in (self._folder / folder).iterdir())
        return []


class RemoteResults:
    """A folder of whatever fsspec writes.

    Args:
        address: with its protocol.

    Raises:
        StoreError: what reads it is not installed.
    """

    def __init__(self, address: str) -> None:
        self.address = address.rstrip("/")
        self._files, self._folder = remote_files(self.address)
        self._whole = address.partition("://")[0] in _PUT_WHOLE

    def claim(self, *, older_s: float) -> contextlib.AbstractContextManager[None]:
        """Implements the protocol, against batches of other machines too; a store has nothing that is left aside."""
        return held(self._files, f"{self._folder}/{LOCK}", self.address)

    def scratch(self, name: str) -> Path:
        """Implements the protocol."""
        return Path(tempfile.mkdtemp(prefix=f"gcs-batch-{name}-"))

    def put(self, path: Path, name: str) -> None:
        """Implements the protocol."""
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

    def write(self, data: bytes, name: str) -> None:
        """Implements the protocol."""
        scratch = self.scratch("write")
        try:
            (scratch / "data").write_bytes(data)
            self.put(scratch / "data", name)
        finally:
            shutil.rmtree(scratch, ignore_errors=True)

    def read(self, name: str) -> bytes | None:
        """Implements the protocol."""
        with store_errors(f"{self.address}/{name}"), contextlib.suppress(FileNotFoundError):
            data = self._files.cat_file(f"{self._folder}/{name}")
            if isinstance(data, bytes):
                return data
        return None

    def size(self, name: str) -> int | None:
        """Implements the protocol."""
        with store_errors(f"{self.address}/{name}"), contextlib.suppress(FileNotFoundError):
            self._files.invalidate_cache()
            return int(self._files.size(f"{self._folder}/{name}"))
        return None

    def remove(self, name: str) -> None:
        """Implements the protocol."""
        with store_errors(f"{self.address}/{name}"), contextlib.suppress(FileNotFoundError):
            self._files.rm_file(f"{self._folder}/{name}")

    def names(self, folder: str) -> list[str]:
        """Implements the protocol."""
        with store_errors(f"{self.address}/{folder}"), contextlib.suppress(FileNotFoundError):
            self._files.invalidate_cache()
            found = self._files.ls(f"{self._folder}/{folder}".rstrip("/"), detail=False)
            return sorted(str(path).rstrip("/").rpartition("/")[2] for path in found)
        return []
