"""The flights of a batch: words of a command line in, names and addresses out.

A result depends on the files of its recording; a hash tells whether they are the same.
"""

from __future__ import annotations

import glob
import hashlib
import json
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

from gcs.batch.addresses import is_pattern, is_remote, last_part, local_path, remote_files, store_errors
from gcs.errors import BatchError, StoreError
from gcs.mission.mission import BUNDLED, Mission
from gcs.session.session import VIEW
from infra.files.safe_open import read_small
from infra.files.segment import segments
from infra.secrets import concealed, hide
from infra.session_format import (
    EVENTS,
    FRAMES,
    IDENTITY,
    IDENTITY_EVIDENCE,
    LOG,
    MARKS,
    PROGRAM_LOG,
    VIEW_FOLDER,
)

MAX_LIST_BYTES = 64 << 20
"""Maximum bytes of a list: a hundred thousand signed addresses."""
LOG_SUFFIX = ".tlog"
_MAX_SHOWN = 200
_NOT_READ = frozenset((IDENTITY.name, IDENTITY_EVIDENCE, MARKS, PROGRAM_LOG, "faults.txt"))
"""Files of a session that no identification reads: what it wrote itself, and what was made later."""
MAX_FETCH_BYTES, MAX_FETCH_S = 64 << 30, 7200.0
"""Limits of fetching one flight out of a store: eighteen hours of video at 8 Mbit/s."""


@dataclass(frozen=True, slots=True)
class BatchFlight:
    """One flight of a batch."""

    name: str
    """Name of its results; no other flight of the batch has it."""
    address: str
    """Absolute path of a session folder or telemetry log, or where fsspec finds it."""


def find_flights(
    words: Iterable[str], note: Callable[[str], None] = lambda text: None, *, lists: Iterable[Path] = ()
) -> list[BatchFlight]:
    """The flights that words stand for, in their order, each once.

    A word is a session folder, a folder of session folders, a telemetry log, a pattern of those (``*``, ``?``, ``[]``),
    or an address with a protocol, as ``s3://bucket/flights/*``. ``NAME=WORD`` gives a single flight another name. What
    a second camera recorded is a flight of its own, ``NAME.view-2``.

    Args:
        words: as given by the user.
        note: called with a line for what is left out.
        lists: files with a word on each line; ``#`` begins a comment, paths are relative to the list.

    Raises:
        BatchError: no flight at all, two of one name, or a list that cannot be read.
    """
    by_name: dict[str, BatchFlight] = {}
    given = [(words, Path()), *((_lines(path), path.parent) for path in lists)]
    for flight in chain.from_iterable(_flights(each, folder, note) for each, folder in given):
        known = by_name.setdefault(flight.name, flight)
        if known.address != flight.address:
            raise BatchError(
                f"two flights are called {flight.name}: {concealed(known.address)} and {concealed(flight.address)}; "
                f"give one another name, as OTHER={concealed(flight.address)}"
            )
    if not by_name:
        raise BatchError("not one flight found; give session folders, telemetry logs, patterns of them, or a --list")
    return list(by_name.values())


def _flights(words: Iterable[str], folder: Path, note: Callable[[str], None]) -> Iterator[BatchFlight]:
    for word in words:
        hide(word)
        try:
            yield from _flights_of(word, folder, note)
        except (OSError, RuntimeError) as error:  # of a link to itself Python makes a RuntimeError
            why = error.strerror if isinstance(error, OSError) else "links that lead in a circle"
            raise BatchError(f"{concealed(word)[:_MAX_SHOWN]}: {why}") from error


def _flights_of(word: str, folder: Path, note: Callable[[str], None]) -> Iterator[BatchFlight]:
    name, named, rest = word.partition("=")
    if named and name and "/" not in name and not (folder / word).exists():
        hide(rest)
        found = list(_addresses(rest, folder, note))
        if len(found) != 1:
            raise BatchError(f"{word}: {len(found)} flights there; a name is for one")
        yield from _cameras(_checked(name), found[0])
    else:
        for address in _addresses(word, folder, note):
            yield from _cameras(_checked(_name_of(address)), address)


def _cameras(name: str, address: str) -> Iterator[BatchFlight]:
    """A flight, and what each further camera of it recorded as one of its own."""
    yield BatchFlight(name, address)
    if not is_remote(address):
        for folder in sorted(Path(address).glob(VIEW_FOLDER.format("*"))):
            if VIEW.fullmatch(folder.name) and any(_has_frames(folder)):
                yield BatchFlight(f"{name}.{folder.name}", str(folder))


