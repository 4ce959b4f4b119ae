"""What a process and its children cost, from the system's own tables (Linux)."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

__all__ = ["Cost", "cost_of", "family"]

PROC = Path("/proc")
TICKS_HZ = os.sysconf("SC_CLK_TCK")


@dataclass(frozen=True, slots=True, kw_only=True)
class Cost:
    """Sums over a process and all below it."""

    processes: int
    rss_mb: float
    """Memory held, shared pages counted once for each that maps them: a shared ring counts as it is first filled."""
    own_mb: float
    """Of it what nobody shares and no file holds: where leaks are."""
    cpu_s: float
    """Processor time since the start, of those that still run."""
    threads: int
    descriptors: int


def family(pid: int) -> list[int]:
    """A process and all below it; empty when it is gone."""
    found, waiting = [], [pid]
    while waiting:
        each = waiting.pop()
        try:
            children = [task.joinpath("children").read_text().split() for task in (PROC / str(each) / "task").iterdir()]
        except OSError:
            continue
        found.append(each)
        waiting += [int(child) for below in children for child in below]
    return found


def cost_of(pid: int) -> Cost:
    """What a process and all below it hold now; zeros when it is gone."""
    rows = [row for each in family(pid) if (row := _row(PROC / str(each))) is not None]
    rss, own, cpu, threads, descriptors = (sum(column) for column in zip(*rows, strict=True)) if rows else (0,) * 5
    return Cost(
        processes=len(rows),
        rss_mb=rss / 1e6,
        own_mb=own / 1e6,
        cpu_s=float(cpu),
        threads=int(threads),
        descriptors=int(descriptors),
    )


def _row(folder: Path) -> tuple[float, float, float, int, int] | None:
    """Bytes, bytes of its own, seconds, threads, open descriptors; None when the process is gone."""
    try:
        # the name, in brackets, may hold blanks: fields are counted from behind it
        stat = (folder / "stat").read_text().rpartition(")")[2].split()
        _, held, shared, *_ = map(int, (folder / "statm").read_text().split())
        page = os.sysconf("SC_PAGE_SIZE")
        return (
            held * page,
            (held - shared) * page,
            (int(stat[11]) + int(stat[12])) / TICKS_HZ,
            int(stat[17]),
            sum(1 for _ in (folder / "fd").iterdir()),
        )
    except OSError:
        return None
