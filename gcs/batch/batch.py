"""A batch: flights in, each worked on once, one table over all of them out. Prints nothing.

Workers of a Dask cluster have a process of their own for each flight, beside the Dask worker. They may come and go:
Dask gives what a worker had to another one. distributed is an extra (``cluster``), and imported when a cluster is asked
for.
"""

from __future__ import annotations

import contextlib
import os
import threading
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from itertools import islice
from typing import TYPE_CHECKING

from gcs.batch.addresses import is_of_this_process, is_remote, local_path
from gcs.batch.flights import BatchFlight
from gcs.batch.jobs import (
    FAILED,
    FLIGHTS_TABLE,
    RECORDS,
    BatchOptions,
    FlightDone,
    FlightFailed,
    FlightJob,
    FlightRecord,
    program_version,
)
from gcs.batch.local_pool import FlightResult, OnFrames, run_here, run_in_processes
from gcs.batch.records import write_failure, write_table
from gcs.batch.runner import FlightRunner, RunLimits, share_of_memory
from gcs.batch.stores import ASIDE, LOCK, ResultStore, open_results
from gcs.errors import BatchError, ClusterError
from gcs.export.tables.arrow import import_pyarrow
from infra.secrets import conceal, concealed

if TYPE_CHECKING:
    from distributed import Client, Future

CONNECT_S = 10.0
AHEAD = 4
"""Flights for each thread of the cluster that the scheduler knows of at a time."""
MIN_AHEAD = 64
"""Least number of flights that the scheduler knows of, so that a worker that joins late finds some."""
_own = threading.local()
_runners: dict[FlightRunner, threading.Lock] = {}
_changing = threading.Lock()
LEFT_ASIDE_S = 86_400.0
"""Age beyond which no other machine is still working on what it claimed."""
Note = Callable[[str], None]
Results = Generator[FlightResult, None, None]


def run_in_cluster(
    jobs: Iterable[FlightJob], scheduler: str, limits: RunLimits, note: Callable[[str], None]
) -> Generator[FlightResult, None, None]:
    """Work on flights by a cluster, and give results as they come; closing it gives up the rest.

    Args:
        scheduler: its address, as ``tcp://head:8786``.
        note: called with the address of the dashboard, and while there is no worker.

    Raises:
        ClusterError: distributed is not installed, no scheduler answers there, or it is lost.
    """
    with _connected(scheduler) as client:
        note(f"dashboard: {client.dashboard_link}")
        if not (threads := sum(client.nthreads().values())):
            note(f"{scheduler} has no worker yet; start some: dask worker {scheduler}")
        waiting = iter(jobs)
        try:
            yield from _results(client, waiting, max(MIN_AHEAD, AHEAD * threads), limits)
        finally:
            with contextlib.suppress(Exception):  # workers may be gone, and end their children then
                client.run(close_idle_runners)


@contextlib.contextmanager
def _connected(scheduler: str) -> Iterator[Client]:
    try:
        from distributed import Client
    except ImportError:
        raise ClusterError("a cluster needs Dask: pip install 'rollcall-gcs[cluster]'") from None
    try:
        client = Client(scheduler, timeout=CONNECT_S, name="gcs batch")
    except (OSError, ValueError) as error:
        raise ClusterError(
            f"{scheduler}: no Dask scheduler answers there ({error}); start one: dask scheduler"
        ) from error
    with client:
        yield client


def _results(
    client: Client, waiting: Iterator[FlightJob], ahead: int, limits: RunLimits
) -> Generator[FlightResult, None, None]:
    from distributed import as_completed

    asked: dict[str, FlightJob] = {}

    def ask(job: FlightJob) -> Future:
        future = client.submit(run_on_worker, job, limits, pure=False)
        asked[future.key] = job
        return future

    completed = as_completed([ask(job) for job in islice(waiting, ahead)])
    for future in completed:
        job = asked.pop(future.key)
        if future.status == "cancelled" or client.status != "running":
            raise ClusterError("the scheduler was lost; run the batch again, and it goes on where it was")
        yield job, _outcome(future)
        completed.update([ask(job) for job in islice(waiting, 1)])


def _outcome(future: Future) -> FlightDone | FlightFailed:
    error = future.exception()
    if error is None:
        result: FlightDone | FlightFailed = future.result()
        return result
    # KilledWorker, or a worker that lacks what the others have
    return FlightFailed(
        conceal(f"the cluster lost it: {' '.join(str(error).split()) or type(error).__name__}"), again=False
    )


# What follows runs in the Dask workers.


def run_on_worker(job: FlightJob, limits: RunLimits) -> FlightDone | FlightFailed:
    """Work on a flight in a child of this Dask worker; each of its threads has one, which is kept."""
    if limits.most_bytes is None:
        limits = replace(limits, most_bytes=_share())
    runner: FlightRunner | None = getattr(_own, "runner", None)
    if runner is None:
        runner = _own.runner = FlightRunner(limits)
        with _changing:
            _runners[runner] = threading.Lock()
    with _runners[runner]:
        runner.limits = limits
        return runner.run(job)


