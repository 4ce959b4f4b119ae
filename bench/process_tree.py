"""What a process and its children cost, as the system accounts it (Linux)."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass

import psutil


@dataclass(frozen=True, slots=True, kw_only=True)
class Cost:
    """Sums over a process and all below it."""

    processes: int = 0
    rss_mb: float = 0.0
    """Memory held, shared pages counted once for each that maps them: a shared ring counts as it is first filled."""
    own_mb: float = 0.0
    """Part of it that is neither shared nor backed by a file: where leaks are."""
    cpu_s: float = 0.0
    """Processor time since the start, of those that still run."""
    threads: int = 0
    descriptors: int = 0

    def __add__(self, other: Cost) -> Cost:
        return Cost(**{name: getattr(self, name) + getattr(other, name) for name in self.__slots__})


def family(pid: int) -> list[int]:
    """A process and all below it; empty when it is gone."""
    with contextlib.suppress(psutil.Error):
        return [pid, *(child.pid for child in psutil.Process(pid).children(recursive=True))]
    return []


def cost_of(pid: int) -> Cost:
    """What a process and all below it hold now; zeros when it is gone."""
    return sum(map(_cost, family(pid)), Cost())


def _cost(pid: int) -> Cost:
    """Of one process; zeros when it is gone."""
    with contextlib.suppress(psutil.Error):
        process = psutil.Process(pid)
        with process.oneshot():
            memory, times = process.memory_info(), process.cpu_times()
            return Cost(
                processes=1,
                rss_mb=memory.rss / 1e6,
                own_mb=(memory.rss - memory.shared) / 1e6,
                cpu_s=times.user + times.system,
                threads=process.num_threads(),
                descriptors=process.num_fds(),
            )
    return Cost()
