"""Memory and processor time of a worker with the processes that it has decode films."""

from __future__ import annotations

import contextlib
import os
import resource
import sys

import psutil


def held_bytes(worker: psutil.Process) -> int:
    """Memory that a process and those that it started hold now.

    Raises:
        psutil.Error: it is gone.
    """
    held = int(worker.memory_info().rss)
    for child in worker.children(recursive=True):
        with contextlib.suppress(psutil.Error):  # it has ended meanwhile
            held += int(child.memory_info().rss)
    return held


def peak_bytes() -> int:
    """Most memory that this process alone has held: what the system tells of those that have ended begins with ours."""
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit


def processor_s() -> float:
    """Processor time of this process and of those that it started and that have ended, s."""
    return sum(os.times()[:4])