def close_idle_runners() -> None:
    """End the children that have nothing to do."""
    with _changing:
        idle = [(runner, busy) for runner, busy in _runners.items() if busy.acquire(blocking=False)]
    for runner, busy in idle:
        runner.close()
        busy.release()


def _share() -> int:
    """Bytes of one thread of this Dask worker."""
    from distributed import get_worker

    worker = get_worker()
    threads = worker.state.nthreads
    given = worker.memory_manager.memory_limit
    return int(given / threads) if given else share_of_memory(threads)


@dataclass(frozen=True, slots=True, kw_only=True)
class BatchWork:
    """Workers, and what a flight may cost."""

    workers: int = 0
    """Processes of this machine; 0: one for each core."""
    scheduler: str = ""
    """Address of a Dask scheduler, whose workers work instead."""
    limits: RunLimits = field(default_factory=RunLimits)


@dataclass(frozen=True, slots=True, kw_only=True)
class BatchCounts:
    """Outcome of the flights of one run."""

    done: int = 0
    """Number of flights with a result, skipped ones included."""
    skipped: int = 0
    """Number of flights whose result was there before."""
    failed: int = 0
    frames: int = 0
    """Number of frames that this run looked at."""


def run_batch(
    flights: Sequence[BatchFlight],
    out: str,
    *,
    options: BatchOptions | None = None,
    work: BatchWork | None = None,
    on_result: Callable[[FlightRecord, bool], None] = lambda record, skipped: None,
    on_frames: OnFrames = lambda flight, done, total: None,
    note: Note = lambda text: None,
) -> BatchCounts:
    """Name the flights that have no result yet, and put the table of all flights into place.

    A flight that fails costs nothing but itself. What is broken off goes on where it was when this is called again.

    Args:
        flights: as ``gcs.batch.flights.find_flights`` gives them.
        out: folder of the results, or an address that fsspec writes; new, or of a batch before.
        on_result: called with each flight's record as it comes, and whether its result was there before.
        on_frames: called with a flight's name, how many of its frames are done, and of how many; not from a cluster.
        note: called with each line that a user should read.

    Returns:
        How many flights were done, skipped and failed.

    Raises:
        BatchError: the folder holds something else, or what writes Parquet is not installed.
        StoreError: the results cannot be written, or another batch is writing them.
        ClusterError: there is no such cluster.
    """
    import_pyarrow()
    options, work = options or BatchOptions(), work or BatchWork()
    results = open_results(out if is_remote(out) else str(local_path(out).absolute()))
    _check(results)
    now: dict[str, FlightRecord] = {}
    counts = BatchCounts()
    with results.claim(older_s=LEFT_ASIDE_S if work.scheduler else 0.0):
        jobs = [
            FlightJob(
                name=flight.name,
                address=flight.address,
                out=results.address,
                options=options,
                version=program_version(),
            )
            for flight in flights
        ]
        try:
            with closing(_run(jobs, work, on_frames, note)) as outcomes:
                for job, outcome in outcomes:
                    record = _record(results, job, outcome)
                    now[record.flight] = record
                    skipped = isinstance(outcome, FlightDone) and outcome.skipped
                    counts = _counted(counts, record, skipped)
                    on_result(record, skipped)
        finally:
            write_table(results, now)
    return counts


def _check(results: ResultStore) -> None:
    """Check that a folder is new or a batch's.

    Raises:
        BatchError: it holds something else.
    """
    there = set(results.names("")) - {ASIDE, LOCK}
    if there and RECORDS not in there and FLIGHTS_TABLE not in there:
        raise BatchError(
            f"{concealed(results.address)}: holds something else than a batch's results; choose another folder"
        )


def _run(jobs: Iterable[FlightJob], work: BatchWork, on_frames: OnFrames, note: Note) -> Results:
    jobs = list(jobs)
    if any(is_of_this_process(address) for job in jobs for address in (job.address, job.out)):
        note("memory:// is of this process alone, which names its flights one after the other, without a time limit")
        return run_here(jobs)
    if work.scheduler:
        return run_in_cluster(jobs, work.scheduler, work.limits, note)
    workers = work.workers or os.cpu_count() or 1
    limits = replace(work.limits, most_bytes=work.limits.most_bytes or share_of_memory(workers))
    return run_in_processes(jobs, min(workers, len(jobs)), limits, on_frames)


def _record(results: ResultStore, job: FlightJob, outcome: FlightDone | FlightFailed) -> FlightRecord:
    if isinstance(outcome, FlightDone):
        return outcome.record
    record = FlightRecord(
        flight=job.name,
        status=FAILED,
        error=outcome.error,
        source=concealed(job.address),
        version=job.version,
        versions={},
        options=job.options.text(),
        attempts=outcome.attempts,
    )
    return write_failure(results, record)


def _counted(counts: BatchCounts, record: FlightRecord, skipped: bool) -> BatchCounts:
    if record.status == FAILED:
        return replace(counts, failed=counts.failed + 1)
    looked = 0 if skipped else record.frames or 0
    return replace(counts, done=counts.done + 1, skipped=counts.skipped + skipped, frames=counts.frames + looked)
