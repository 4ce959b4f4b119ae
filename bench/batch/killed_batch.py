"""A batch of which a worker is killed while it writes, then the process that hands out flights; and then again."""

from __future__ import annotations

import time
from pathlib import Path

import duckdb
from pyarrow import parquet

from bench.batch.watching import WAIT_S, WatchedBatch, stopped_writer
from gcs.batch.identity_table import write_identity_table
from infra.session_format import IDENTITY_EVIDENCE

__all__ = ["kill_and_go_on"]


def kill_and_go_on(folder: Path, names: set[str], broken: set[str], singles: Path) -> bool:
    """Print what was killed when, and whether all is there afterwards, each flight once.

    Args:
        folder: with ``flights`` in it.
        names: of all flights.
        broken: those that cannot be named.
        singles: the results of ``gcs identify`` for each flight, made alone.
    """
    out, good = folder / "killed", names - broken
    words = (folder / "flights", "-o", out, "-j", 2)
    with WatchedBatch(*words) as batch:
        stopped = stopped_writer(batch.pid, out)
        _wait(out, len(names) // 4, batch)  # by the other worker
        stopped.kill()
        print(f"- killed a worker while it wrote; {_records(out)} flights had their record")
        stopped_writer(batch.pid, out)
        _wait(out, len(names) // 2, batch)
        batch.kill()
    print(f"- killed the batch while a worker wrote; {_records(out)} flights had their record")
    with WatchedBatch(*words) as again:
        code, said = again.finish()
    print(f"- run again: exit {code}; {said.strip().splitlines()[-1].partition(' frames in')[0]} frames\n")
    tables = duckdb.connect()
    status = dict(tables.execute(f"select flight, status from '{out}/flights.parquet'").fetchall())
    listed = tables.execute(f"select count(*), count(distinct flight) from '{out}/flights.parquet'").fetchall()
    parts = tables.execute(
        f"select flight, count(distinct filename) from read_parquet('{out}/identity/*/*.parquet', filename = true, "
        "hive_types = {'flight': varchar}) group by flight"
    ).fetchall()
    equal = {name for name in good if _is_as_alone(singles / name, _table(out, name), folder / "alone.parquet")}
    checks = {
        "exit 6": code == 6 if broken else code == 0,
        f"{len(names)} flights in flights.parquet, each once": listed == [(len(names), len(names))],
        f"{len(good)} done": {name for name, each in status.items() if each == "done"} == good,
        f"{len(broken)} failed": {name for name, each in status.items() if each == "failed"} == broken,
        f"{len(good)} identity tables, each once in DuckDB": dict(parts) == dict.fromkeys(good, 1),
        f"{len(equal)} of {len(good)} tables have the bytes of what gcs identify wrote alone": equal == good,
        "nothing is left aside": not list((out / ".aside").iterdir()),
    }
    for text, held in checks.items():
        print(f"- {'yes' if held else 'NO'}: {text}")
    return all(checks.values())


def _records(out: Path) -> int:
    return len(list(out.glob("records/*.json")))


def _wait(out: Path, records: int, batch: WatchedBatch) -> None:
    stop_s = time.monotonic() + WAIT_S + 5 * records
    while _records(out) < records:
        if batch.process.poll() is not None or time.monotonic() > stop_s:
            raise SystemExit(f"the batch ended, or made no {records} flights in time")
        time.sleep(0.02)


def _table(out: Path, name: str) -> Path:
    return out / "identity" / f"flight={name}" / "part-0.parquet"


def _is_as_alone(identified: Path, table: Path, place: Path) -> bool:
    """Whether a table has the bytes of one made of what ``gcs identify`` wrote."""
    told = parquet.read_schema(table).metadata
    about = {key.decode(): value.decode() for key, value in told.items() if key.startswith(b"rollcall.")}
    write_identity_table(identified / IDENTITY_EVIDENCE, place, about)
    return place.read_bytes() == table.read_bytes()
