"""Command line of the comparison with tags."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from bench.apriltag.suite import WORKERS, run


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m bench.apriltag", description="Tags on roofs against height")
    parser.add_argument("--quick", action="store_true", help="three heights and one camera")
    parser.add_argument("--out", type=Path, default=Path("bench-results/apriltag"))
    parser.add_argument("--workers", type=int, default=WORKERS)
    options = parser.parse_args()
    print(run(options.out, options.quick, workers=options.workers, say=_say))


def _say(line: str) -> None:
    print(line, file=sys.stderr, flush=True)


if __name__ == "__main__":
    main()
