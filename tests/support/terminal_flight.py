"""A flight on a pseudo terminal."""

import os
import pty
import select
import socket
import subprocess
import sys
import time

from pymavlink.dialects.v20 import ardupilotmega as dialect

from mavlink.tlog.log import Tlog
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
