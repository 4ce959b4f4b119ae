"""Flights worked on by several processes of this machine, or by this one where only it can read them."""

from __future__ import annotations

import queue
import shutil
import threading
from collections.abc import Callable, Generator, Iterable

import msgspec

from gcs.batch.jobs import SCRATCH_LOG, FlightDone, FlightFailed, FlightJob
from gcs.batch.runner import FlightRunner, RunLimits, keep_log
from gcs.batch.stores import open_results

FlightResult = tuple[FlightJob, FlightDone | FlightFailed]
OnFrames = Callable[[str, int, int], None]
"""Callback for progress: a flight's name, the number of frames that are done, and of all frames."""


def run_in_processes(
    jobs: Iterable[FlightJob], workers: int, limits: RunLimits, on_frames: OnFrames
) -> Generator[FlightResult, None, None]:
    """Work on flights in several processes at once, and yield results as they come; closing it ends what is under way.

    Args:
        on_frames: called by the threads that look after the workers.
    """
    pool = _RunnerPool(jobs, [FlightRunner(limits) for _ in range(workers)], on_frames)
    try:
        yield from pool.results()
    finally:
        pool.stop()


class _RunnerPool:
    """A thread for each worker process: it hands out the next flight, and looks after the process meanwhile."""

    def __init__(self, jobs: Iterable[FlightJob], runners: list[FlightRunner], on_frames: OnFrames) -> None:
        self._jobs, self._runners, self._on_frames = iter(jobs), runners, on_frames
        self._taking = threading.Lock()
        self._came = queue.SimpleQueue[FlightResult | BaseException | None]()
        self._threads = [threading.Thread(target=self._look_after, args=(each,), name="batch") for each in runners]
        for thread in self._threads:
            thread.start()

    def results(self) -> Generator[FlightResult, None, None]:
        working = len(self._threads)
        while working:
            result = self._came.get()
            if isinstance(result, BaseException):
                raise result
            if result is None:
                working -= 1
            else:
                yield result

    def stop(self) -> None:
        for runner in self._runners:
            runner.stop()
        for thread in self._threads:
            thread.join()

    def _look_after(self, runner: FlightRunner) -> None:
        try:
            while (job := self._next()) is not None and not runner.stopping:
                self._came.put((job, self._run(runner, job)))
            self._came.put(None)
        except BaseException as error:  # noqa: BLE001 - raised again where results are taken
            self._came.put(error)
        finally:
            runner.close()

    def _next(self) -> FlightJob | None:
        with self._taking:
            return next(self._jobs, None)

    def _run(self, runner: FlightRunner, job: FlightJob) -> FlightDone | FlightFailed:
        def report(done: int, total: int) -> None:
            self._on_frames(job.name, done, total)

        return runner.run(job, report)


def run_here(jobs: Iterable[FlightJob]) -> Generator[FlightResult, None, None]:
    """Work on flights in this process, one after the other."""
    from gcs.batch.work import work_on  # loads all that names flights

    for job in jobs:
        scratch = open_results(job.out).scratch("here")
        try:
            result = work_on(msgspec.structs.replace(job, scratch=str(scratch)))
            keep_log(job, result, (scratch / SCRATCH_LOG).read_bytes())
        finally:
            shutil.rmtree(scratch, ignore_errors=True)
        yield job, result
