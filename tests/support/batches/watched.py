"""Batches as processes, and what a test sees of them from outside: who writes, what is there, who is left."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import tempfile
from pathlib import Path

import psutil

from gcs.batch.jobs import FlightJob, identity_name, program_version
from gcs.batch.stores import ASIDE
from gcs.batch.work import identify_flight
from tests.support.command_line import GCS
from tests.support.waiting import until

WAIT_S = 120.0


def single_run(flight: Path) -> bytes:
    """The table of a flight that is named alone, in this process."""
    with tempfile.TemporaryDirectory() as out, tempfile.TemporaryDirectory() as scratch:
        identify_flight(
            FlightJob(name="alone", address=str(flight), out=out, scratch=scratch, version=program_version())
        )
        return (Path(out) / identity_name("alone")).read_bytes()


def tables(out: Path) -> dict[str, bytes]:
    """The bytes of each flight's table in a folder of results."""
    return {path.parent.name.partition("=")[2]: path.read_bytes() for path in out.glob("identity/*/part-0.parquet")}


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
    """A worker below a process, stopped while it writes boxes, not whole yet, into the results."""
    found: list[psutil.Process] = []

    def looked() -> bool:
        if not any(out.glob(f"{ASIDE}/**/identity.jsonl")):
            return False
        for worker in workers_of(pid):
            with contextlib.suppress(psutil.NoSuchProcess):
                worker.suspend()
            if _is_writing(worker, out.resolve()):
                found.append(worker)
                return True
            with contextlib.suppress(psutil.NoSuchProcess):
                worker.resume()
        return False

    assert until(looked, WAIT_S), "nobody writes"
    return found[0]


def is_over(process: psutil.Process) -> bool:
    """Whether a process has ended, reaped or not."""
    try:
        return not process.is_running() or process.status() == psutil.STATUS_ZOMBIE
    except psutil.Error:
        return True


def records(out: Path) -> int:
    """How many flights have their record."""
    return len(list(out.glob("records/*.json")))


class WatchedBatch:
    """``gcs batch`` in a process of its own."""

    def __init__(self, *words: object) -> None:
        self.process = subprocess.Popen(
            [*GCS, "batch", *map(str, words)],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
        )
        self.pid = self.process.pid

    def finish(self) -> tuple[int, str]:
        """Its exit code and what it wrote."""
        said, _ = self.process.communicate(timeout=WAIT_S)
        return self.process.returncode, said

    def kill(self) -> None:
        """End it at once, and wait until its workers, stopped ones too, have ended by themselves."""
        workers = workers_of(self.pid)
        os.kill(self.pid, signal.SIGKILL)
        for worker in workers:
            with contextlib.suppress(psutil.Error):
                worker.resume()
        self.process.communicate(timeout=WAIT_S)
        assert until(lambda: all(map(is_over, workers)), WAIT_S), "workers outlive the batch"

    def __enter__(self) -> WatchedBatch:
        return self

    def __exit__(self, *_: object) -> None:
        if self.process.poll() is None:
            self.kill()
