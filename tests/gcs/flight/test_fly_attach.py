"""A flight without its screens shows them on another terminal, and goes on whatever becomes of that."""

import contextlib
import os
import pty
import signal
import socket
import time
from types import SimpleNamespace

import psutil
import pytest

from gcs.cli.attach.client import flies_on, show_flight
from gcs.cli.attach.place import socket_folder
from gcs.cli.attach.server import AttachServer
from gcs.cli.screen_options import ScreenOptions
from gcs.errors import GcsError
from tests.support.bundled import swarm_session
from tests.support.command_line import MISSION, OnTerminal, Terminal, run_gcs
from tests.support.ports import free_port
from tests.support.waiting import until


@pytest.fixture
def begin(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    begun = []

    def _begin(kind, *words, **how):
        begun.append(kind(*words, **how))
        return begun[-1]

    yield _begin
    for terminal in begun:
        if terminal.process.poll() is None:
            terminal.process.kill()
            terminal.process.wait()


def answer(terminal, keys, code):
    """Press keys, and read what the command says at its end."""
    os.write(terminal.keeper, keys)
    said = terminal.drain()
    assert terminal.process.wait(120) == code, said[-2000:]
    return said


def share_of_a_core(pid):
    """What a process takes of one in two seconds."""
    process, began_s = psutil.Process(pid), time.monotonic()
    before_s = sum(process.cpu_times()[:2])
    time.sleep(2.0)
    return (sum(process.cpu_times()[:2]) - before_s) / (time.monotonic() - began_s)


@pytest.mark.slow
def test_a_flight_is_taken_up_again_left_and_ended_from_other_terminals(begin, tmp_path):
    flight = begin(Terminal, tmp_path, controls=False)
    flight.read_until(b"NAME")
    flight.send(3)
    os.close(flight.keeper)  # gone without a word
    log = next(flight.sessions.iterdir()) / "console.log"
    assert until(lambda: log.exists() and "still recording" in log.read_text())
    assert until(lambda: share_of_a_core(flight.process.pid) < 0.25), "a thread that spins has all of it for ever"

    first = begin(OnTerminal, "fly", "--attach")
    first.read_until(b"NAME")
    refused = begin(OnTerminal, "fly", "--attach", log.parent)
    assert b"on another terminal" in answer(refused, b"", 2)
    taking = begin(OnTerminal, "fly", "--attach", "--take-over", flight.process.pid)
    assert b"the flight goes on" in answer(first, b"", 0)
    taking.read_until(b"NAME")
    os.close(taking.keeper)  # hung up
    flight.send(3)
    last = begin(OnTerminal, "fly", "--attach")
    last.read_until(b"NAME")
    assert b"the flight has ended" in answer(last, b"qq", 0)
    assert flight.process.wait(120) == 0
    assert "ended" in (log.parent / "session.toml").read_text()
    said = log.read_text()
    assert f"still recording in {log.parent}" in said and "6 packets received" in said and "Traceback" not in said
    assert list(socket_folder().iterdir()) == []


@pytest.mark.slow
def test_leaving_a_lent_screen_leaves_the_flight_and_a_killed_flight_the_terminal(begin, tmp_path):
    flight = begin(Terminal, tmp_path, "--headless", controls=False)
    flight.read_until(b"gcs fly --attach")
    first = begin(OnTerminal, "fly", "--attach")
    first.read_until(b"NAME")
    said = answer(first, b"ql", 0)
    assert b"the flight goes on" in said and b"\x1b[?1049l" in said
    again = begin(OnTerminal, "fly", "--attach")
    again.read_until(b"NAME")
    flight.process.kill()
    said = answer(again, b"", 2)
    assert b"without a word" in said and b"\x1b[?1049l" in said


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_to_end_ends_a_flight_whose_screens_are_on_another_terminal(begin, tmp_path, number):
    flight = begin(Terminal, tmp_path, "--headless", controls=False)
    flight.read_until(b"gcs fly --attach")
    flight.send(3)
    shown = begin(OnTerminal, "fly", "--attach")
    shown.read_until(b"NAME")
    flight.process.send_signal(number)
    assert b"the flight has ended" in answer(shown, b"", 0)
    assert flight.ended(number)[0] == 0


class Asks:
    """A terminal that says what it likes to a flight of this user, over and over again."""

    def __init__(self, process_id):
        self._path = socket_folder() / f"{process_id}.sock"

    def __call__(self, wish):
        """What the flight answers; empty where it hangs up."""
        controller, shown = pty.openpty()
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as connection:
            connection.settimeout(60.0)
            connection.connect(str(self._path))
            connection.recv(65_536)
            socket.send_fds(connection, [wish], [shown])
            os.close(shown)
            os.close(controller)
            with contextlib.suppress(OSError):
                return connection.recv(65_536)
        return b""


WISH = b'{"variables": {"TERM": "xterm%s"}, "options": {"graphics": "auto", "theme": "dark", "fps": 12, "bell": false},'
WISHES = {
    "a NUL in a variable": WISH % rb"\u0000" + b' "take_over": true}',
    "an escape in a variable": WISH % rb"\u001b" + b' "take_over": true}',
    "half a letter": WISH % rb"\ud800" + b' "take_over": true}',
    "a long variable": WISH % (b"x" * 5000) + b' "take_over": true}',
    "nested": WISH % b"" + b' "take_over": true, "more": ' + b"[" * 50_000,
    "no JSON": b"\x00\xff",
    "a terminal that is gone": WISH % b"" + b' "take_over": true}',
}


@pytest.mark.slow
def test_whatever_a_terminal_asks_for_the_flight_goes_on(begin, tmp_path):
    flight = begin(Terminal, tmp_path, "--headless", controls=False)
    flight.read_until(b"gcs fly --attach")
    ask = Asks(flight.process.pid)
    before = psutil.Process(flight.process.pid).num_fds()
    for name, wish in WISHES.items():
        ask(wish)
        assert flight.process.poll() is None, name
    flight.send(3)
    assert until(lambda: psutil.Process(flight.process.pid).num_fds() <= before)
    last = begin(OnTerminal, "fly", "--attach")
    last.read_until(b"NAME")
    assert b"the flight has ended" in answer(last, b"qq", 0)
    assert flight.process.wait(120) == 0


def test_the_folder_of_sockets_is_never_in_one_for_all(tmp_path, monkeypatch):
    monkeypatch.delenv("XDG_RUNTIME_DIR", raising=False)
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    (tmp_path / f"rollcall-{os.geteuid()}").touch()  # as anybody may
    assert socket_folder() == tmp_path / "state" / "rollcall"
    server = AttachServer(tmp_path / "session", [])
    assert server.trouble == ""
    server.close()


def test_where_no_terminal_can_come_it_is_told(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    (tmp_path / "rollcall").mkdir(mode=0o777)
    (tmp_path / "rollcall").chmod(0o777)
    (tmp_path / "mission.toml").write_text(MISSION)
    words = ("-l", f"udpin:127.0.0.1:{free_port()}", "--headless", "--duration", 1, "--sessions", tmp_path / "s")
    _, _, told = run_gcs("fly", tmp_path / "mission.toml", *words)
    assert "no terminal can be attached" in told and "--attach" not in told


def test_what_cannot_be_attached_is_told(begin, tmp_path, monkeypatch):
    assert run_gcs("fly", "--attach")[::2] == (2, "gcs: --attach needs a terminal to show the screens on\n")
    for stream in ("sys.stdin", "sys.stdout"):
        monkeypatch.setattr(stream, SimpleNamespace(isatty=lambda: True))
    options = ScreenOptions()
    with pytest.raises(GcsError, match="no flight of yours"):
        show_flight(None, options, take_over=False)
    server = AttachServer(tmp_path / "session", ["udpin:127.0.0.1:2"])
    with pytest.raises(GcsError, match=r"under way there; gcs replay.*session"):
        show_flight(tmp_path, options, take_over=False)
    assert flies_on(["udpin:127.0.0.1:1"]) is None
    assert flies_on(["udpin:127.0.0.1:1", "udpin:127.0.0.1:2"]).folder == str(tmp_path / "session")
    socket_folder().parent.joinpath("rollcall").chmod(0o755)
    with pytest.raises(PermissionError, match="others may enter"):
        socket_folder()
    with pytest.raises(GcsError, match="no flight of yours"):
        show_flight(None, options, take_over=False)
    server.close()


def test_a_port_of_a_running_flight_is_told_with_the_way_to_its_screens(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    (tmp_path / "mission.toml").write_text(MISSION)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        link = f"udpin:127.0.0.1:{taken.getsockname()[1]}"
        server = AttachServer(tmp_path / "session", [link])
        code, _, told = run_gcs("fly", tmp_path / "mission.toml", "-l", link, "--sessions", tmp_path)
        server.close()
    assert code == 3
    assert "gcs fly --attach" in told and str(tmp_path / "session") in told and told.count("\n") == 1


def test_replay_without_a_terminal_says_what_to_do(tmp_path):
    code, said, told = run_gcs("replay", swarm_session(tmp_path))
    assert (code, said) == (2, "")
    assert "needs a terminal" in told and "gcs identify" in told and told.count("\n") == 1
