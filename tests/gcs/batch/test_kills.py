"""Whatever is killed when: called again, a batch is complete, each flight once, with the bytes of single runs."""

from __future__ import annotations

import sys

import duckdb
import psutil
import pytest

from tests.support.batches.results import records, single_run, tables
from tests.support.batches.short_flights import short_flights
from tests.support.batches.watching import WatchedBatch, is_over, stopped_writer, workers_of
from tests.support.bundled import SWARM
from tests.support.command_line import run_gcs
from tests.support.ports import free_port
from tests.support.waiting import until

DASK = (sys.executable, "-m", "dask")


def each_once(out):
    """Rows of each flight's table, by DuckDB, and how often the table of flights has it."""
    rows = duckdb.sql(f"select flight, count(*) from '{out}/identity/*/*.parquet' group by flight").fetchall()
    listed = duckdb.sql(f"select flight, count(*) from '{out}/flights.parquet' group by flight").fetchall()
    return dict(rows), dict(listed)


@pytest.mark.slow
def test_one_killed_worker_costs_an_attempt_and_no_flight(tmp_path):
    flights, out = short_flights(tmp_path / "flights", 2, frames=40), tmp_path / "out"
    with WatchedBatch(*flights, "-o", out, "-j", 1) as batch:
        stopped_writer(batch.pid, out).kill()
        code, said = batch.finish()
    assert code == 0, said
    attempts = dict(duckdb.sql(f"select attempts, flight from '{out}/flights.parquet'").fetchall())
    assert attempts.keys() == {1, 2}
    assert "its worker died (signal 9)" in (out / "logs" / f"{attempts[2]}.log").read_text()


@pytest.mark.slow
def test_a_killed_batch_is_gone_on_with(tmp_path):
    flights, out = short_flights(tmp_path / "flights", 2, frames=40), tmp_path / "out"
    with WatchedBatch(*flights, "-o", out, "-j", 1) as batch:
        assert until(lambda: records(out) == 1)
        stopped_writer(batch.pid, out)
        batch.kill()
    code, stdout, _ = run_gcs("batch", "run", *flights, "-o", out, "-j", "1")
    assert code == 0
    assert "1 of them before" in stdout
    assert each_once(out) == (each_once(out)[0], {"a": 1, "b": 1})
    assert tables(out) == {flight.name: single_run(flight) for flight in flights}
    assert not list((out / ".aside").iterdir())


@pytest.mark.slow
def test_a_flight_that_takes_too_long_costs_nothing_else(tmp_path):
    flights, out = short_flights(tmp_path / "flights", 2, frames=40), tmp_path / "out"
    with WatchedBatch(*flights, "-o", out, "-j", 1, "--retries", 0, "--timeout", 30) as batch:
        stopped_writer(batch.pid, out)
        code, said = batch.finish()
    assert code == 6, said
    assert "failed: took longer than 30 s" in said
    assert "1 of 2 flights done" in said
    assert len(tables(out)) == 1


@pytest.mark.slow
def test_a_flight_that_needs_too_much_memory_is_told(tmp_path):
    out = tmp_path / "out"
    code, _, stderr = run_gcs("batch", "run", SWARM, "-o", out, "-j", "2", "--retries", "0", "--memory", "0.1")
    assert code == 6
    assert "ardupilot-swarm failed: needed more than 0.1 GiB of memory" in stderr
    assert not tables(out)


@pytest.mark.slow
def test_two_batches_do_not_write_into_one_folder(tmp_path):
    flights, out = short_flights(tmp_path / "flights", 1, frames=40), tmp_path / "out"
    with WatchedBatch(*flights, "-o", out) as batch:
        writer = stopped_writer(batch.pid, out)
        code, _, stderr = run_gcs("batch", "run", *flights, "-o", out)
        assert code == 3
        assert "another batch is writing into it" in stderr
        writer.resume()
        assert batch.finish()[0] == 0


class DaskProcess:
    """A part of a cluster, started as the page on batches says."""

    def __init__(self, log, *words):
        self._log = log.open("wb")
        self.process = psutil.Popen(
            [*DASK, *map(str, words)], stdout=self._log, stderr=self._log, start_new_session=True
        )
        self.pid = self.process.pid

    def kill(self):
        """End it and all Dask processes below it at once; their own children end by themselves."""
        below = [child for child in self.process.children(recursive=True) if "gcs.batch.worker" not in child.cmdline()]
        for process in (self.process, *below):
            process.kill()
        self.process.wait()
        self._log.close()


@pytest.mark.slow
def test_a_worker_of_a_cluster_joins_late_and_another_is_killed(tmp_path):
    flights, out = short_flights(tmp_path / "flights", 3, frames=30), tmp_path / "out"
    address = f"tcp://127.0.0.1:{(port := free_port())}"
    place = ("--host", "127.0.0.1", "--dashboard-address", "127.0.0.1:0")
    running = [DaskProcess(tmp_path / "scheduler.log", "scheduler", *place, "--port", port)]
    try:
        running.append(first := DaskProcess(tmp_path / "first.log", "worker", address, "--nthreads", 1))
        with WatchedBatch(*flights, "-o", out, "--scheduler", address) as batch:
            stuck = stopped_writer(first.pid, out)  # the first can do no more, so that the other does what is done
            before = records(out)
            running.append(DaskProcess(tmp_path / "late.log", "worker", address, "--nthreads", 1))
            assert until(lambda: records(out) > before)
            first.kill()
            stuck.resume()
            code, said = batch.finish()
        assert code == 0, said
        assert "dashboard: http://127.0.0.1:" in said
        assert until(lambda: is_over(stuck))
        assert not workers_of(running[-1].pid), "children of the cluster's workers stay"
    finally:
        for part in running:
            if part.process.is_running():
                part.kill()
    assert tables(out) == {flight.name: single_run(flight) for flight in flights}
    rows, listed = each_once(out)
    assert listed == dict.fromkeys(rows, 1)
    assert len(rows) == 3


@pytest.mark.slow
def test_a_cluster_that_is_not_there(tmp_path):
    (flight,) = short_flights(tmp_path / "flights", 1)
    code, _, stderr = run_gcs(
        "batch", "run", flight, "-o", tmp_path / "out", "--scheduler", f"tcp://127.0.0.1:{free_port()}"
    )
    assert code == 3
    assert "no Dask scheduler answers" in stderr
