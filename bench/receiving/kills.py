"""What survives when the recording process is killed at random moments, and what recording costs.

    python bench/receiving/kills.py --kills 1000 --write bench/results/kills.md

Each child writes telemetry at full rate, alone or in batches, and notes in shared memory what was accepted as soon as
``write`` has returned. SIGKILL comes at a random moment. Then the log must hold every accepted record, whole and in
order.
"""

from __future__ import annotations

import argparse
import itertools
import mmap
import os
import random
import signal
import struct
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from infra.files.disk import Disk
from mavlink.protocol.encoder import MavlinkEncoder
from mavlink.protocol.packet import Packet
from mavlink.tlog.log import Tlog
from mavlink.tlog.writer import TlogWriter

T0 = 1_790_000_000_000_000
FRAMES = [
    MavlinkEncoder(1 + k % 100).global_position_int(k, 47.0, 8.0, 500.0, 40.0, (1.0, 2.0, 0.0), 1.0) for k in range(100)
]
RECORD_BYTES = 8 + len(FRAMES[0])
BATCHES = (1, 8, 64)
LONGEST_S = 0.3


def records(start: int, stop: int) -> bytes:
    return b"".join(struct.pack(">Q", T0 + k) + FRAMES[k % 100] for k in range(start, stop))


def write_for_ever(path: Path, accepted: mmap.mmap, batch: int) -> None:
    writer = TlogWriter(path)
    for start in itertools.count(0, batch):
        if batch == 1:
            writer.write(Packet(T0 + start, FRAMES[start % 100]))
        else:
            writer.write_records(records(start, start + batch), batch)
        accepted[:8] = (start + batch).to_bytes(8, "little")


def kill_one(path: Path, batch: int, after_s: float) -> tuple[int, int, int]:
    """Records accepted, found whole and in order, and bytes of a torn one behind them."""
    accepted = mmap.mmap(-1, 8)
    child = os.fork()
    if child == 0:
        try:
            write_for_ever(path, accepted, batch)
        finally:
            os._exit(1)
    while not int.from_bytes(accepted[:8], "little"):
        time.sleep(0.0005)
    time.sleep(after_s)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    data = path.read_bytes()
    whole, torn = divmod(len(data), RECORD_BYTES)
    if data[: whole * RECORD_BYTES] != records(0, whole):
        raise SystemExit(f"{path}: not what was written")
    return int.from_bytes(accepted[:8], "little"), whole, torn


def kill_many(kills: int, folder: Path, seed: int) -> list[str]:
    rng = random.Random(seed)
    accepted = lost = more = torn = unread = 0
    for k in range(kills):
        path = folder / "telemetry.tlog"
        took, found, tail = kill_one(path, BATCHES[k % len(BATCHES)], rng.uniform(0.0, LONGEST_S))
        accepted += took
        lost += max(took - found, 0)
        more += max(found - took, 0)
        torn += tail > 0
        if k % 50 == 0:  # a reader's view of the same; slower than comparing bytes
            unread += found - len(Tlog.open(path).index)
        path.unlink()
        if k % 100 == 99:
            print(f"{k + 1} kills, {accepted} accepted, {lost} lost", file=sys.stderr, flush=True)
    return [
        f"| kills at random moments, batches of {', '.join(map(str, BATCHES))} | {kills:,} |",
        f"| records accepted | {accepted:,} |",
        f"| **accepted records lost** | **{lost}** |",
        f"| records in the file that were not counted any more | {more:,} |",
        f"| files that end in a torn record | {torn} |",
        f"| records that the reader did not find, every 50th file | {unread} |",
    ]


class StallingDisk(Disk):
    """Every sync takes a second."""

    def fsync(self, fd: int) -> None:
        time.sleep(1.0)
        super().fsync(fd)


def latencies_ms(folder: Path, disk: Disk, rate: float, seconds: float) -> np.ndarray:
    """(n,) how long each write took, at a steady rate."""
    path = folder / f"{type(disk).__name__}.tlog"
    took: list[float] = []
    with TlogWriter(path, disk=disk) as writer:
        start = time.perf_counter()
        for k in range(round(rate * seconds)):
            pause = start + k / rate - time.perf_counter()
            if pause > 0.001:
                time.sleep(pause)
            before = time.perf_counter()
            writer.write(Packet(T0 + k, FRAMES[k % 100]))
            took.append((time.perf_counter() - before) * 1e3)
    return np.array(took)


def cost_us(folder: Path, batch: int, count: int = 200_000) -> tuple[float, float]:
    """Wall and CPU µs a record, of the cheapest of three runs."""
    packets = [Packet(T0 + i, FRAMES[i % 100]) for i in range(1000)]
    data = records(0, batch)
    runs: list[tuple[float, float]] = []
    for k in range(3):
        with TlogWriter(folder / f"cost-{batch}-{k}.tlog") as writer:
            wall, cpu = time.perf_counter(), time.thread_time()
            if batch == 1:
                for i in range(count):
                    writer.write(packets[i % 1000])
            else:
                for _ in range(count // batch):
                    writer.write_records(data, batch)
            took = time.perf_counter() - wall, time.thread_time() - cpu
        runs.append((took[0] / count * 1e6, took[1] / count * 1e6))
    return min(runs, key=lambda run: run[1])


def costs(folder: Path) -> list[str]:
    lines = []
    for batch in (1, 10, 50):
        wall, cpu = cost_us(folder, batch)
        lines.append(f"| cost of a record, batches of {batch} | {cpu:.2f} µs CPU, {wall:.2f} µs wall |")
    for name, disk in (("this disk", Disk()), ("a disk whose every sync takes 1 s", StallingDisk())):
        took = latencies_ms(folder, disk, 5000.0, 10.0)
        p50, p99 = np.percentile(took, (50, 99))
        lines.append(
            f"| a write at 5,000/s for 10 s on {name} | p50 {p50:.3f} ms, p99 {p99:.3f} ms, most {took.max():.1f} ms |"
        )
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--folder", type=Path, help="on the disk to be tried; a temporary folder by default")
    parser.add_argument("--write", type=Path, help="put the table into this file")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(dir=options.folder) as name:
        folder = Path(name)
        lines = [*kill_many(options.kills, folder, options.seed), *costs(folder)]
    table = "\n".join(["| what | found |", "|---|---|", *lines])
    text = f"# A recording process killed at random moments\n\n{(__doc__ or '').split(chr(10), 4)[4]}\n{table}\n"
    print(text)
    if options.write:
        options.write.write_text(text)


if __name__ == "__main__":
    main()
