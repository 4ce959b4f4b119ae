"""Makes the environment, and says all the time what it does: ``python .ci/set_up.py .venv``, by ``make``."""

from __future__ import annotations

import queue
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import IO

MIN_PYTHON = (3, 11, 2)
TOLD_S, LOGGED_S = 1.0, 10.0
"""Seconds between two lines of progress, on a terminal and in a log: who waits wants to see that it goes on."""


def run_step(what: str, command: list[str], packages: int = 0) -> int:
    """Run a program, and tell how far it is; what it wrote is shown if it fails.

    Args:
        what: it does, in words.
        command: the program.
        packages: how many pip is to collect, 0 none.

    Returns:
        Its exit code.
    """
    screen, since_s = sys.stdout.isatty(), time.monotonic()
    lines: queue.SimpleQueue[str] = queue.SimpleQueue()
    written: list[str] = []
    _say(what, screen=screen)
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as program:
        assert program.stdout is not None
        reader = threading.Thread(target=_read, args=(program.stdout, lines))
        reader.start()
        told_s, ended = since_s, False
        while not ended:
            ended = not reader.is_alive()
            while not lines.empty():
                written.append(lines.get())
            if time.monotonic() - told_s >= (TOLD_S if screen else LOGGED_S):
                told_s = time.monotonic()
                line = f"{what}: {how_far(written, packages)}{told_s - since_s:.0f} s"
                _say(line, screen=screen)
            time.sleep(0.0 if ended else 0.1)
    took = f"{what}: done in {time.monotonic() - since_s:.0f} s"
    if program.returncode:
        took = f"{what}: failed\n{''.join(written)}"
    _say(took + "\n" * screen, screen=screen)
    return program.returncode


def _read(out: IO[str], lines: queue.SimpleQueue[str]) -> None:
    for line in out:
        lines.put(line)


def _say(text: str, *, screen: bool) -> None:
    """Show a text: on a terminal in place of the line before, else as a line of its own."""
    sys.stdout.write(f"\r\x1b[K{text}" if screen else f"{text}\n")
    sys.stdout.flush()


def how_far(written: list[str], packages: int) -> str:
    """Progress of an installation in words, from the lines that pip has written.

    Example:
        >>> how_far(["Collecting numpy==2.4.1\\n", "Collecting rich==15.0\\n"], 120)
        '2 of 120 packages found, '
        >>> how_far(["Collecting numpy==2.4.1\\n", "Installing collected packages: numpy\\n"], 120)
        'all found, unpacking, '
    """
    if any(line.startswith("Installing collected") for line in written):
        return "all found, unpacking, "
    found = sum(line.startswith(("Collecting", "Requirement already")) for line in written)
    return f"{found} of {packages} packages found, " if packages and found else ""


def main() -> int:
    """Make the environment, step by step; the exit code of what fails."""
    if sys.version_info < MIN_PYTHON:
        return _told("Python 3.11.2 or newer is needed, this is " + sys.version.split()[0])
    folder = sys.argv[1]
    python = [folder + "/bin/python"]
    pip = [*python, "-m", "pip", "install", "--progress-bar", "off", "--no-input"]
    pinned = Path("requirements.lock").read_text(encoding="utf-8").count("==")
    steps = (
        (f"makes an environment in {folder}", [sys.executable, "-m", "venv", folder], 0),
        ("installs what Rollcall needs", [*pip, "--require-hashes", "--requirement", "requirements.lock"], pinned),
        ("installs Rollcall itself", [*pip, "--no-build-isolation", "--no-deps", "--editable", "."], 0),
    )
    for number, (what, command, packages) in enumerate(steps, 1):
        if code := run_step(f"{number} of {len(steps)}: {what}", command, packages):
            return code
    return 0


def _told(trouble: str) -> int:
    sys.stderr.write(trouble + "\n")
    return 1


if __name__ == "__main__":
    sys.exit(main())