def _has_frames(folder: Path) -> Iterator[bool]:
    """Tell of each table of frames whether it has a row."""
    for part in segments(folder / FRAMES.name):
        yield part.stat().st_size > len(FRAMES.header)


def _lines(path: Path) -> Iterator[str]:
    try:
        text = read_small(path, MAX_LIST_BYTES).decode()
    except OSError as error:
        raise BatchError(f"{path}: cannot be read as a list of flights: {error.strerror}") from error
    except ValueError as error:
        raise BatchError(f"{path}: cannot be read as a list of flights: {error}") from error
    if "\0" in text:
        raise BatchError(f"{path}: cannot be read as a list of flights: a zero byte in it, which no name has")
    lines = (line.strip() for line in text.splitlines())
    return (line for line in lines if line and not line.startswith("#"))


def _checked(name: str) -> str:
    if not name.isprintable() or name in ("", ".", ".."):
        raise BatchError(f"{name!r} is no name for a flight; give it one, as NAME=ADDRESS")
    return name


def _name_of(address: str) -> str:
    name = last_part(address).removesuffix(LOG_SUFFIX)
    # a further camera's folder is called alike in all flights
    return f"{last_part(address.rpartition('/')[0])}.{name}" if VIEW.fullmatch(name) else name


def _addresses(word: str, folder: Path, note: Callable[[str], None]) -> Iterator[str]:
    if is_remote(word):
        yield from _remote_addresses(word, note)
        return
    path = folder / local_path(word)
    if concealed(word) != word and not path.exists():
        raise BatchError(f"{concealed(word)}: no such file or folder; an address begins with a protocol, as https://")
    if is_pattern(word) and not path.exists():
        found = sorted(glob.glob(str(path)))  # noqa: PTH207 - of a path that may be absolute
        if not found:
            note(f"{word}: nothing there is called so")
        paths = [Path(each) for each in found]
    else:
        paths = [path]
    for each in paths:
        yield from _local_addresses(each, note)


def _local_addresses(path: Path, note: Callable[[str], None]) -> Iterator[str]:
    if path.is_dir() and not segments(path / LOG):
        inside = sorted(folder for folder in path.iterdir() if folder.is_dir() and segments(folder / LOG))
        # a folder without any is a broken flight, and is reported as that
        yield from (str(folder.resolve()) for folder in inside or [path])
    elif path.is_file() and path.suffix.lower() != LOG_SUFFIX:
        note(
            f"{path}: neither a session folder nor a {LOG_SUFFIX}; left out. A list of flights is given as --list FILE"
        )
    else:
        yield str(path.resolve())


def _remote_addresses(word: str, note: Callable[[str], None]) -> Iterator[str]:
    """An address as it is; of a pattern what matches. Nothing else is asked of the store: it may hold a million."""
    if not is_pattern(word):
        yield word.rstrip("/")
        return
    with store_errors(word):
        files, pattern = remote_files(word)
        found = files.glob(pattern, detail=True)
    for path, entry in sorted(found.items()):
        if entry["type"] == "directory" or path.endswith(LOG_SUFFIX):
            yield files.unstrip_protocol(path.rstrip("/"))
        else:
            note(f"{path}: neither a folder nor a {LOG_SUFFIX}; left out")
    if not found:
        note(f"{word}: nothing there is called so")


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
    entry = files.info(path)
    listed = [entry] if entry["type"] == "file" else files.ls(path, detail=True)
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

    Raises:
        StoreError: it cannot be fetched, or is larger or slower than a flight.
    """
    # only those who fetch have it
    from fsspec.callbacks import Callback

    class _Bounded(Callback):  # type: ignore[misc]
        """Callback that counts the bytes of all files, and breaks the download off when they are too many."""

        def __init__(self) -> None:
            super().__init__()
            self._came, self._until_s = 0, time.monotonic() + MAX_FETCH_S

        def relative_update(self, inc: int = 1) -> None:
            self._came += inc
            if self._came > MAX_FETCH_BYTES or time.monotonic() > self._until_s:
                most = f"{MAX_FETCH_BYTES >> 30} GiB or {MAX_FETCH_S / 3600:g} h"
                raise StoreError(f"more than {most} for one flight; fetch it yourself")

    with store_errors(address):
        files, path = remote_files(address)
        is_file = files.info(path)["type"] == "file"
        (place.parent if is_file else place).mkdir(parents=True, exist_ok=True)
        coming = _Bounded()
        for name, _ in _remote_listing(address):
            files.get_file(name, str(place if is_file else place / Path(name).name), callback=coming)
