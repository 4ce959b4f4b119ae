"""``session.toml``: the mission as it flew, and the ``[session]`` table with what a replay has to know beside it.

It is locked while the flight's process lives, and sealed at its end or at the next start. Keys and models are in it
by their fingerprints.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import secrets
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime, timedelta
from importlib.metadata import version
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeVar

from gcs.errors import SessionError
from gcs.mission.mission import Mission
from gcs.mission.written import mission_tables
from gcs.session.log import SessionLog
from infra.files.safe_open import create, open_folder, open_to_read
from infra.files.segment import segments
from infra.session_format import LOG, METADATA
from infra.toml_tables import MAX_TOML_BYTES, parse_toml, toml_text
from mavlink.errors import TlogError
from mavlink.signing.keys import KeyRing

Kind = TypeVar("Kind")

PROGRAM = f"rollcall-gcs {version('rollcall-gcs')}"
FLEET = "fleet"
"""Word in place of a system id: the key of all who have none of their own."""
MAX_COUNTED_BYTES = 8 << 30
"""A day at 100 kB/s; to count the records of more would take minutes."""


EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_FARTHEST_S = 1e9
"""Farthest time of anything from a film that was imported."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightNotes:
    """The notes of a recording; all empty for one that was not flown."""

    flown: bool = False
    """True if this program recorded it in flight."""
    program: str = ""
    keys: Mapping[str, str] = field(default_factory=dict)
    """Fingerprints by system id, as text, or ``FLEET``."""
    models: Mapping[str, str] = field(default_factory=dict)
    """SHA-256 of the networks that looked, by what they are for."""
    lost: Mapping[str, int] = field(default_factory=dict)
    """Rows that the disk did not take, by file."""
    refused: int | None = None
    """Records that were rejected; None: the flight was not ended in order."""
    imported: tuple[tuple[str, str], ...] = ()
    """Account of each file that an import read."""
    spans: tuple[tuple[str, tuple[tuple[float, float], ...]], ...] = ()
    """Vehicles of which such a file tells, and from and to which seconds of the film."""
    started_us: int = 0
    """Start and end of the flight, Unix µs; 0 unknown."""
    ended_us: int = 0

    @classmethod
    def from_table(cls, table: object) -> FlightNotes:
        """Read the ``[session]`` table; what is not of the right kind is left out."""
        if not isinstance(table, Mapping):
            return cls()
        refused = table.get("refused")
        return cls(
            flown="started" in table,
            program=str(table.get("program", "")),
            keys=_values_of(str, table.get("keys")),
            models=_values_of(str, table.get("models")),
            lost=_values_of(int, table.get("lost")),
            refused=refused if isinstance(refused, int) else None,
            imported=tuple(import_rows(table.get("imported"))),
            spans=tuple(_import_spans(table.get("imported"))),
            started_us=_unix_us(table.get("started")),
            ended_us=_unix_us(table.get("ended")),
        )

    def had_key_for(self, system_id: int) -> bool:
        """Tell whether the flight had a key for a system."""
        return str(system_id) in self.keys or FLEET in self.keys


def _unix_us(value: object) -> int:
    """0 for what is no time with a zone."""
    if not isinstance(value, datetime) or value.tzinfo is None:
        return 0
    return (value - EPOCH) // timedelta(microseconds=1)


def key_notes(ring: KeyRing) -> dict[str, str]:
    """Fingerprints of all keys."""
    notes = {str(system_id): key.fingerprint for system_id, key in sorted(ring.keys.items())}
    return notes | ({FLEET: ring.default.fingerprint} if ring.default else {})


def _values_of(kind: type[Kind], table: object) -> dict[str, Kind]:
    """The values of a table that are of a kind."""
    if not isinstance(table, Mapping):
        return {}
    return {str(name): value for name, value in table.items() if isinstance(value, kind)}


def import_rows(table: object) -> Iterator[tuple[str, str]]:
    """Rows of the account that an import has written, file by file; of anything else nothing."""
    for each in _sources(table):
        yield str(each.get("role", "")), str(each.get("name", ""))
        for what in ("clock", "read", "assumed"):
            values = each.get(what)
            yield from (
                (what, text) for text in (values if isinstance(values, list) else [values]) if isinstance(text, str)
            )
        yield from (("left out", f"{n} {reason}") for reason, n in _values_of(int, each.get("left_out")).items())


def _import_spans(table: object) -> Iterator[tuple[str, tuple[tuple[float, float], ...]]]:
    """Vehicles and spans by the account that an import has written; what can be none is left out."""
    for each in _sources(table):
        for whose, parts in _values_of(list, each.get("spans")).items():
            yield whose, tuple((part[0], part[1]) for part in parts if _is_span(part))


def _is_span(part: object) -> bool:
    if not (isinstance(part, list) and len(part) == 2 and all(isinstance(end, float) for end in part)):
        return False
    return bool(-_FARTHEST_S < part[0] <= part[1] < _FARTHEST_S)


def _sources(table: object) -> list[Mapping[str, Any]]:
    sources = table.get("sources") if isinstance(table, Mapping) else None
    return [each for each in (sources if isinstance(sources, list) else []) if isinstance(each, Mapping)]


def mission_table(mission: Mission, notes: Mapping[str, Any]) -> str:
    """The text of ``session.toml``: the mission as it flew and a ``[session]`` table of notes."""
    text = toml_text({"session": dict(notes), **mission_tables(mission)})
    tomllib.loads(text)
    return text


