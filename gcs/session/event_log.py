"""``events.jsonl``: links, alarms, operator actions, identity changes; one JSON object a line."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import msgspec

from gcs.session.line_file import Lines, open_new
from gcs.snapshot import Event, Level
from infra.plain_text import plain

__all__ = ["EventLog", "event_row"]

_LEVELS: Mapping[Level, int] = {"info": logging.INFO, "warning": logging.WARNING, "alarm": logging.ERROR}

_log = logging.getLogger(__name__)


class EventLog:
    """Writes ``events.jsonl``: links, alarms, operator actions, identity changes; the program's log has them too."""

    def __init__(self, path: Path, open_file: Callable[[Path, str], Lines] = open_new) -> None:
        self._file = open_file(path, "")

    def write(self, events: Sequence[Event]) -> None:
        """Append events, one JSON object a line."""
        if not events:
            return
        self._file.write("".join(event_row(event) + "\n" for event in events))
        self._file.flush()
        for event in events:
            _log.log(_LEVELS[event.level], "%s: %s", event.kind, event.text)

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def event_row(event: Event) -> str:
    """One line of ``events.jsonl``."""
    row = {"time_us": event.t_us, "level": event.level, "kind": event.kind, "system_id": event.system_id or None}
    return msgspec.json.encode(row | {"text": plain(event.text)}).decode()
