"""``events.jsonl``: links, alarms, operator actions, identity changes; one JSON object a line.

``marks.jsonl`` has the same rows: marks that were made later, while the recording was replayed.
"""

from __future__ import annotations

import contextlib
import logging
import math
import os
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Literal

import msgspec

from gcs.session.line_file import Lines, open_new
from gcs.snapshot import NAN, Event, FleetChange, Statement
from infra.files.safe_open import open_to_append, open_to_read
from infra.files.segment import segments
from infra.plain_text import plain
from infra.session_format import EVENTS, MARKS
from mavlink.state import Level

VIDEO_AWAITED = "video waiting"
"""End of the text of the event that a flight waits for the first frame of a camera."""

_LEVELS: Mapping[Level, int] = {"info": logging.INFO, "warning": logging.WARNING, "alarm": logging.ERROR}

_log = logging.getLogger(__name__)
_Track = Annotated[int, msgspec.Meta(ge=1, le=1 << 40)]
_Frame = Annotated[int, msgspec.Meta(ge=0, le=1 << 31)]
_SystemId = Annotated[int, msgspec.Meta(ge=1, le=255)]
_Pixel = Annotated[float, msgspec.Meta(ge=-1e6, le=1e6)]


class EventLog:
    """Writes ``events.jsonl``: links, alarms, operator actions, identity changes; the program's log has them too.

    Args:
        whose: what stands before each in the program's log, where several write into it.
        uav_id: of whose camera and aircraft alone events go there; 0: all of them.
    """

    def __init__(
        self, path: Path, open_file: Callable[[Path, str], Lines] = open_new, *, whose: str = "", uav_id: int = 0
    ) -> None:
        self._file = open_file(path, "")
        self._whose, self._uav_id = whose, uav_id

    def write(self, events: Sequence[Event]) -> None:
        """Append events, one JSON object a line."""
        if not events:
            return
        self._file.write("".join(event_row(event) + "\n" for event in events))
        self._file.flush()
        for event in events if not self._uav_id else [each for each in events if each.is_of(self._uav_id)]:
            key = f" [{event.alarm_level} {event.alarm}]" if event.alarm_level else ""
            _log.log(_LEVELS[event.level], "%s%s: %s%s", self._whose, event.kind, event.text, key)

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def event_row(event: Event) -> str:
    """One line of ``events.jsonl``."""
    row = {"time_us": event.t_us, "level": event.level, "kind": event.kind, "system_id": event.system_id or None}
    alarm: dict[str, str | bool] = {"alarm": plain(event.alarm)} if event.alarm else {}
    if event.alarm_level:
        alarm |= {"alarm_level": event.alarm_level, "over": event.over}
    stated = {"statement": _statement_row(event.statement)} if event.statement else {}
    changed = {"change": msgspec.to_builtins(event.change)} if event.change else {}
    return msgspec.json.encode(row | {"text": plain(event.text)} | alarm | stated | changed).decode()


def _statement_row(statement: Statement) -> dict[str, int | float | bool | None]:
    """Null is unknown, or none of ours."""
    return {
        "track_id": statement.track_id,
        "system_id": statement.system_id or None,
        "frame": statement.frame,
        "cx": round(statement.cx, 2),
        "cy": round(statement.cy, 2),
        "undone": statement.undone,
    }


class _StatementRow(msgspec.Struct, frozen=True):
    """Statement of the operator, as it is read."""

    track_id: _Track
    frame: _Frame
    system_id: _SystemId | None = None
    cx: _Pixel | None = None
    cy: _Pixel | None = None
    undone: bool = False

    def statement(self) -> Statement:
        return Statement(
            track_id=self.track_id,
            system_id=self.system_id or 0,
            frame=self.frame,
            cx=NAN if self.cx is None else self.cx,
            cy=NAN if self.cy is None else self.cy,
            undone=self.undone,
        )


