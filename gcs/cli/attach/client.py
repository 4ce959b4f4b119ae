"""The terminal's side: shows the screens of a flight that runs elsewhere."""

from __future__ import annotations

import contextlib
import fcntl
import os
import pty
import select
import signal
import socket
import sys
import termios
import threading
import tty
from collections.abc import Iterator, Sequence
from pathlib import Path

import msgspec

from gcs.cli.attach.place import MAX_BYTES, VARIABLES, Answer, AttachRequest, FlightGreeting, connect
from gcs.cli.output.console import check_terminal
from gcs.cli.screen_options import ScreenOptions
from gcs.errors import GcsError
from mavlink.errors import LinkError

SIZE_VARIABLES = ("COLUMNS", "LINES")
"""The pseudo terminal knows its size, and follows it."""
READ_BYTES = 65_536
RESTORE = b"\x1b[?1049l\x1b[?25h\x1b[?7h\x1b[?1000l\x1b[?1003l\x1b[?1006l\x1b[?1004l\x1b[?2004l\x1b[<u"
"""Leaves what the screens set, for a flight that could not: it was killed."""
FAREWELL_S = 2.0


def flies_on(links: Sequence[str]) -> FlightGreeting | None:
    """The flight of this user that listens to one of these links."""
    found = None
    for flying, connection in connect():
        connection.close()
        if set(flying.links) & set(links):
            found = flying
    return found


def show_flight(which: Path | None, options: ScreenOptions, *, take_over: bool) -> str:
    """Show the screens of a running flight on this terminal until they end there.

    Args:
        which: its session folder, or its process id; None where only one flies.

    Returns:
        How it ended.

    Raises:
        GcsError: no terminal, no such flight, several, or its screens are elsewhere.
    """
    if not (sys.stdin.isatty() and sys.stdout.isatty()):
        raise GcsError("--attach needs a terminal to show the screens on")
    check_terminal("attach from another one")
    connection = _choose(which)
    controller, shown = pty.openpty()
    variables = {name: os.environ[name] for name in VARIABLES if name in os.environ and name not in SIZE_VARIABLES}
    request = AttachRequest(variables=variables, options=options, take_over=take_over)
    _copy_size(controller)
    try:
        socket.send_fds(connection, [msgspec.json.encode(request)], [shown])
    except OSError as error:
        raise GcsError(f"the flight does not answer: {error.strerror}") from error
    finally:
        os.close(shown)
    with connection, _raw_terminal(), _size_changes(controller, connection):
        threading.Thread(target=_carry, args=(0, controller), daemon=True).start()
        answer = _show(controller, connection)
    if answer is None:
        raise GcsError("the flight's process has ended without a word; its recording is sealed by the next gcs fly")
    if answer.refused:
        raise GcsError(answer.text)
    return answer.text


def _choose(which: Path | None) -> socket.socket:
    flights = connect()
    if which is not None:
        names = (str(which), str(which.resolve()))
        wanted = [flight for flight in flights if {str(flight[0].process_id), flight[0].folder} & set(names)]
    else:
        wanted = flights
    for flight in flights:
        if len(wanted) != 1 or flight is not wanted[0]:
            flight[1].close()
    if len(wanted) == 1:
        return wanted[0][1]
    if not flights:
        raise GcsError("no flight of yours is under way on this computer")
    listed = ", ".join(f"{flying.folder} (process {flying.process_id})" for flying, _ in flights)
    if which is not None:
        ended = (
            f"gcs replay {which} shows a flight that has ended" if which.is_dir() else "it has ended, or is another's"
        )
        raise GcsError(f"--attach {which}: no flight of yours is under way there; {ended}. Under way: {listed}")
    raise GcsError(f"--attach: which flight? give its session folder or process: {listed}")


def _show(controller: int, connection: socket.socket) -> Answer | None:
    """Write what the flight draws until it is done; its last word, None where it has none."""
    connection.settimeout(FAREWELL_S)
    drawn = False
    while True:
        ready = select.select([controller, connection.fileno()], [], [])[0]
        if controller in ready:
            try:
                data = os.read(controller, READ_BYTES)
            except OSError:  # the flight has closed its end
                data = b""
            if data:
                drawn = True
                os.write(1, data)
                continue
            ready = [connection.fileno()]
        if connection.fileno() in ready:
            with contextlib.suppress(OSError, msgspec.DecodeError):
                return msgspec.json.decode(connection.recv(MAX_BYTES), type=Answer)
            if drawn:
                os.write(1, RESTORE)
            return None


def _carry(source: int, goal: int) -> None:
    """Carry keys to the flight and its screen back, until either ends."""
    with contextlib.suppress(OSError):
        while data := os.read(source, READ_BYTES):
            os.write(goal, data)


def _copy_size(controller: int) -> None:
    with contextlib.suppress(OSError):
        fcntl.ioctl(controller, termios.TIOCSWINSZ, fcntl.ioctl(1, termios.TIOCGWINSZ, bytes(8)))


@contextlib.contextmanager
def _raw_terminal() -> Iterator[None]:
    before = termios.tcgetattr(0)
    try:
        tty.setraw(0, termios.TCSANOW)
        yield
    finally:
        with contextlib.suppress(termios.error):
            termios.tcsetattr(0, termios.TCSANOW, before)


@contextlib.contextmanager
def _size_changes(controller: int, connection: socket.socket) -> Iterator[None]:
    def changed(*_: object) -> None:
        _copy_size(controller)
        with contextlib.suppress(OSError):
            connection.send(b"w")

    before = signal.signal(signal.SIGWINCH, changed)
    try:
        yield
    finally:
        signal.signal(signal.SIGWINCH, before)


@contextlib.contextmanager
def naming_own_flight(links: Sequence[str]) -> Iterator[None]:
    """A link that a flight of this user has: the error names that flight and how to show it."""
    try:
        yield
    except LinkError as error:
        if (flying := flies_on(links)) is not None:
            hint = f"your flight in {flying.folder} has it, and gcs fly --attach shows its screens here"
            raise LinkError(f"{error}; {hint}") from error
        raise
