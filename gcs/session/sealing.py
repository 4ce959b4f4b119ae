"""Interrupted sessions sealed while a flight begins: in a process of their own, which nothing waits for.

The folders may hold anything: a log of gigabytes, or files made to hang or to crash the program that reads them.
"""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path

from gcs.session.metadata import Interrupted, recorded_folders, seal
from infra.plain_text import plain

ROOT = str(Path(__file__).resolve().parents[2])
NICENESS = 10
"""Niceness of the process: the flight's processes go first."""
LONGEST_S = 120
"""Longest time to seal one session, s: a log of 8 GB takes 16 s of processor."""
END_S = 2.0
"""Time for which a flight that ends waits for a session that is being looked into; the next flight seals the others."""


class Sealing:
    """Seals the sessions in a folder.

    Args:
        report: called with a line on each, from a thread of its own.
    """

    def __init__(self, parent: Path, report: Callable[[str], None]) -> None:
        self._report = report
        # the package is found where this one is, whatever folder the station was started in
        paths = os.pathsep.join(filter(None, [ROOT, os.environ.get("PYTHONPATH", "")]))
        self._child = subprocess.Popen(
            [sys.executable, "-P", "-m", "gcs.session.sealing", str(parent.absolute())],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env=os.environ | {"PYTHONPATH": paths, "PYTHONIOENCODING": "utf-8"},
            start_new_session=True,
        )
        self._thread = threading.Thread(target=self._listen, name="sealing", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop the process, after a moment's patience; each session is sealed in one step, or left as it was."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._child.wait(END_S)
        self._child.kill()
        self._child.wait()
        self._thread.join(END_S)

    def _listen(self) -> None:
        assert self._child.stdout is not None
        with self._child.stdout as lines:
            for line in lines:
                self._report(line.decode(errors="replace").rstrip("\n"))


def main() -> None:
    """Seal, and print a line on each session."""
    os.nice(NICENESS)
    with contextlib.suppress(OSError):  # where memory runs out, this process is the one to go
        Path("/proc/self/oom_score_adj").write_text("1000")
    for folder in recorded_folders(Path(sys.argv[1])):
        _seal_in_child(folder)


def _seal_in_child(folder: Path) -> None:
    """Seal one session in a process of its own: what is in it may cost that process, and no more than its time."""
    child = os.fork()
    if child:
        os.waitpid(child, 0)
        return
    try:
        signal.alarm(LONGEST_S)
        found = _seal_or_explain(folder)
        if found is not None:
            sys.stdout.write(plain(found.text) + "\n")
            sys.stdout.flush()
    finally:
        os._exit(0)  # whatever happened: what follows is the other process's work


def _seal_or_explain(folder: Path) -> Interrupted | None:
    try:
        return seal(folder)
    except Exception as error:  # noqa: BLE001 - reported, as all that goes wrong in a session is
        return Interrupted(folder=folder, trouble=f"{type(error).__name__}: {error}")


if __name__ == "__main__":
    main()
