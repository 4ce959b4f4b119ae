"""Time to open, check and count a telemetry log, against pymavlink's own reader, in one run.

    python bench/receiving/tlog_speed.py --messages 1000000

Ours is read in a process of its own each time, so that its CPU time and its greatest memory are its own; then the log
is entered at many times, as a replay does that jumps. The log is made first, in a temporary folder: eight vehicles,
40 % ATTITUDE, 40 % GLOBAL_POSITION_INT, 20 % HEARTBEAT.
"""

from __future__ import annotations

import argparse
import json
import random
import resource
import struct
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from pymavlink import mavutil

from bench.receiving.senders import fleet_frames
from mavlink.tlog.log import Tlog
from mavlink.tlog.summary import info

_GLOBAL_POSITION_INT = 33
_SEEKS = 200
VEHICLES, READINGS = 8, 3
"""Senders in the log; readings by ours, each in a fresh process, of which the fastest counts."""


def make_log(path: Path, messages: int) -> None:
    frames = [fleet_frames(system_id) for system_id in range(1, VEHICLES + 1)]
    t_us = 1_790_000_000_000_000
    with path.open("wb") as file:
        for i in range(messages):
            file.write(struct.pack(">Q", t_us + 500 * i) + frames[i % VEHICLES][i // VEHICLES % len(frames[0])])


def read_with_pymavlink(path: Path) -> tuple[int, int]:
    connection: Any = mavutil.mavlink_connection(str(path))
    messages = positions = 0
    while (message := connection.recv_match()) is not None:
        messages += 1
        positions += message.get_msgId() == _GLOBAL_POSITION_INT
    connection.close()
    return messages, positions


def measure_ours(path: Path) -> dict[str, float]:
    """Read in this process, which has read nothing before."""
    cpu, wall = time.process_time(), time.perf_counter()
    tlog = Tlog.open(path)
    positions = tlog.columns(_GLOBAL_POSITION_INT)[0].size
    cpu, wall = time.process_time() - cpu, time.perf_counter() - wall
    rss_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    rng = random.Random(2)
    first, last = int(tlog.index.t_us.min()), int(tlog.index.t_us.max())
    seeks_ms = []
    for _ in range(_SEEKS):
        start_us = rng.randrange(first, last)
        start = time.process_time()
        next(tlog.packets(start_us, start_us + 1_000_000))
        seeks_ms.append((time.process_time() - start) * 1e3)
    messages = sum(m.count for m in info(tlog).messages)
    return {
        "messages": messages,
        "positions": positions,
        "cpu_s": cpu,
        "wall_s": wall,
        "rss_mb": rss_mb,
        "seek_ms": sorted(seeks_ms)[_SEEKS // 2],
        "seek_worst_ms": max(seeks_ms),
    }


def best_of_ours(path: Path) -> dict[str, float]:
    """The least of everything over some fresh processes; of memory and the worst seek the greatest."""
    runs = []
    for _ in range(READINGS):
        command = [sys.executable, "-m", "bench.receiving.tlog_speed", "--read", str(path)]
        runs.append(json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout))
    best = {key: min(run[key] for run in runs) for key in runs[0]}
    return best | {key: max(run[key] for run in runs) for key in ("rss_mb", "seek_worst_ms")}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--messages", type=int, default=1_000_000)
    parser.add_argument("--read", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.read:
        print(json.dumps(measure_ours(options.read)))
        return
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "speed.tlog"
        make_log(path, options.messages)
        ours = best_of_ours(path)
        start_s = time.process_time()
        theirs = read_with_pymavlink(path)
        theirs_s = time.process_time() - start_s
        size_mb = path.stat().st_size / 1e6
    if (ours["messages"], ours["positions"]) != theirs:
        raise SystemExit(f"not the same log: ours has {ours} messages and positions, pymavlink {theirs}")
    print(f"{options.messages} messages, {size_mb:.1f} MB, {theirs[1]} positions, the same in both")
    print(f"{'reader':<34}{'CPU s':>9}{'messages/s':>13}")
    for name, seconds in (("Tlog.open + positions", ours["cpu_s"]), ("mavutil recv_match, all messages", theirs_s)):
        print(f"{name:<34}{seconds:>9.3f}{options.messages / seconds:>13,.0f}")
    print(f"ratio {theirs_s / ours['cpu_s']:.1f}")
    print(f"ours by the clock {ours['wall_s']:.3f} s, most memory {ours['rss_mb']:.0f} MB")
    print(f"to any time: {ours['seek_ms']:.1f} ms, at worst {ours['seek_worst_ms']:.1f} ms")


if __name__ == "__main__":
    main()
