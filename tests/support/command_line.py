"""``gcs`` as a shell starts it: in this process where that proves the same, in one of its own, or on a terminal."""

from __future__ import annotations

import gc
import io
import os
import pty
import re
import select
import socket
import subprocess
import sys
import time
from pathlib import Path
from unittest.mock import patch

from pymavlink.dialects.v20 import ardupilotmega as dialect
from typer.testing import CliRunner

from gcs.cli.app import app, main
from mavlink.tlog.log import Tlog
from tests.support.ports import free_port
from tests.support.receiving import recorded
from tests.support.waiting import until

GCS = (sys.executable, "-c", "from gcs.cli.app import main; main()")
"""A command that starts it, without its arguments."""


def run_gcs(*arguments: object) -> tuple[int, str, str]:
    """Runs the command in this process; returns exit code, stdout, stderr."""
    out, err = (io.TextIOWrapper(io.BytesIO(), encoding="utf-8") for _ in range(2))
    thresholds = gc.get_threshold()
    words = ["gcs", *map(str, arguments)]
    with Path(os.devnull).open() as nothing, patch.multiple(sys, argv=words, stdin=nothing, stdout=out, stderr=err):
        try:
            main()
            code = 0
        except SystemExit as end:
            code = end.code or 0
        finally:
            gc.set_threshold(*thresholds)
            gc.unfreeze()
    return code, *(stream.buffer.getvalue().decode() for stream in (out, err))


def help_pages():
    """Each command with its page of help."""
    top = CliRunner().invoke(app, ["--help"]).output
    for name in re.findall(r"^  ([a-z][a-z-]+)  ", top, re.MULTILINE):
        page = CliRunner().invoke(app, [name, "--help"]).output
        subs = re.findall(r"^  ([a-z-]+)  ", page.partition("Commands:")[2], re.MULTILINE)
        yield from ((f"{name} {sub}", CliRunner().invoke(app, [name, sub, "--help"]).output) for sub in subs)
        yield name, page


def run_gcs_process(*arguments: object) -> tuple[int, str, str]:
    """Runs the command in a process of its own; returns exit code, stdout, stderr."""
    done = subprocess.run(
        [*GCS, *map(str, arguments)],
        capture_output=True,
        text=True,
        stdin=subprocess.DEVNULL,
        timeout=120,
        check=False,
    )
    return done.returncode, done.stdout, done.stderr


MISSION = "[uav]\nsystem_id = 1\n[[ugv]]\nsystem_id = 11\n"
ON_TERMINAL = """
import fcntl, os, sys, termios
os.setsid()
fcntl.ioctl(0, termios.TIOCSCTTY, 0)
os.execv(sys.executable, [sys.executable, "-c", "from gcs.cli.app import main; main()", *sys.argv[1:]])
"""


def heartbeat():
    return dialect.MAVLink_heartbeat_message(10, 3, 0, 0, 4, 3).pack(dialect.MAVLink(None, srcSystem=11))


class OnTerminal:
    """A command on a pseudo terminal of 80 by 24, which hangs it up when it is closed, or does not (``controls``)."""

    def __init__(self, *words, errors=None, controls=True):
        self.keeper, child = pty.openpty()
        environment = {**os.environ, "TERM": "xterm-256color", "COLUMNS": "80", "LINES": "24"}
        self.process = subprocess.Popen(
            [*((sys.executable, "-c", ON_TERMINAL) if controls else GCS), *map(str, words)],
            stdin=child,
            stdout=child,
            stderr=errors or child,
            env=environment,
            start_new_session=not controls,
        )
        os.close(child)

    def read_until(self, word, seconds=120.0):
        said, end_s = b"", time.monotonic() + seconds
        while word not in said and time.monotonic() < end_s:
            if select.select([self.keeper], [], [], 0.1)[0]:
                said += os.read(self.keeper, 65536)
        assert word in said, said[-2000:]

    def drain(self):
        """Reads until it is closed: who writes to a terminal that nobody reads waits."""
        said = b""
        try:
            while more := os.read(self.keeper, 65536):
                said += more
        except OSError:
            pass
        return said


class Terminal(OnTerminal):
    """A flight on such a terminal."""

    def __init__(self, folder, *extra, mission=MISSION, **how):
        self.port = free_port()
        (folder / "mission.toml").write_text(mission)
        self.sessions = folder / "sessions"
        words = ["fly", folder / "mission.toml", "-l", f"udpin:127.0.0.1:{self.port}", "--sessions", self.sessions]
        super().__init__(*words, *extra, **how)
        self.sent = 0

    def send(self, count):
        """Heartbeats, until they are recorded."""
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle:
            for _ in range(count):
                vehicle.sendto(heartbeat(), ("127.0.0.1", self.port))
                self.sent += 1
        (session,) = self.sessions.iterdir()
        assert until(lambda: len(recorded(session)) == self.sent)

    def ended(self, number):
        self.process.send_signal(number)
        code = self.process.wait(timeout=120)
        (session,) = self.sessions.iterdir()
        assert len(Tlog.open(session / "telemetry.tlog").index) == self.sent
        assert "ended" in (session / "session.toml").read_text()
        return code, session
