"""``python -m bench.batch``: many short flights, killed in the middle, and beside a shell loop over ``gcs identify``.

Ratios are of the same flights on the same machine, taken in turn: loop, batch, loop, batch.
"""

from __future__ import annotations

import argparse
import os
import platform
import sys
import tempfile
from pathlib import Path

from bench.batch.cut_flights import cut_flights
from bench.batch.killed_batch import kill_and_go_on
from bench.batch.paired_runs import compare


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m bench.batch", description=__doc__)
    parser.add_argument("--flights", type=int, default=200, help="how many (%(default)s)")
    parser.add_argument("--broken", type=int, default=5, help="of them cannot be named (%(default)s)")
    parser.add_argument("--frames", type=int, default=30, help="of each flight, ten a second (%(default)s)")
    parser.add_argument("--turns", type=int, default=2, help="of loop and batch (%(default)s)")
    parser.add_argument("--folder", type=Path, help="new folder for all of it; else a temporary one")
    given = parser.parse_args()
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    with tempfile.TemporaryDirectory() as temporary:
        folder = given.folder or Path(temporary)
        broken = cut_flights(folder / "flights", given.flights, given.frames, given.broken)
        print(f"# {given.flights} flights of {given.frames} frames, {given.broken} of them broken\n")
        print(f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}; gcs batch -j 2\n")
        names = {path.name for path in (folder / "flights").iterdir()}
        singles = compare(folder, len(names), len(names) - len(broken), given.turns)
        sys.exit(not kill_and_go_on(folder, names, {path.name for path in broken}, singles))


if __name__ == "__main__":
    main()
