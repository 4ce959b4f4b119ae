"""A flight outlives its terminal, and seals its recording when it is told to end."""

import os
import pty
import select
import signal
import socket
import subprocess
import sys
import threading
import time

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.cli.fly import fly
from mavlink.tlog.log import Tlog
from tests.support.ingest_runs import until
from tests.support.ports import free_port

MISSION = "[uav]\nsystem_id = 1\n[[ugv]]\nsystem_id = 11\n"
ON_TERMINAL = """
import fcntl, os, sys, termios
os.setsid()
fcntl.ioctl(0, termios.TIOCSCTTY, 0)
os.execv(sys.executable, [sys.executable, "-c", "from gcs.cli.app import main; main()", *sys.argv[1:]])
"""


def heartbeat():
    return dialect.MAVLink_heartbeat_message(10, 3, 0, 0, 4, 3).pack(dialect.MAVLink(None, srcSystem=11))


class Terminal:
    """A flight on a pseudo terminal of 80 by 24."""

    def __init__(self, folder, *extra, errors=None, mission=MISSION):
        self.port = free_port()
        (folder / "mission.toml").write_text(mission)
        self.sessions = folder / "sessions"
        self.keeper, child = pty.openpty()
        words = ["fly", folder / "mission.toml", "-l", f"udpin:127.0.0.1:{self.port}", "--sessions", self.sessions]
        environment = {**os.environ, "TERM": "xterm-256color", "COLUMNS": "80", "LINES": "24"}
        self.process = subprocess.Popen(
            [sys.executable, "-c", ON_TERMINAL, *map(str, words), *extra],
            stdin=child,
            stdout=child,
            stderr=errors or child,
            env=environment,
        )
        os.close(child)
        self.sent = 0

    def read_until(self, word, seconds=40.0):
        said, until = b"", time.monotonic() + seconds
        while word not in said and time.monotonic() < until:
            if select.select([self.keeper], [], [], 0.1)[0]:
                said += os.read(self.keeper, 65536)
        assert word in said, said[-2000:]

    def drain(self):
        """Reads until it is closed: who writes to a terminal that nobody reads waits."""
        try:
            while os.read(self.keeper, 65536):
                pass
        except OSError:
            pass

    def send(self, count):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle:
            for _ in range(count):
                vehicle.sendto(heartbeat(), ("127.0.0.1", self.port))
                self.sent += 1
                time.sleep(0.02)

    def ended(self, number):
        time.sleep(0.5)
        self.process.send_signal(number)
        code = self.process.wait(timeout=40)
        (session,) = self.sessions.iterdir()
        assert len(Tlog.open(session / "telemetry.tlog").index) == self.sent
        assert "ended" in (session / "session.toml").read_text()
        return code, session


@pytest.fixture
def begin(tmp_path):
    begun = []

    def _begin(*extra, **more):
        begun.append(Terminal(tmp_path, *extra, **more))
        return begun[-1]

    yield _begin
    for terminal in begun:
        if terminal.process.poll() is None:
            terminal.process.kill()
            terminal.process.wait()


@pytest.mark.parametrize(("extra", "shown"), [((), b"NAME"), (("--headless",), b"stop with Ctrl-C")])
def test_a_flight_goes_on_when_its_terminal_is_closed(begin, extra, shown):
    terminal = begin(*extra)
    terminal.read_until(shown)
    terminal.send(10)
    os.close(terminal.keeper)
    time.sleep(1.0)
    terminal.send(50)
    assert terminal.process.poll() is None
    code, session = terminal.ended(signal.SIGTERM)
    assert code == 0
    said = (session / "console.log").read_text()
    assert f"{terminal.sent} packets received" in said
    assert "Traceback" not in said
    if not extra:
        assert f"still recording in {session}" in said and f"kill {terminal.process.pid}" in said


def test_a_screen_that_breaks_ends_no_flight(tmp_path, monkeypatch, capsys):
    def broken(flight, graphics, *, bell):
        threading.Timer(1.5, os.kill, (os.getpid(), signal.SIGINT)).start()
        raise ValueError("no such colour")

    monkeypatch.setattr("gcs.tui.run", broken)
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    (tmp_path / "mission.toml").write_text(MISSION)
    began = time.monotonic()
    fly(tmp_path / "mission.toml", link=[f"udpin:127.0.0.1:{free_port()}"], sessions=tmp_path / "sessions")
    assert time.monotonic() - began >= 1.5, "it went on until the signal"
    (session,) = (tmp_path / "sessions").iterdir()
    said = capsys.readouterr()
    assert f"still recording in {session}" in said.err and "0 packets received" in said.out
    assert "ValueError: no such colour" in said.err, "the file's, while a screen is up"
    assert "ended" in (session / "session.toml").read_text()


def test_a_signal_to_end_seals_what_the_screen_shows(begin):
    terminal = begin()
    terminal.read_until(b"NAME")
    terminal.send(10)
    code, _ = terminal.ended(signal.SIGTERM)
    assert code == 0
    terminal.read_until(b"10 packets received")
    os.close(terminal.keeper)


def test_errors_that_go_to_a_file_leave_the_screen_where_it_is(begin, tmp_path):
    with (tmp_path / "errors.txt").open("wb") as errors:
        terminal = begin(errors=errors)
    terminal.read_until(b"NAME")
    terminal.send(10)
    code, _ = terminal.ended(signal.SIGTERM)
    assert code == 0
    terminal.read_until(b"10 packets received")
    os.close(terminal.keeper)
    assert b"\x1b" not in (tmp_path / "errors.txt").read_bytes(), "no screen in it"


def test_what_goes_to_a_file_stays_there_when_the_terminal_is_gone(begin, tmp_path):
    with (tmp_path / "errors.txt").open("wb") as errors:
        terminal = begin("--headless", errors=errors)
    assert until(lambda: b"stop with Ctrl-C" in (tmp_path / "errors.txt").read_bytes())
    terminal.send(5)
    os.close(terminal.keeper)
    terminal.process.send_signal(signal.SIGHUP)
    _, session = terminal.ended(signal.SIGTERM)
    assert "5 packets received" in (session / "console.log").read_text(), "stdout was the terminal's"
    assert b"packets received" not in (tmp_path / "errors.txt").read_bytes()
