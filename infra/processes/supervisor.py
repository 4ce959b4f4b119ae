"""Keeps a child process running: one that dies or hangs is ended, and the next takes its place."""

from __future__ import annotations

import contextlib
import logging
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any, Generic, TypeVar

from infra.processes.child_process import ChildProcess, ProcessorTime
from infra.reporting import Backoff

_log = logging.getLogger(__name__)

SPARE_AGAIN_S = 0.3
"""Seconds between two attempts to start a process."""

Child = TypeVar("Child", bound=ChildProcess[Any])


class Supervisor(Generic[Child]):
    """Keeper of a child process: starts the next one when it ends or hangs.

    Waiting for a processor is no death: of a silence up to ``start_s`` only the time counts in which the process could
    run. On a machine that is too busy another one would not fare better.

    The first runs when this returns; :meth:`supervise` begins to look after it. All that is called back is called by
    one thread, but for the first ``start`` and ``begin``.

    Args:
        start: starts a process that waits for its first message; raises OSError where the system starts none.
        begin: sends that message to a process whose turn it is.
        watch: waits for a sign of life, at most this many seconds, and returns for how long the process may be silent
            from now on, None: there was none. Raises EOFError where the process is over or of no more use.
        replaced: given what was wrong with a process and when it last showed life (monotonic), once the next has begun.
        excused: whether a process that has been silent for too long is left alone.
        watch_s: for which ``watch`` waits.
        start_s: for which a process may be silent at first.
        stop_s: for which it may be silent when it is to end.
        pauses_s: before another is started, after one, two, three failures in a row; the last repeats.
        steady_s: a process that lived this long ends a row.
        spare: keep a process ready that takes over at once.

    Attributes:
        process: the present one.
        spare: the one that is ready, if any.
        restarts: how often another has taken over.
        replaces: set to False where the present process is the last.

    Raises:
        OSError: the first process cannot be started.
    """

    def __init__(
        self,
        name: str,
        *,
        start: Callable[[], Child],
        begin: Callable[[Child], None],
        watch: Callable[[Child, float], float | None],
        replaced: Callable[[str, float], None],
        excused: Callable[[Child], bool] = lambda _: False,
        watch_s: float,
        start_s: float,
        stop_s: float,
        pauses_s: Sequence[float],
        steady_s: float,
        spare: bool = False,
    ) -> None:
        self._start, self._begin, self._watch = start, begin, watch
        self._replaced, self._excused = replaced, excused
        self._watch_s, self._start_s, self._stop_s = watch_s, start_s, stop_s
        self._backoff, self._steady_s = Backoff(pauses_s), steady_s
        self._keeps_spare = spare
        self._spare_due_s = 0.0
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self.spare: Child | None = None
        self.restarts = 0
        self.replaces = True
        self.process = start()
        begin(self.process)

    def supervise(self) -> None:
        """Look after the process from now on."""
        self._thread.start()

    def stop(self, timeout_s: float | None = None) -> None:
        """Ask the process to end, and kill it when it is silent for too long meanwhile."""
        self._stopping.set()
        self.process.channel.close_sending()
        if self._thread.is_alive():
            self._thread.join(timeout_s)
        else:  # it was never looked after, or is over
            self.process.kill()
            self.process.close()

    def _run(self) -> None:
        while True:
            began_s = time.monotonic()
            failure, alive_s = self._watch_until_over(self.process)
            self.process.close()
            if time.monotonic() - began_s > self._steady_s:
                self._backoff.succeeded()
            if self.replaces:
                self._stopping.wait(self._backoff.failed())
            successor = self._next() if self.replaces else None
            if successor is None:
                break
            self._begin(successor)
            self.process = successor
            _log.warning("%s: a process %s; another has begun", self._thread.name, failure)
            self._replaced(failure, alive_s)
            self.restarts += 1
        if self.spare is not None:
            self.spare.kill()
            self.spare.close()

    def _watch_until_over(self, process: Child) -> tuple[str, float]:
        """Fault with a process in the end, and when it last showed life (monotonic)."""
        alive_s, patience_s, failure = time.monotonic(), self._start_s, ""
        before = process.processor_time
        try:
            while not (process.ended or failure):
                if self._stopping.is_set():
                    process.channel.close_sending()
                    patience_s = min(patience_s, self._stop_s)
                elif self._keeps_spare:
                    self._keep_spare()
                granted_s = self._watch(process, self._watch_s)
                silent_s = time.monotonic() - alive_s
                if granted_s is not None:
                    alive_s, patience_s, before = time.monotonic(), granted_s, process.processor_time
                elif silent_s > patience_s and not self._is_left_alone(process, silent_s, patience_s, before):
                    process.kill()
                    failure = f"showed no life for {silent_s:.1f} s"
            while process.ended:  # what it sent before, until its end of the channel
                self._watch(process, 0.0)
        except EOFError:
            process.end(self._stop_s)
        return failure or f"died ({process.exit_reason})", alive_s

    def _is_left_alone(self, process: Child, silent_s: float, patience_s: float, before: ProcessorTime) -> bool:
        """Tell whether a process is not replaced though it is silent."""
        if self._stopping.is_set():
            return False
        starved = silent_s <= self._start_s and process.able_s(silent_s, before) <= patience_s
        return starved or self._excused(process)

    def _keep_spare(self) -> None:
        """Start a process that waits for its turn, where there is none."""
        if (self.spare is None or self.spare.ended) and time.monotonic() >= self._spare_due_s:
            self._spare_due_s = time.monotonic() + SPARE_AGAIN_S
            if self.spare is not None:
                self.spare.close()
                self.spare = None
            with contextlib.suppress(OSError):
                self.spare = self._start()

    def _next(self) -> Child | None:
        """The spare process, else a new one, tried until the system starts one; None: it is time to end."""
        while not self._stopping.is_set():
            self._keep_spare()
            successor, self.spare = self.spare, None
            if successor is not None:
                return successor
            self._stopping.wait(SPARE_AGAIN_S)
        return None