class _ChangeRow(msgspec.Struct, frozen=True):
    """Change by the operator about the fleet, as it is read."""

    what: Literal["added", "left out", "renamed"]
    system_id: _SystemId
    t_us: Annotated[int, msgspec.Meta(ge=1, le=1 << 60)]
    frame: Annotated[int, msgspec.Meta(ge=-1, le=1 << 31)]
    name: Annotated[str, msgspec.Meta(max_length=200)] = ""

    def change(self) -> FleetChange:
        return FleetChange(
            what=self.what, system_id=self.system_id, name=plain(self.name), t_us=self.t_us, frame=self.frame
        )


class _Row(msgspec.Struct, frozen=True):
    """Line of the event log as it is read; unknown keys are passed over."""

    time_us: int
    level: Level
    kind: str
    text: str
    system_id: int | None = None
    alarm: str = ""
    alarm_level: Level | Literal[""] = ""
    over: bool = False
    statement: _StatementRow | None = None
    change: _ChangeRow | None = None


def read_events(path: Path) -> tuple[list[Event], int]:
    """Events of one file in its order, and how many lines could not be used; none and 0 where there is no file.

    Raises:
        OSError: it cannot be read.
    """
    events: list[Event] = []
    skipped = 0
    try:
        file = os.fdopen(open_to_read(path), "rb")
    except FileNotFoundError:
        return events, skipped
    decoder = msgspec.json.Decoder(_Row)
    with file:
        for line in file:
            try:
                row = decoder.decode(line)
            except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
                skipped += 1
                continue
            events.append(
                Event(
                    t_us=row.time_us,
                    level=row.level,
                    kind=plain(row.kind),
                    text=plain(row.text),
                    system_id=row.system_id or 0,
                    alarm=plain(row.alarm),
                    alarm_level=row.alarm_level if row.alarm else "",
                    over=row.over,
                    statement=row.statement.statement() if row.statement else None,
                    change=row.change.change() if row.change else None,
                )
            )
    return events, skipped


def read_statements(folder: Path, ugv_ids: Collection[int]) -> list[Statement]:
    """Statements of the operator about boxes and a mission's ground vehicles, in all segments of ``events.jsonl``.

    Segments that cannot be read are passed over, as bad lines are: a replay reports both where it shows the events.
    """
    found = (event.statement for event in _all_events(folder))
    return [each for each in found if each is not None and each.system_id in (0, *ugv_ids)]


def read_changes(folder: Path) -> tuple[FleetChange, ...]:
    """Changes by the operator about the fleet, as :func:`read_statements` reads."""
    return tuple(event.change for event in _all_events(folder) if event.change is not None)


def video_awaited_us(folder: Path) -> float:
    """Unix time from which a flight waited for a video, µs; infinite where it did not say so."""
    found = (
        event.t_us for event in _all_events(folder) if event.kind == "video" and event.text.endswith(VIDEO_AWAITED)
    )
    return next(found, math.inf)


def _all_events(folder: Path) -> Iterator[Event]:
    for part in segments(folder / EVENTS):
        with contextlib.suppress(OSError):
            yield from read_events(part)[0]


def append_event(path: Path, event: Event) -> None:
    """Append one event to a file, made where there is none.

    Raises:
        OSError: it cannot be written.
    """
    fd = open_to_append(path)
    try:
        os.write(fd, (event_row(event) + "\n").encode())
    finally:
        os.close(fd)


def marks_path(recording: Path) -> Path:
    """File of the marks that are made while a recording is replayed: in a session's folder, beside a bare log."""
    return recording / MARKS if recording.is_dir() else recording.with_name(f"{recording.name}.{MARKS}")


def read_marks(recording: Path, start_us: int) -> list[Event]:
    """Marks of earlier replays in order of time; what cannot be read of them is reported beside them, at its start."""
    path = marks_path(recording)
    try:
        marks, skipped = read_events(path)
    except OSError as error:
        text = f"{path.name} cannot be read: {error.strerror}"
        return [Event(t_us=start_us, level="warning", kind="recording", text=text)]
    if skipped:
        text = f"{path.name}: {skipped} lines could not be read and were skipped"
        marks.append(Event(t_us=start_us, level="warning", kind="recording", text=text))
    return sorted(marks, key=lambda event: event.t_us)
