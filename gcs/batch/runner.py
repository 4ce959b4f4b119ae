"""A worker process that works on one flight after the other, and is replaced when it dies, hangs or grows."""

from __future__ import annotations

import contextlib
import logging
import os
import shutil
import time
from collections.abc import Callable
from dataclasses import dataclass

import msgspec
import psutil

from gcs.batch.jobs import SCRATCH_LOG, FlightDone, FlightFailed, FlightJob, FramesDone, file_name, log_name
from gcs.batch.stores import open_results
from gcs.errors import StoreError
from infra.processes.child_process import ChildProcess, held_bytes
from infra.secrets import conceal, hide

POLL_S = 0.2
START_S = 120.0
"""A worker loads what it needs meanwhile; time limits are counted from when it has."""
END_S = 2.0
FRESH_AFTER_BYTES = 1 << 30
"""Memory of a worker after a flight beyond which a fresh one takes its place, bytes."""
FRESH_AFTER_FLIGHTS = 500
"""Number of flights after which a fresh worker takes its place."""
MEMORY_SHARE = 0.9
"""Share of the machine's memory, for all workers together."""
ONE_THREAD = {
    name: os.environ.get(name, "1")
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OPENCV_FOR_THREADS_NUM")
}
"""Environment of a worker: one thread unless told otherwise, as there is a worker for each core."""
_WorkerMessage = FramesDone | FlightDone | FlightFailed
_log = logging.getLogger(__name__)


def share_of_memory(workers: int) -> int:
    """Bytes that each of this many workers may hold."""
    return int(MEMORY_SHARE * psutil.virtual_memory().total / workers)


@dataclass(frozen=True, slots=True, kw_only=True)
class RunLimits:
    """Limits of one flight."""

    retries: int = 1
    """Further attempts where the first was killed, took too long, or met a fault; none for input that is of no use."""
    timeout_s: float | None = None
    """Timeout of one attempt."""
    most_bytes: int | None = None
    """Most memory that a worker may hold, bytes; None: its share of the machine's memory."""


def keep_log(job: FlightJob, result: FlightDone | FlightFailed, log: bytes) -> None:
    """Put a flight's log beside its result; what was skipped has one."""
    if not (isinstance(result, FlightDone) and result.skipped):
        with contextlib.suppress(StoreError):  # the record tells the same
            open_results(job.out).write(log, log_name(job.name))


class FlightRunner:
    """Works on flights in a child process; any thread may own one.

    Attributes:
        limits: of each flight.
        stopping: whether it was told to stop.
    """

    def __init__(self, limits: RunLimits) -> None:
        self.limits = limits
        self._child: ChildProcess[_WorkerMessage] | None = None
        self._flights = 0
        self.stopping = False

    def run(
        self, job: FlightJob, report: Callable[[int, int], None] = lambda done, total: None
    ) -> FlightDone | FlightFailed:
        """Work on a flight until it is done, or has failed for good. Its log is then with the results.

        Args:
            job: without a scratch folder, which is made for each attempt.
            report: called now and then with the frames that are done, and all there are.
        """
        log = bytearray()
        for attempt in range(1, self.limits.retries + 2):
            result = self._attempt(msgspec.structs.replace(job, attempt=attempt), report, log)
            if isinstance(result, FlightFailed):
                result = msgspec.structs.replace(result, attempts=attempt)
            if isinstance(result, FlightDone) or not result.again or self.stopping:
                break
        keep_log(job, result, bytes(log))
        return result

    def stop(self) -> None:
        """End the flight that is worked on, from another thread; nothing of it stays."""
        self.stopping = True

    def close(self) -> None:
        """End the child."""
        child, self._child = self._child, None
        if child is not None:
            child.end(0.0 if self.stopping else END_S)
            child.close()

    def _attempt(self, job: FlightJob, report: Callable[[int, int], None], log: bytearray) -> FlightDone | FlightFailed:
        scratch = None
        # in a cluster this is the first to see them
        hide(job.address)
        hide(job.out)
        try:
            scratch = open_results(job.out).scratch(file_name(job.name)[:80])
            result = self._work(msgspec.structs.replace(job, scratch=str(scratch)), report)
        except (StoreError, OSError) as error:
            return FlightFailed(conceal(" ".join(str(error).split())), again=True)
        finally:
            if scratch is not None:
                with contextlib.suppress(OSError):
                    log += (scratch / SCRATCH_LOG).read_bytes()
                shutil.rmtree(scratch, ignore_errors=True)
        if isinstance(result, FlightFailed) and self._child is None:
            log += f"{result.error}\n".encode()
        return result

    def _work(self, job: FlightJob, report: Callable[[int, int], None]) -> FlightDone | FlightFailed:
        if self._child is None:
            self._child = ChildProcess("gcs.batch.worker", _WorkerMessage, environment=ONE_THREAD)
            self._flights = 0
        child, self._flights = self._child, self._flights + 1
        deadline_s = time.monotonic() + START_S
        begun = False
        try:
            child.channel.send(job)
            while True:
                message = child.channel.receive(POLL_S)
                if message is not None and not begun:
                    begun, deadline_s = True, time.monotonic() + (self.limits.timeout_s or float("inf"))
                if isinstance(message, FramesDone):
                    report(message.done, message.total)
                elif message is not None:
                    self._make_way(message)
                    return message
                if not begun and time.monotonic() > deadline_s:
                    return self._kill(f"its worker did not begin within {START_S:g} s")
                if failure := self._excess(child, deadline_s):
                    return self._kill(failure)
        except (EOFError, OSError):
            child.kill()
            return self._kill(f"its worker died ({child.exit_reason})")

    def _excess(self, child: ChildProcess[_WorkerMessage], deadline_s: float) -> str:
        """Limit that a flight exceeds, in words; empty for nothing."""
        if self.stopping:
            return "was broken off"
        if time.monotonic() > deadline_s:
            return f"took longer than {self.limits.timeout_s:g} s; give more with --timeout"
        with contextlib.suppress(psutil.Error):
            most, held = self.limits.most_bytes, held_bytes(psutil.Process(child.pid))
            if most is not None and held > most:
                return (
                    f"needed more than {most / 2**30:.1f} GiB of memory; "
                    "let fewer work at once with -j, or give more with --memory"
                )
        return ""

    def _kill(self, why: str) -> FlightFailed:
        child, self._child = self._child, None
        if child is not None:
            child.kill()
            child.close()
        _log.warning("a worker: %s", why)
        return FlightFailed(why, again=not self.stopping)

    def _make_way(self, result: FlightDone | FlightFailed) -> None:
        held = result.worker_bytes if isinstance(result, FlightDone) else 0
        if held > FRESH_AFTER_BYTES or self._flights >= FRESH_AFTER_FLIGHTS:
            self.close()
