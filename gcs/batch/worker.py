"""The process that works on flights, one after the other: ``python -m gcs.batch.worker``.

It keeps what is loaded. When the process that asked for work ends, however it does, this one removes what is not whole
and ends too.
"""

from __future__ import annotations

import gc
import os
import queue
import shutil
import threading

from gcs.batch.jobs import FlightJob
from gcs.batch.work import work_on
from infra.processes.channel import MessageChannel, connect_to_parent


class _JobInbox:
    """Inbox of the jobs that come from another process; the end of whoever sends them is the end of this process."""

    def __init__(self, channel: MessageChannel[FlightJob]) -> None:
        self._channel = channel
        self._jobs: queue.SimpleQueue[FlightJob] = queue.SimpleQueue()
        self._scratch = ""
        threading.Thread(target=self._listen, daemon=True, name="jobs").start()

    def next(self) -> FlightJob:
        job = self._jobs.get()
        self._scratch = job.scratch
        return job

    def _listen(self) -> None:
        try:
            while True:
                if (job := self._channel.receive()) is not None:
                    self._jobs.put(job)
        except EOFError:
            if self._scratch:
                shutil.rmtree(self._scratch, ignore_errors=True)
            os._exit(0)


def main() -> None:
    """Work until no more is asked."""
    gc.freeze()
    gc.set_threshold(50_000, 20, 100)  # as the command has it
    channel: MessageChannel[FlightJob] = connect_to_parent(FlightJob)
    jobs = _JobInbox(channel)
    while True:
        job = jobs.next()
        channel.send(work_on(job, channel))


if __name__ == "__main__":
    main()
