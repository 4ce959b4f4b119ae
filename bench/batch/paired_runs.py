"""A batch beside a shell loop over ``gcs identify``, in turn, by the processor time of all processes."""

from __future__ import annotations

import resource
import statistics
import subprocess
import time
from dataclasses import dataclass
from pathlib import Path

from bench.batch.command import GCS, GCS_WORDS

__all__ = ["compare"]

LOOP = """
for flight in "$1"/*; do
    {gcs} identify "$flight" -o "$2/${{flight##*/}}" >"$2/log" 2>&1
done
true
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Taken:
    """What a run took."""

    cpu_s: float
    """Of all its processes."""
    wall_s: float


def compare(folder: Path, flights: int, good: int, turns: int) -> Path:
    """Print flights per core hour of both and their ratio.

    Args:
        folder: with ``flights`` in it.
        flights: how many there are.
        good: how many of them can be named.
        turns: of both, at least one.

    Returns:
        The folder with the results of one loop.
    """
    loops, batches = [], []
    print("| turn | loop, processor s | batch, processor s | loop, s | batch -j 2, s |\n|---|---|---|---|---|")
    for turn in range(turns):
        singles, out = folder / f"loop-{turn}", folder / f"batch-{turn}"
        singles.mkdir()
        loops.append(_run(["bash", "-c", LOOP.format(gcs=GCS), "loop", str(folder / "flights"), str(singles)]))
        batches.append(_run([*GCS_WORDS, "batch", str(folder / "flights"), "-o", str(out), "-j", "2"], (0, 6)))
        named = len(list(singles.glob("*/identity.csv"))), len(list(out.glob("identity/*/*.parquet")))
        if named != (good, good):
            raise SystemExit(f"of {good} flights the loop named {named[0]}, the batch {named[1]}")
        loop, batch = loops[-1], batches[-1]
        print(f"| {turn + 1} | {loop.cpu_s:.1f} | {batch.cpu_s:.1f} | {loop.wall_s:.1f} | {batch.wall_s:.1f} |")
    loop_s, batch_s = (statistics.fmean(taken.cpu_s for taken in runs) for runs in (loops, batches))
    per_hour = [3600 * flights / seconds for seconds in (loop_s, batch_s)]
    print(f"\nFlights per core hour: loop {per_hour[0]:.0f}, batch {per_hour[1]:.0f}: {loop_s / batch_s:.2f} times\n")
    return folder / "loop-0"


def _run(command: list[str], codes: tuple[int, ...] = (0,)) -> Taken:
    before, began_s = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
    done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False)
    if done.returncode not in codes:
        raise SystemExit(f"{command}: {done.returncode}\n{done.stderr}")
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return Taken(cpu_s=cpu_s, wall_s=time.monotonic() - began_s)
