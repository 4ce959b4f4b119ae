"""Results of batches, and of single runs to compare them with."""

from __future__ import annotations

import tempfile
from pathlib import Path

from gcs.batch.jobs import FlightJob, identity_name, program_version
from gcs.batch.work import identify_flight


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
