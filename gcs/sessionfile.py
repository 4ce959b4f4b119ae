"""``session.toml`` over its life: locked while the flight's process lives, sealed at its end or at the next start."""

from __future__ import annotations

import contextlib
import fcntl
import os
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import tomli_w

from gcs.config import Mission
from gcs.errors import SessionError
from gcs.session import mission_table
from gcs.sessionlog import SessionLog
from mavlink.errors import TlogError

__all__ = ["Interrupted", "SessionFile", "seal", "seal_interrupted"]

NAME = "session.toml"


class SessionFile:
    """The notes of a flight that goes on.

    Raises:
        SessionError: the file cannot be made.
    """

    def __init__(self, folder: Path, mission: Mission) -> None:
        self._path = folder / NAME
        self._mission = mission
        self._notes: dict[str, Any] = {
            "format": 1,
            "program": f"rollcall-gcs {version('rollcall-gcs')}",
            "started": datetime.now(UTC),
        }
        self._fd = -1
        try:
            self._write()
        except OSError as error:
            raise SessionError(f"{self._path}: cannot be written: {error.strerror}; choose another place") from error

    def restore(self) -> None:
        """Write it again when somebody deleted it; a disk that does not take it is tried again at the next call."""
        if not self._path.exists():
            with contextlib.suppress(OSError):  # the alarm is that of the files beside it
                self._path.parent.mkdir(parents=True, exist_ok=True)
                self._write()

    def close(self, notes: Mapping[str, Any]) -> None:
        """Seal the session; where the disk does not take it, the next start does."""
        self._notes |= {"ended": datetime.now(UTC), **notes}
        with contextlib.suppress(OSError):
            self._write()
        if self._fd >= 0:
            os.close(self._fd)
            self._fd = -1

    def _write(self) -> None:
        fd = _replace(self._path, mission_table(self._mission, self._notes))
        if self._fd >= 0:
            os.close(self._fd)
        self._fd = fd


def _replace(path: Path, text: str) -> int:
    """Put a new file in the place of the old one, in one step and locked from the start; returns it open."""
    new = path.with_name(path.name + ".new")
    fd = os.open(new, os.O_RDWR | os.O_CREAT | os.O_TRUNC, 0o644)
    try:
        fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        with os.fdopen(fd, "wb", closefd=False) as file:
            file.write(text.encode())
        os.fsync(fd)
        new.replace(path)
    except BlockingIOError:
        os.close(fd)  # somebody else is at it
        raise
    except OSError:
        new.unlink(missing_ok=True)
        os.close(fd)
        raise
    return fd


@dataclass(frozen=True, slots=True, kw_only=True)
class Interrupted:
    """A recording that nobody had ended."""

    folder: Path
    records: int
    """Telemetry records that can be read."""
    ended: datetime
    """When its last file was written."""
    trouble: str = ""
    """Why it could not be sealed; empty: it was."""

    @property
    def text(self) -> str:
        """One line for the operator."""
        found = f"{self.folder.name}: interrupted at {self.ended:%Y-%m-%d %H:%M:%S}Z, {self.records} telemetry records"
        return f"{found}; cannot be sealed: {self.trouble}" if self.trouble else f"{found}; sealed"


def seal_interrupted(parent: Path) -> list[Interrupted]:
    """Seal the sessions in a folder that were interrupted; those of living processes and all data are left alone."""
    return [found for file in sorted(parent.glob(f"*/{NAME}")) if (found := seal(file.parent)) is not None]


def seal(folder: Path) -> Interrupted | None:
    """Note in an interrupted session when it ended and what it holds; None: ended, being written, or not recorded."""
    path = folder / NAME
    try:
        fd = os.open(path, os.O_RDONLY)
    except OSError:
        return None
    try:
        fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if os.fstat(fd).st_ino != path.stat().st_ino:
            return None  # sealed by somebody else a moment ago
        table = tomllib.loads(path.read_text(encoding="utf-8"))
        notes = table.get("session", {})
        return _seal(folder, table) if "started" in notes and "ended" not in notes else None
    except BlockingIOError:
        return None
    except (OSError, ValueError, TypeError) as error:
        return Interrupted(folder=folder, records=0, ended=datetime.fromtimestamp(0, UTC), trouble=f"{NAME}: {error}")
    finally:
        os.close(fd)


def _seal(folder: Path, table: dict[str, Any]) -> Interrupted:
    last_s = max(file.stat().st_mtime for file in folder.iterdir())
    found = Interrupted(folder=folder, records=_records(folder), ended=datetime.fromtimestamp(int(last_s), UTC))
    table["session"] |= {"ended": found.ended, "packets": found.records, "interrupted": True}
    try:
        os.close(_replace(folder / NAME, tomli_w.dumps(table)))
    except OSError as error:
        return replace(found, trouble=error.strerror or str(error))
    return found


def _records(folder: Path) -> int:
    try:
        return len(SessionLog(folder / "telemetry.tlog"))
    except (TlogError, SessionError):
        return 0
