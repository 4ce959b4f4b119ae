"""Output of commands, and the one place where errors become exit codes.

Exit codes: 0 done; 1 a fault of the program; 2 input that cannot be used; 3 a link, port, disk or camera that is not
to be had, or a flight of which something could not be recorded; 4 done, but no box could be named; 5 a log that is
damaged (``gcs tlog check``); 6 a batch of which some flights failed.
"""

from __future__ import annotations

import contextlib
import errno
import io
import json
import math
import os
import shlex
import stat
import sys
import termios
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, TextIO

import typer

from assoc.errors import AssocError
from gcs.errors import ClusterError, GcsError, StoreError
from infra.files.disk import OF_THE_DISK
from infra.files.safe_open import open_to_append
from infra.plain_text import plain
from infra.secrets import conceal, hide
from mavlink.errors import LinkError, MavlinkError
from sim.errors import SimError
from vision.errors import VisionError

BAD_INPUT, NOT_AVAILABLE, NO_NAMES, SOME_FAILED = 2, 3, 4, 6

_OF_THE_NAME = (errno.ENAMETOOLONG, errno.ELOOP)
_MAX_SHOWN = 200
FRAME_SIZE = "Size of the frames that detections.csv is about, as 1280x720, where the recording does not know."
AsJson = Annotated[bool, typer.Option("--json", help="For programs: one JSON object a line.")]
MAX_PX = 16384
"""Longest side of any camera's picture."""
LogLevel = Literal["debug", "info", "warning", "error"]
CONSOLE = "console.log"
"""File in the session folder with the output of libraries while the screens are up."""
FAR_S = 1e9
"""Largest distance of a video from its log, some thirty years."""


def check_range(least: float, most: float) -> Callable[[typer.CallbackParam, float | None], float | None]:
    """A check for the number that an option is given: from least to most, and a number."""

    def checked(param: typer.CallbackParam, value: float | None) -> float | None:
        if value is not None and not least <= value <= most:
            raise GcsError(f"{param.opts[0]} {value:g}: give a number from {least:g} to {most:g}")
        return value

    return checked


VideoStart = Annotated[
    float,
    typer.Option(
        callback=check_range(-FAR_S, FAR_S),
        help="When a video without frames.csv begins, seconds after the log's first message.",
    ),
]


def parse_frame_size(text: str | None) -> tuple[int, int] | None:
    """Width and height in px from ``1280x720``.

    Raises:
        GcsError: it is no size.
    """
    if text is None:
        return None
    width, _, height = text.lower().replace("×", "x").partition("x")
    if not (width.isdecimal() and height.isdecimal() and 0 < int(width) <= MAX_PX and 0 < int(height) <= MAX_PX):
        raise GcsError(f"--frame-size {text}: is no size of a frame; give it as 1280x720")
    return int(width), int(height)


def hide_secrets(words: Sequence[str]) -> None:
    """Have nothing that is printed or logged repeat the passwords in addresses of the command line."""
    for word in words:
        # as --option=ADDRESS and NAME=ADDRESS too
        at = word.find("://")
        hide(word[word.rfind("=", 0, max(at, 0)) + 1 :])


def print_lines(*lines: str) -> None:
    """Lines of the command's result, on stdout; one that holds the end of a line is still one."""
    sys.stdout.write("".join(conceal(plain(line)) + "\n" for line in lines))
    sys.stdout.flush()


def print_json(table: Mapping[str, object]) -> None:
    """A result for programs: one JSON object, on one line; numbers that are unknown are null."""
    print_lines(json.dumps(_without_nan(table), allow_nan=False))


