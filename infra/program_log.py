"""The program's log: records of the standard library's ``logging`` into files, from several processes into one.

Quiet until a log file is asked for. Logging never waits for the disk: a thread of each file writes. A file is
bounded in size; what is not ours, a text from the air for instance, can neither begin a line of its own nor control a
terminal.
"""

from __future__ import annotations

import contextlib
import json
import logging
import os
import queue
import sys
import threading
import time
import traceback
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import TextIO

from infra.files.safe_open import open_to_append
from infra.plain_text import plain
from infra.secrets import conceal

PACKAGES = ("gcs", "mavlink", "vision", "assoc", "sim", "infra")
"""Loggers whose records are written: libraries may put a password into theirs."""
MAX_BYTES = 16 << 20
"""Maximum bytes of one file: some hundred thousand lines; what comes after is left out."""
MAX_WAITING = 10_000
"""Lines that wait for a disk; more are counted and left out."""
CLOSE_S = 1.0
"""Closing waits this long for a disk that hangs."""
_VARIABLE = "ROLLCALL_LOG"
"""Passes the files and levels to child processes, as JSON."""

_log = logging.getLogger(__name__)
_handlers: list[logging.Handler] = []


def least_level(otherwise: int) -> int:
    """The lowest level that was asked for, or the given one if that is lower."""
    return min([otherwise, *(handler.level for handler in _handlers)])


class PlainFormatter(logging.Formatter):
    """One line a record, in UTC, and indented lines for its traceback; all of them plain text without secrets."""

    def format(self, record: logging.LogRecord) -> str:
        """Format a record."""
        when = time.strftime("%Y-%m-%dT%H:%M:%S", time.gmtime(record.created))
        head = f"{when}.{int(record.msecs):03d}Z {record.levelname:<7} {record.process} {record.name}: "
        lines = [head + plain(record.getMessage())]
        if record.exc_info:
            trace = "".join(traceback.format_exception(*record.exc_info))
            lines += ["    " + plain(line) for line in trace.splitlines()]
        return conceal("\n".join(lines))


class LogFile(logging.Handler):
    """Appends the records of our packages to a file, from when it is made until it is closed.

    Several processes may append to one file.

    Args:
        path: made with the first record, in a folder that no link stands for; a file that is there is gone on with.
        level: least level of what is written.
    """

    def __init__(self, path: Path, level: int = logging.INFO) -> None:
        super().__init__(level)
        self.path = path
        self.setFormatter(PlainFormatter())
        self._lines: queue.Queue[str] = queue.Queue(MAX_WAITING)
        self._left_out, self._closing = 0, False
        self._thread = threading.Thread(target=self._write_lines, name=f"log {path.name}", daemon=True)
        self._thread.start()
        _attach(self)

    def emit(self, record: logging.LogRecord) -> None:
        """Have a record written."""
        try:
            self._lines.put_nowait(self.format(record))
        except queue.Full:
            self._left_out += 1

    def close(self) -> None:
        """Write what waits, but for a disk that hangs; twice does nothing."""
        if self in _handlers:
            _detach(self)
            self._closing = True
            with contextlib.suppress(queue.Full):  # then it need not be woken
                self._lines.put_nowait("")
            self._thread.join(CLOSE_S)
        super().close()

    def _write_lines(self) -> None:
        fd = -1
        while not (self._closing and self._lines.empty()):
            if not (line := self._lines.get()):
                continue
            left_out, self._left_out = self._left_out, 0
            note = f"{left_out} lines were left out\n" if left_out else ""
            with contextlib.suppress(OSError):  # a log is no reason to fail; the alarm is that of the record's files
                fd = open_to_append(self.path, links=False) if fd < 0 else fd
                if os.fstat(fd).st_size < MAX_BYTES:
                    os.write(fd, f"{line}\n{note}".encode(errors="replace"))  # one call: lines of processes do not mix
        if fd >= 0:
            os.close(fd)


def log_to_stream(stream: TextIO, level: int) -> None:
    """Write the records of our packages to a stream, in the thread that logs."""
    handler = logging.StreamHandler(stream)
    handler.setLevel(level)
    handler.setFormatter(PlainFormatter())
    _attach(handler)


def _attach(handler: logging.Handler) -> None:
    _handlers.append(handler)
    for package in PACKAGES:
        logging.getLogger(package).addHandler(handler)
    _set_levels()


def _detach(handler: logging.Handler) -> None:
    _handlers.remove(handler)
    for package in PACKAGES:
        logging.getLogger(package).removeHandler(handler)
    _set_levels()


def _set_levels() -> None:
    """Let through what any handler asks for."""
    level = min((handler.level for handler in _handlers), default=logging.NOTSET)
    for package in PACKAGES:
        logging.getLogger(package).setLevel(level)


def child_environment() -> Mapping[str, str]:
    """Environment that a child process needs to log into the same files."""
    files = [(str(file.path.absolute()), file.level) for file in _handlers if isinstance(file, LogFile)]
    return {_VARIABLE: json.dumps(files)}


def log_as_parent() -> None:
    """Log into the parent's files in a child process, errors that end a thread or the process among them."""
    with contextlib.suppress(ValueError):
        for path, level in json.loads(os.environ.get(_VARIABLE, "[]")):
            LogFile(Path(path), level)
    log_uncaught()


def log_uncaught() -> None:
    """Log what ends a thread or the process, and then do with it what is done without a log."""
    of_process, of_thread = sys.excepthook, threading.excepthook

    def process_ends(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
        _log.critical("an error ends the process", exc_info=(kind, error, trace))
        of_process(kind, error, trace)

    def thread_ends(args: threading.ExceptHookArgs) -> None:
        if args.exc_value is not None:
            _log.error("an error ends a thread", exc_info=args.exc_value)
        of_thread(args)

    sys.excepthook, threading.excepthook = process_ends, thread_ends
