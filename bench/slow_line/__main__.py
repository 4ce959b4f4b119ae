"""How soon a key shows behind a slow line: a replay plays beside it.

python -m bench.slow_line [--rate 60000] [--delay 0.0] [--size 120x40] [--keys 30] [--no-replies]
"""

from __future__ import annotations

import argparse
import statistics
import sys
import time
from pathlib import Path

from bench.slow_line.terminal import SlowTerminal

ROOT = Path(__file__).parents[2]
GCS = (sys.executable, "-c", "from gcs.cli.app import main; main()")


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="python -m bench.slow_line", description="Key to screen on a slow line.")
    parser.add_argument("--rate", type=float, default=60_000, help="bytes/s (%(default)s)")
    parser.add_argument("--delay", type=float, default=0.0, help="s each way (%(default)s)")
    parser.add_argument("--size", default="120x40")
    parser.add_argument("--keys", type=int, default=30)
    parser.add_argument("--settle", type=float, default=5.0)
    parser.add_argument("--no-replies", action="store_true")
    parser.add_argument("--session", type=Path, default=ROOT / "sitl_logs" / "curved-road")
    given = parser.parse_args()
    columns, rows = map(int, given.size.split("x"))
    terminal = SlowTerminal(
        [*GCS, "replay", given.session, "--graphics", "blocks"],
        size=(columns, rows),
        bytes_per_s=given.rate or None,
        delay_s=given.delay,
        replies=not given.no_replies,
        folder=ROOT,
    )
    try:
        terminal.wait_for(b"VIDEO")
        terminal.press(b" ")
        time.sleep(given.settle)
        begin, at = time.monotonic(), len(terminal.shown)
        waits, most = [], 0
        for i in range(given.keys):
            # the heading of the focused pane has a mark; the focus goes to and fro
            pane = (b"f", b"FLEET") if i % 2 == 0 else (b"e", b"EVENTS")
            since = terminal.press(pane[0])
            most = max(most, terminal.queued)
            waits.append(terminal.wait_for("▌".encode(), since, 60))
            time.sleep(0.35)
        rate = (len(terminal.shown) - at) / (time.monotonic() - begin) / 1000
        print(
            f"{given.size} {given.rate / 1000:.0f} kB/s delay {given.delay} s: key to screen median "
            f"{statistics.median(waits):.3f} s, worst {max(waits):.3f} s of {len(waits)}; {rate:.1f} kB/s shown, "
            f"at most {most / 1000:.1f} kB queued"
        )
        terminal.press(b"q")
        print("code", terminal.process.wait(60))
    finally:
        terminal.end()


if __name__ == "__main__":
    main()
