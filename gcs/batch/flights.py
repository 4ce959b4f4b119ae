"""Which flights a batch is about: words of a command line in, names and addresses out."""

from __future__ import annotations

import glob
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

from gcs.batch.addresses import is_pattern, is_remote, last_part, local_path, remote_files, store_errors
from gcs.errors import BatchError
from infra.files.safe_open import read_small
from infra.files.segment import segments
from infra.secrets import concealed, hide
from infra.session_format import LOG

MOST_LIST_BYTES = 64 << 20
"""Maximum bytes of a list: a hundred thousand signed addresses."""
LOG_SUFFIX = ".tlog"
_MOST_SHOWN = 200


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
    or an address with a protocol, as ``s3://bucket/flights/*``. ``NAME=WORD`` gives a single flight another name.

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
            raise BatchError(f"{concealed(word)[:_MOST_SHOWN]}: {why}") from error


def _flights_of(word: str, folder: Path, note: Callable[[str], None]) -> Iterator[BatchFlight]:
    name, named, rest = word.partition("=")
    if named and name and "/" not in name and not (folder / word).exists():
        hide(rest)
        found = list(_addresses(rest, folder, note))
        if len(found) != 1:
            raise BatchError(f"{word}: {len(found)} flights there; a name is for one")
        yield BatchFlight(_checked(name), found[0])
    else:
        for address in _addresses(word, folder, note):
            yield BatchFlight(_checked(_name_of(address)), address)


def _lines(path: Path) -> Iterator[str]:
    try:
        text = read_small(path, MOST_LIST_BYTES).decode()
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
    return last_part(address).removesuffix(LOG_SUFFIX)


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
        # a folder without any is a broken flight, and is told as that
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
    for path, told in sorted(found.items()):
        if told["type"] == "directory" or path.endswith(LOG_SUFFIX):
            yield files.unstrip_protocol(path.rstrip("/"))
        else:
            note(f"{path}: neither a folder nor a {LOG_SUFFIX}; left out")
    if not found:
        note(f"{word}: nothing there is called so")
