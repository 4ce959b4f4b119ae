"""Where it runs: all of it on Linux, recordings on macOS, one clear line on Windows."""

from __future__ import annotations

import subprocess
import sys

from tests.support.bundled import SWARM, shortened

MACOS = """
import sys
import time
from pathlib import Path
from tests.support.as_macos import become_macos, import_everything
become_macos()
assert import_everything() > 300
from gcs.cli.app import main
from gcs.playback.replay import Replay
from gcs.session.session import open_session
session, out = Path(sys.argv[1]), sys.argv[2]
station = Replay(open_session(session))
station.play()
while station.latest() is None or station.latest().frame < 10:
    time.sleep(0.02)
station.stop()
sys.argv = ["gcs", "identify", str(session), "-o", out]
main()
"""
WINDOWS = """
import sys
for name in ("termios", "fcntl", "pty", "resource", "grp", "pwd"):
    sys.modules[name] = None
sys.platform = "win32"
from gcs.cli.start import main
main()
"""


def python(script, *words):
    done = subprocess.run(
        [sys.executable, "-c", script, *map(str, words)], capture_output=True, text=True, timeout=600, check=False
    )
    return done.returncode, done.stdout, done.stderr


def test_macos_imports_everything_and_replays(tmp_path):
    code, stdout, stderr = python(MACOS, shortened(SWARM, tmp_path / "session", 12), tmp_path / "out")
    assert code == 0, stderr
    assert "2 of 6 vehicles named" in stdout  # no more are in view so soon


def test_windows_gets_one_clear_line():
    code, stdout, stderr = python(WINDOWS)
    assert (code, stdout) == (3, "")
    assert stderr.startswith("gcs: ") and stderr.count("\n") == 1
    assert "WSL2" in stderr
