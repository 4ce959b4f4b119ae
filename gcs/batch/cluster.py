"""Flights worked on by the workers of a Dask cluster, each in a process of its own beside the Dask worker.

Workers may come and go: Dask gives what a worker had to another one. distributed is an extra (``cluster``), and
imported when a cluster is asked for.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Generator, Iterable, Iterator
from dataclasses import replace
from itertools import islice
from typing import TYPE_CHECKING

from gcs.batch.jobs import FlightDone, FlightFailed, FlightJob
from gcs.batch.local_pool import FlightResult
from gcs.batch.runner import FlightRunner, RunLimits, share_of_memory
from gcs.errors import ClusterError
from infra.secrets import conceal

if TYPE_CHECKING:
    from distributed import Client, Future

CONNECT_S = 10.0
AHEAD = 4
"""Flights for each thread of the cluster that the scheduler knows of, and ..."""
LEAST_AHEAD = 64
"""... at least so many, so that a worker that joins late finds some."""


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
            yield from _results(client, waiting, max(LEAST_AHEAD, AHEAD * threads), limits)
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

_own = threading.local()
_runners: dict[FlightRunner, threading.Lock] = {}
_changing = threading.Lock()


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
