"""Sockets at which flights wait for terminals, and the messages that both exchange."""

from __future__ import annotations

import contextlib
import os
import socket
import stat
from pathlib import Path
from typing import Annotated

import msgspec

from gcs.cli.screen_options import ScreenOptions

MAX_BYTES = 65_536
"""Length of the longest message."""
ANSWER_S = 5.0
"""Longest wait for a flight's greeting, s."""
VARIABLES = (
    *("TERM", "COLORTERM", "TERM_PROGRAM", "TERM_PROGRAM_VERSION", "LC_TERMINAL", "VTE_VERSION", "NO_COLOR"),
    *("TMUX", "STY", "SSH_CONNECTION", "COLUMNS", "LINES"),
)
"""Variables in which a terminal describes itself: the flight has those of another one, or none."""


Variable = Annotated[str, msgspec.Meta(max_length=1024, pattern=r"\A[^\x00-\x1f\x7f]*\Z")]
"""Text that a variable of the environment may hold."""


class FlightGreeting(msgspec.Struct, frozen=True, kw_only=True):
    """First message of a flight to a terminal."""

    process_id: int
    folder: str
    links: tuple[str, ...]


class AttachRequest(msgspec.Struct, frozen=True, kw_only=True):
    """Request of a terminal; its pseudo terminal comes along."""

    variables: dict[str, Variable]
    options: ScreenOptions
    take_over: bool


class Answer(msgspec.Struct, frozen=True, kw_only=True):
    """Answer to a terminal: at once where it is refused, else when the screens have ended."""

    text: str
    refused: bool = False


def socket_folder() -> Path:
    """The folder of this user's sockets, made where there is none.

    Raises:
        OSError: it cannot be made, or others may write there.
    """
    runtime = os.environ.get("XDG_RUNTIME_DIR") or os.environ.get("XDG_STATE_HOME") or "~/.local/state"
    # never in a folder for all users' temporary files: whoever makes it there first keeps its owner out
    folder = Path(runtime).expanduser() / "rollcall"
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    status = folder.lstat()
    if not stat.S_ISDIR(status.st_mode) or status.st_uid != os.geteuid() or status.st_mode & 0o077:
        raise PermissionError(f"{folder}: belongs to another user, or others may enter it")
    return folder


def connect() -> list[tuple[FlightGreeting, socket.socket]]:
    """Every flight of this user that runs, the newest first, each with a connection."""
    flights = []
    with contextlib.suppress(OSError):
        for path in sorted(socket_folder().glob("*.sock"), key=lambda path: path.name):
            connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
            connection.settimeout(ANSWER_S)
            try:
                connection.connect(str(path))
                flights.append((msgspec.json.decode(connection.recv(MAX_BYTES), type=FlightGreeting), connection))
            except ConnectionRefusedError:  # it was killed
                connection.close()
                path.unlink(missing_ok=True)
            except (OSError, msgspec.DecodeError):
                connection.close()
    return sorted(flights, key=lambda flight: flight[0].folder, reverse=True)
