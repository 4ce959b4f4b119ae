"""Batches as processes, and what a test sees of them from outside."""

from __future__ import annotations

import subprocess
import tempfile
from pathlib import Path

from bench.batch.watching import kill_batch
from gcs.batch.jobs import FlightJob, identity_name, program_version
from gcs.batch.work import identify_flight
from tests.support.command_line import GCS

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
        kill_batch(self.pid)
        self.process.communicate(timeout=WAIT_S)

    def __enter__(self) -> WatchedBatch:
        return self

    def __exit__(self, *_: object) -> None:
        if self.process.poll() is None:
            self.kill()
