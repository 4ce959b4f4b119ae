"""The flight's side of attaching: a socket to which terminals connect, one at a time."""

from __future__ import annotations

import contextlib
import logging
import os
import select
import signal
import socket
import sys
import threading
from collections.abc import Iterator, Sequence
from pathlib import Path

import msgspec

from gcs.cli.attach.place import MAX_BYTES, VARIABLES, Answer, AttachRequest, FlightGreeting, socket_folder

_log = logging.getLogger(__name__)

LOOK_S = 0.2
HELLO_S = 5.0
"""Time in which a terminal has to say what it wants, s."""


class LentTerminal:
    """Terminal of another process that shows the screens until they end."""

    def __init__(self, connection: socket.socket, fd: int, request: AttachRequest) -> None:
        self._connection = connection
        self._fd = fd
        self._variables = request.variables
        self.options = request.options
        """Options of the screens."""

    @contextlib.contextmanager
    def as_standard_streams(self) -> Iterator[None]:
        """Put this terminal in place of the process's own standard streams, where Textual looks for it."""
        before = {name: os.environ.get(name) for name in VARIABLES}
        streams = (sys.__stdin__, sys.__stdout__, sys.__stderr__)
        with (
            os.fdopen(os.dup(self._fd), "r") as reads,
            os.fdopen(os.dup(self._fd), "w") as writes,
            os.fdopen(os.dup(self._fd), "w") as errors,
        ):
            # real pixels would be those of the terminal that was asked for them first
            _set_variables({name: self._variables.get(name) for name in VARIABLES} | {"SSH_CONNECTION": "attached"})
            sys.__stdin__, sys.__stdout__, sys.__stderr__ = reads, writes, errors  # type: ignore[misc]
            try:
                yield
            finally:
                sys.__stdin__, sys.__stdout__, sys.__stderr__ = streams  # type: ignore[misc]
                _set_variables(before)

    def watch(self) -> None:
        """Hand on changes of its size until it ends; in a thread."""
        with contextlib.suppress(OSError):
            while self._connection.recv(64):
                os.kill(os.getpid(), signal.SIGWINCH)

    def give_back(self, text: str) -> None:
        """Close the terminal after the screens have ended, and say why."""
        os.close(self._fd)
        _answer(self._connection, Answer(text=text))


class AttachServer:
    """Waits for terminals; a flight without one goes on all the same.

    Attributes:
        trouble: why none can come, empty where they can.
    """

    def __init__(self, folder: Path, links: Sequence[str]) -> None:
        self._flying = FlightGreeting(process_id=os.getpid(), folder=str(folder.resolve()), links=tuple(links))
        self._lock = threading.Lock()
        self._waiting: LentTerminal | None = None
        self._shown = False
        self._taken_over = False
        self._closing = False
        self.trouble = ""
        self._socket: socket.socket | None = None
        try:
            self._path = socket_folder() / f"{os.getpid()}.sock"
            self._path.unlink(missing_ok=True)
            self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
            self._socket.bind(str(self._path))
            self._path.chmod(0o600)
            self._socket.listen(4)
        except OSError as error:
            self.trouble = f"no terminal can be attached: {error}"
            _log.warning("%s", self.trouble)
            return
        threading.Thread(target=self._serve, name="attach", daemon=True).start()

    def take(self) -> LentTerminal | None:
        """Take the terminal that waits for the screens."""
        with self._lock:
            waiting, self._waiting = self._waiting, None
            return waiting

    @contextlib.contextmanager
    def showing(self) -> Iterator[None]:
        """Mark the screens as shown on some terminal while the block runs."""
        with self._lock:
            self._shown, self._taken_over = True, False
        try:
            yield
        finally:
            with self._lock:
                self._shown = False

    def taken_over(self) -> bool:
        """Tell whether the screens are to end for another terminal."""
        return self._taken_over

    def close(self) -> None:
        """Refuse further terminals and remove the socket."""
        self._closing = True
        if (waiting := self.take()) is not None:
            waiting.give_back("the flight has ended")
        if self._socket is not None:
            self._path.unlink(missing_ok=True)
            self._socket.close()

    def _serve(self) -> None:
        assert self._socket is not None
        while not self._closing:
            with contextlib.suppress(OSError, ValueError):  # closed meanwhile
                if select.select([self._socket], [], [], LOOK_S)[0]:
                    connection, _ = self._socket.accept()
                    self._welcome(connection)

    def _welcome(self, connection: socket.socket) -> None:
        connection.settimeout(HELLO_S)
        fds: list[int] = []
        try:
            if not _is_ours(connection):
                raise PermissionError("of another user")
            connection.sendall(msgspec.json.encode(self._flying))
            data, fds, _, _ = socket.recv_fds(connection, MAX_BYTES, 1)
            if not data and not fds:  # only looked who flies
                connection.close()
                return
            request = msgspec.json.decode(data, type=AttachRequest)
            if len(fds) != 1 or not os.isatty(fds[0]):
                raise ValueError("no terminal came along")
        except (OSError, ValueError, RecursionError, msgspec.DecodeError) as error:
            _log.warning("a terminal was refused: %s", error)
            for fd in fds:
                os.close(fd)
            connection.close()
            return
        with self._lock:
            busy = self._waiting is not None or (self._shown and not request.take_over)
            if not busy:
                connection.settimeout(None)
                self._waiting = lent = LentTerminal(connection, fds[0], request)
                self._taken_over = self._shown
        if busy:
            os.close(fds[0])
            text = "its screens are on another terminal: leave them there (q, l), or add --take-over"
            _answer(connection, Answer(text=text, refused=True))
        else:
            threading.Thread(target=lent.watch, name="attached", daemon=True).start()


def _is_ours(connection: socket.socket) -> bool:
    """Tell whether the other end is this user's; on macOS the folder's mode has seen to that."""
    if not hasattr(socket, "SO_PEERCRED"):
        return True
    credentials = connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, 12)
    return int.from_bytes(credentials[4:8], sys.byteorder) in (os.geteuid(), 0)


def _answer(connection: socket.socket, answer: Answer) -> None:
    with contextlib.suppress(OSError):
        connection.sendall(msgspec.json.encode(answer))
    with contextlib.suppress(OSError):
        connection.shutdown(socket.SHUT_RDWR)  # wakes who reads there
    connection.close()


def _set_variables(variables: dict[str, str | None]) -> None:
    for name, value in variables.items():
        if value is None:
            os.environ.pop(name, None)
        else:
            os.environ[name] = value
