"""Inputs that a result depends on: the files of a recording, and a hash that tells whether they are the same."""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from gcs.batch.addresses import remote_files, store_errors
from gcs.errors import BatchError, StoreError
from gcs.mission.mission import BUNDLED, Mission
from infra.session_format import EVENTS, IDENTITY, IDENTITY_EVIDENCE, LOG, MARKS, PROGRAM_LOG

_NOT_READ = frozenset((IDENTITY.name, IDENTITY_EVIDENCE, MARKS, PROGRAM_LOG, "faults.txt"))
"""Files of a session that no identification reads: what it wrote itself, and what was made later."""


MOST_FETCH_BYTES, MOST_FETCH_S = 64 << 30, 7200.0
"""Limits of fetching one flight out of a store: eighteen hours of video at 8 Mbit/s."""


def _is_read(name: str) -> bool:
    return name not in _NOT_READ and not name.startswith(".")


def input_files(path: Path) -> list[Path]:
    """All files of a recording that its identification may read, in order.

    Raises:
        BatchError: nothing there.
    """
    if path.is_dir():
        return sorted(file for file in path.iterdir() if file.is_file() and _is_read(file.name))
    if not path.is_file():
        raise BatchError(f"{path}: no such session folder or telemetry log")
    if path.name == LOG:  # its segments and tables lie beside it
        return input_files(path.parent)
    return [path, *(file for file in [path.with_name(EVENTS)] if file.is_file())]


def mission_files(mission: Mission | None) -> list[Path]:
    """Files that a mission names and an identification reads, wherever they are."""
    if mission is None:
        return []
    named = [mission.detector.model, mission.detector.front, mission.map.terrain]
    return [Path(text) for text in named if text and text != BUNDLED]


def inputs_hash(files: Sequence[Path]) -> str:
    """SHA-256 over the names and contents of files, wherever they are.

    Raises:
        BatchError: one cannot be read.
    """
    whole = hashlib.sha256()
    for path in files:
        try:
            with path.open("rb") as file:
                content = hashlib.file_digest(file, "sha256").hexdigest()
        except OSError as error:
            raise BatchError(f"{path}: cannot be read: {error.strerror}") from error
        whole.update(f"{json.dumps(path.name)} {content}\n".encode())
    return whole.hexdigest()


def files_stamp(files: Sequence[Path]) -> tuple[tuple[str, int, int], ...]:
    """Name, size and time of change of files: another value tells that one was changed meanwhile."""
    return tuple((path.name, path.stat().st_size, path.stat().st_mtime_ns) for path in files if path.exists())


def _remote_listing(address: str) -> Iterator[tuple[str, str]]:
    """Path of each file of a recording in a store, and what the store tells apart its contents by."""
    files, path = remote_files(address)
    files.invalidate_cache()
    told = files.info(path)
    listed = [told] if told["type"] == "file" else files.ls(path, detail=True)
    for each in sorted(listed, key=lambda info: str(info["name"])):
        name = str(each["name"])
        if each["type"] == "file" and _is_read(name.rpartition("/")[2]):
            yield name, str(files.ukey(name))


def remote_stamp(address: str) -> str:
    """Stamp of a recording's files by its store, such as their ETags: the same while none is changed.

    Raises:
        StoreError: it cannot be listed.
    """
    with store_errors(address):
        listed = list(_remote_listing(address))
    return hashlib.sha256(json.dumps(listed).encode()).hexdigest()


def fetch(address: str, place: Path) -> None:
    """Copy a recording out of a store.

    Args:
        address: of a session folder or a telemetry log.
        place: path of this machine that the folder or the log gets.

    Raises:
        StoreError: it cannot be fetched, or is larger or slower than a flight.
    """
    # only those who fetch have it
    from fsspec.callbacks import Callback

    class _Bounded(Callback):  # type: ignore[misc]
        """Counts what comes of all files, and breaks it off when it is too much."""

        def __init__(self) -> None:
            super().__init__()
            self._came, self._until_s = 0, time.monotonic() + MOST_FETCH_S

        def relative_update(self, inc: int = 1) -> None:
            self._came += inc
            if self._came > MOST_FETCH_BYTES or time.monotonic() > self._until_s:
                most = f"{MOST_FETCH_BYTES >> 30} GiB or {MOST_FETCH_S / 3600:g} h"
                raise StoreError(f"more than {most} for one flight; fetch it yourself")

    with store_errors(address):
        files, path = remote_files(address)
        is_file = files.info(path)["type"] == "file"
        (place.parent if is_file else place).mkdir(parents=True, exist_ok=True)
        coming = _Bounded()
        for name, _ in _remote_listing(address):
            files.get_file(name, str(place if is_file else place / Path(name).name), callback=coming)
