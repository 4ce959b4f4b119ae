"""A batch seen from outside: which of its processes writes at this moment, and killing what is wanted."""

from __future__ import annotations

import contextlib
import time
from pathlib import Path

import psutil

from gcs.batch.stores import ASIDE

__all__ = ["WAIT_S", "is_over", "kill_batch", "stopped_writer", "workers_of"]

WAIT_S = 120.0
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


def stopped_writer(pid: int, out: Path) -> psutil.Process:
    """A worker below a process, stopped while it writes boxes, not whole yet, into the results.

    Raises:
        TimeoutError: nobody writes.
    """
    stop_s = time.monotonic() + WAIT_S
    while time.monotonic() < stop_s:
        for worker in workers_of(pid) if any(out.glob(f"{ASIDE}/**/identity.jsonl")) else ():
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


def kill_batch(pid: int) -> None:
    """Kill what hands out the flights, and wait until its workers, stopped ones too, have ended by themselves.

    Raises:
        TimeoutError: a worker outlives it.
    """
    workers = workers_of(pid)
    psutil.Process(pid).kill()
    for worker in workers:
        with contextlib.suppress(psutil.Error):
            worker.resume()
    stop_s = time.monotonic() + WAIT_S
    while not all(map(is_over, workers)):
        if time.monotonic() > stop_s:
            raise TimeoutError("workers outlive the batch")
        time.sleep(POLL_S)
