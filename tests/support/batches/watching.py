"""A batch seen from outside: which of its processes writes at this moment, and killing what is wanted."""

from __future__ import annotations

import contextlib
import os
import subprocess
import time
from pathlib import Path

import psutil

from gcs.batch.stores import ASIDE
from tests.support.command_line import GCS

WAIT_S = 120.0
LONGEST_S = 3600.0
POLL_S = 0.005


def workers_of(pid: int) -> list[psutil.Process]:
    """The processes below one that work on flights."""
    return [child for child in psutil.Process(pid).children(recursive=True) if _is_worker(child)]


def _is_worker(process: psutil.Process) -> bool:
    try:
        return "gcs.batch.worker" in process.cmdline()
    except psutil.Error:
        return False


def _is_writing(process: psutil.Process, out: Path) -> bool:
    try:
        files = [Path(file.path) for file in process.open_files()]
        return any(path.is_relative_to(out) and path.name == "identity.jsonl" for path in files)
    except psutil.Error:
        return False


def _has_begun(out: Path) -> bool:
    # Unlike a glob, a walk does not fail on a folder that goes while it is read.
    return any("identity.jsonl" in files for _, _, files in os.walk(out / ASIDE))


def stopped_writer(pid: int, out: Path) -> psutil.Process:
    """A worker below a process, stopped while it writes boxes, not whole yet, into the results.

    Raises:
        TimeoutError: nobody writes.
    """
    stop_s = time.monotonic() + WAIT_S
    while time.monotonic() < stop_s:
        for worker in workers_of(pid) if _has_begun(out) else ():
            with contextlib.suppress(psutil.NoSuchProcess):
                worker.suspend()
            if _is_writing(worker, out.resolve()):
                return worker
            with contextlib.suppress(psutil.NoSuchProcess):
                worker.resume()
        time.sleep(POLL_S)
    raise TimeoutError(f"nobody writes into {out}")


def is_over(process: psutil.Process) -> bool:
    """Whether a process has ended, reaped or not."""
    try:
        return not process.is_running() or process.status() == psutil.STATUS_ZOMBIE
    except psutil.Error:
        return True


class WatchedBatch:
    """``gcs batch`` in a process of its own, which ends with the block that it was made for."""

    def __init__(self, *words: object) -> None:
        self.process = subprocess.Popen(
            [*GCS, "batch", "run", *map(str, words)],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
        )
        self.pid = self.process.pid

    def finish(self) -> tuple[int, str]:
        """Its exit code and what it wrote."""
        said, _ = self.process.communicate(timeout=LONGEST_S)
        return self.process.returncode, said

    def kill(self) -> None:
        """End it at once, and wait until its workers, stopped ones too, have ended by themselves.

        Raises:
            TimeoutError: a worker outlives it.
        """
        workers = workers_of(self.pid)
        self.process.kill()
        for worker in workers:
            with contextlib.suppress(psutil.Error):
                worker.resume()
        self.process.communicate()
        stop_s = time.monotonic() + WAIT_S
        while not all(map(is_over, workers)):
            if time.monotonic() > stop_s:
                raise TimeoutError("workers outlive the batch")
            time.sleep(POLL_S)

    def __enter__(self) -> WatchedBatch:
        return self

    def __exit__(self, *_: object) -> None:
        if self.process.poll() is None:
            self.kill()