def _without_nan(value: object) -> object:
    if isinstance(value, Mapping):
        return {name: _without_nan(each) for name, each in value.items()}
    if isinstance(value, list | tuple):
        return [_without_nan(each) for each in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def print_note(text: str) -> None:
    """Print a line beside the result, on stderr."""
    sys.stderr.write(f"gcs: {conceal(plain(text))}\n")
    sys.stderr.flush()


def as_typed(path: str | Path) -> str:
    """A path as it is typed behind a command: in quotes where a shell would divide it, and never an option."""
    text = str(path)
    return shlex.quote(f"./{text}" if text.startswith("-") else text)


def start_log(level: LogLevel | None, path: Path | None) -> None:
    """Log what the program does to the end of a file, or to stderr.

    Raises:
        GcsError: the file cannot be written.
    """
    # loaded by those who log
    import logging

    from infra.program_log import LogFile, log_to_stream, log_uncaught

    least = logging.getLevelNamesMapping()[(level or "info").upper()]
    if path is None:
        log_to_stream(sys.stderr, least)
        return
    try:
        os.close(open_to_append(path))
    except OSError as error:
        raise GcsError(f"--log-file {path}: cannot be written: {error.strerror}; choose another place") from error
    LogFile(path.parent.resolve() / path.name, least)
    log_uncaught()


def check_terminal(instead: str) -> None:
    """See that the terminal can show screens.

    Raises:
        GcsError: it says itself that it cannot.
    """
    if os.environ.get("TERM") == "dumb":
        raise GcsError(f"TERM=dumb: a terminal of this kind cannot show screens; {instead}")


class PlainStream:
    """A stream of text on which others write too: the parser of the command line, Python with its tracebacks.

    Args:
        stream: where it goes.
        words: that may be repeated on it, each in one piece: arguments, such as names of folders.
    """

    def __init__(self, stream: TextIO, words: Sequence[str]) -> None:
        self._stream = stream
        self._words = [word for word in words if not word.isprintable()]

    def write(self, text: str) -> int:
        """Write what a terminal can show and does not obey."""
        for word in self._words:
            text = text.replace(word, plain(word))
        self._stream.write(conceal("\n".join(map(plain, text.split("\n")))))
        return len(text)

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401 - whatever the stream has
        return getattr(self._stream, name)


@contextlib.contextmanager
def errors_as_exit_codes() -> Iterator[None]:
    """Turn what a user can mend into one line and an exit code."""
    try:
        yield
    except (LinkError, StoreError, ClusterError) as error:
        print_note(_one_line(error))
        raise SystemExit(NOT_AVAILABLE) from error
    except (GcsError, MavlinkError, VisionError, AssocError, SimError) as error:
        print_note(_one_line(error))
        raise SystemExit(BAD_INPUT) from error
    except BrokenPipeError:
        # whoever read our output is gone: no message would be seen
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise SystemExit(0) from None
    except KeyboardInterrupt:
        raise SystemExit(130) from None
    except OSError as error:
        if error.errno in _OF_THE_NAME:
            print_note(_one_line(f"{str(error.filename)[:_MAX_SHOWN]}: {error.strerror}"))
            raise SystemExit(BAD_INPUT) from error
        if error.errno not in OF_THE_DISK:
            raise
        place = error.filename2 or error.filename or "the disk"
        print_note(_one_line(f"{place}: {error.strerror}; free space or choose another place"))
        raise SystemExit(NOT_AVAILABLE) from error


def _one_line(message: object) -> str:
    return " ".join(str(message).split())


class _Terminal(io.TextIOWrapper):
    """A terminal that may be closed at any time; what is written then is lost."""

    def write(self, text: str, /) -> int:
        """Write, or not."""
        with contextlib.suppress(OSError):
            return super().write(text)
        return len(text)

    def flush(self) -> None:
        """Flush, or not."""
        with contextlib.suppress(OSError):
            super().flush()

    def close(self) -> None:
        """Close; what is left in the buffer may be lost."""
        with contextlib.suppress(OSError):
            super().close()


def redirect_if_terminal_gone(path: Path) -> None:
    """Append stdout and stderr to a file if their terminal is closed; streams that are files stay as they are."""
    with contextlib.suppress(OSError, ValueError):
        for stream in (sys.stdout, sys.stderr):
            if stat.S_ISREG(os.fstat(stream.fileno()).st_mode):
                continue
            try:
                termios.tcgetattr(stream.fileno())
            except termios.error:
                with os.fdopen(open_to_append(path, links=False), "ab") as file:
                    os.dup2(file.fileno(), stream.fileno())


@contextlib.contextmanager
def redirect_stderr(path: Path | None) -> Iterator[None]:
    """Send file descriptor 2 to a file while a screen is up: libraries write to it past Python.

    Where it goes elsewhere than to the terminal already (``2>file``) it is left there, and the screen is on stdout's.

    Textual draws on ``sys.__stderr__``, which keeps the terminal under another descriptor, and may be gone: an error of
    writing would end Textual's writer, and what waits for that would wait for ever.
    """
    target = os.open(os.devnull, os.O_WRONLY)
    if path is not None:
        with contextlib.suppress(OSError):  # a file that cannot be had is no reason to do without the screen
            os.dup2(console := open_to_append(path, links=False), target)
            os.close(console)
    sys.stderr.flush()
    before = sys.__stderr__
    elsewhere = os.isatty(1) and not os.isatty(2)
    terminal = _Terminal(os.fdopen(os.dup(1 if elsewhere else 2), "wb"), encoding="utf-8")
    if not elsewhere:
        os.dup2(target, 2)
    os.close(target)
    sys.__stderr__ = terminal  # type: ignore[misc]
    try:
        yield
    finally:
        sys.stderr.flush()
        terminal.flush()
        if not elsewhere:
            os.dup2(terminal.fileno(), 2)
        sys.__stderr__ = before  # type: ignore[misc]
        terminal.close()