class SessionFile:
    """The notes of a flight that goes on.

    Raises:
        SessionError: the file cannot be made.
    """

    def __init__(self, folder: Path, mission: Mission, notes: Mapping[str, Any] = MappingProxyType({})) -> None:
        self._path = folder / METADATA
        self._mission = mission
        self._notes: dict[str, Any] = {
            "format": 1,
            "program": PROGRAM,
            "started": datetime.now(UTC),
            **notes,
        }
        self._fd = self._folder = -1
        try:
            self._folder = open_folder(folder)
            self._write()
        except OSError as error:
            raise SessionError(f"{self._path}: cannot be written: {error.strerror}; choose another place") from error

    def restore(self) -> None:
        """Write the file again if it was deleted; where that fails the next call tries again."""
        if not self._path.exists() and not self._path.parent.is_symlink():
            with contextlib.suppress(OSError):  # the alarm is that of the files beside it
                self._path.parent.mkdir(mode=0o755, parents=True, exist_ok=True)
                self._write()

    def close(self, notes: Mapping[str, Any]) -> None:
        """Seal the session; where the disk does not take it, the next start does."""
        self._notes |= {"ended": datetime.now(UTC), **notes}
        with contextlib.suppress(OSError):
            self._write()
        for fd in (self._fd, self._folder):
            if fd >= 0:
                os.close(fd)
        self._fd = self._folder = -1

    def _write(self) -> None:
        # one that was deleted is made again under its name; where a link has taken its place it stays where it is
        folder = os.dup(self._folder) if self._path.parent.is_symlink() else open_folder(self._path.parent)
        try:
            fd = _replace(folder, mission_table(self._mission, self._notes))
        finally:
            os.close(folder)
        if self._fd >= 0:
            os.close(self._fd)
        self._fd = fd


def _replace(folder: int, text: str) -> int:
    """Put a new file in the place of the old one, in one step and locked from the start; returns it open.

    The new file has a random name, so that no link can have been put in its place.
    """
    new = f"{METADATA}.{secrets.token_hex(8)}.new"
    fd = create(new, folder=folder)
    try:
        fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        with os.fdopen(fd, "wb", closefd=False) as file:
            file.write(text.encode())
        os.fsync(fd)
        os.rename(new, METADATA, src_dir_fd=folder, dst_dir_fd=folder)
    except OSError:
        os.unlink(new, dir_fd=folder)
        os.close(fd)
        raise
    return fd


@dataclass(frozen=True, slots=True, kw_only=True)
class Interrupted:
    """A recording whose flight did not end in order."""

    folder: Path
    records: int | None = None
    """Telemetry records that can be read; None: not counted."""
    ended: datetime | None = None
    """Time at which its last file was written; None where that could not be found out."""
    trouble: str = ""
    """Reason why it could not be sealed; empty: it was."""

    @property
    def text(self) -> str:
        """One line for the operator."""
        when = f"interrupted at {self.ended:%Y-%m-%d %H:%M:%S}Z, " if self.ended else ""
        held = f"{self.records} telemetry records; " if self.records is not None else ""
        return f"{self.folder.name}: {when}{held}" + (f"cannot be sealed: {self.trouble}" if self.trouble else "sealed")


def recorded_folders(parent: Path) -> list[Path]:
    """The session folders in a folder, the newest first."""
    return sorted((file.parent for file in parent.glob(f"*/{METADATA}")), reverse=True)


def in_flight(folder: Path) -> bool:
    """Tell whether a process flies that records into this folder."""
    try:
        fd = open_to_read(folder / METADATA)
    except OSError:
        return False
    try:
        fcntl.flock(fd, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    finally:
        os.close(fd)
    return False


def seal(folder: Path) -> Interrupted | None:
    """Note in an interrupted session when it ended and what it holds; None: ended, being written, or not recorded.

    Neither the folder nor its files may be links: they could lead to what its author must not read or change.
    """
    try:
        at = open_folder(folder)
    except OSError:
        return None
    try:
        return _seal_locked(folder, at)
    except BlockingIOError:
        return None
    except OSError as error:
        return Interrupted(folder=folder, trouble=f"{METADATA}: {error.strerror}")
    except (ValueError, TypeError) as error:
        return Interrupted(folder=folder, trouble=str(error))
    finally:
        os.close(at)


def _seal_locked(folder: Path, at: int) -> Interrupted | None:
    fd = open_to_read(METADATA, links=False, folder=at)
    with os.fdopen(fd, "rb") as file:
        fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if os.fstat(fd).st_ino != os.stat(METADATA, dir_fd=at, follow_symlinks=False).st_ino:
            return None  # sealed by another process a moment ago
        data = file.read(MAX_TOML_BYTES + 1)
        if len(data) > MAX_TOML_BYTES:
            return Interrupted(folder=folder, trouble=f"{METADATA}: larger than {MAX_TOML_BYTES >> 10} KiB")
        table = parse_toml(data, METADATA)
        notes = table.get("session", {})
        return _seal(folder, at, table) if "started" in notes and "ended" not in notes else None


def _seal(folder: Path, at: int, table: dict[str, Any]) -> Interrupted:
    with os.scandir(at) as files:
        last_s = max(file.stat(follow_symlinks=False).st_mtime for file in files)
    found = Interrupted(folder=folder, records=_records(folder), ended=datetime.fromtimestamp(int(last_s), UTC))
    counted = {} if found.records is None else {"packets": found.records}
    table["session"] |= {"ended": found.ended, **counted, "interrupted": True}
    try:
        os.close(_replace(at, toml_text(table)))
    except OSError as error:
        return replace(found, trouble=error.strerror or str(error))
    return found


def _records(folder: Path) -> int | None:
    path = folder / LOG
    try:
        if sum(part.stat().st_size for part in segments(path)) > MAX_COUNTED_BYTES:
            return None
        return len(SessionLog(path))
    except (TlogError, SessionError):
        return 0
